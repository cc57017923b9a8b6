// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/label_names.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"

using namespace cvmesh;
using namespace cvmesh::image_files;

namespace {

std::map<Label, std::string> names_in(const std::string& text) {
  const test_data::TemporaryFolder folder;
  write_file(folder / "names.txt", text);
  return read_label_names(folder / "names.txt");
}

std::string message_of(const std::string& text) {
  try {
    names_in(text);
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadParameter);
    return error.message();
  }
  FAIL("accepted");
  return "";
}

constexpr char kSnap[] =
    "################################################\n# ITK-SnAP Label Description File\n"
    "    0     0    0    0        0  0  0    \"Clear Label\"\n"
    "    1   255    0    0        1  1  1    \"cortical \\ \"bone\"\"\r\n"
    "  300     0  255    0     0.5  1  1    \"implant\"\n";
constexpr char kSlicer[] =
    "# Color table file /tmp/a.ctbl\n# 2 values\n0 background 0 0 0 0\n\n"
    "2 b\xC3\xB6ne 128 174 128 255\n-4 left_lung 1 2 3 255\n";

}  // namespace

TEST_CASE("read_label_names: ITK-SNAP label descriptions", "[io][unit]") {
  CHECK(names_in(kSnap) == std::map<Label, std::string>{
                               {0, "Clear Label"}, {1, "cortical \\ \"bone\""}, {300, "implant"}});
}

TEST_CASE("read_label_names: 3D Slicer colour tables", "[io][unit]") {
  CHECK(names_in(kSlicer) ==
        std::map<Label, std::string>{{0, "background"}, {2, "b\xC3\xB6ne"}, {-4, "left_lung"}});
}

TEST_CASE("read_label_names: what is wrong is named with its line", "[io][unit]") {
  using Catch::Contains;
  CHECK_THAT(message_of(std::string(kSnap) + "2 0 0 0 1 1 bone\n"),
             Contains("line 6") && Contains("quotes"));
  CHECK_THAT(message_of(std::string(kSnap) + "2 0 0 0 1 1 \"bone\"\n"), Contains("6 numbers"));
  CHECK_THAT(message_of(std::string(kSnap) + "2 0 x 0 1 1 1 \"bone\"\n"),
             Contains("\"x\" is no number") || Contains("'x' is no number"));
  CHECK_THAT(message_of(std::string(kSnap) + "300 0 0 0 1 1 1 \"again\"\n"),
             Contains("label 300 was named before"));
  CHECK_THAT(message_of(std::string(kSnap) + "3 0 0 0 1 1 1 \" \"\n"), Contains("empty name"));
  CHECK_THAT(message_of(std::string(kSlicer) + "3 two words 1 2 3 255\n"),
             Contains("line 7") && Contains("7 words"));
  CHECK_THAT(message_of("99999999999 a 1 2 3 4\n"), Contains("no label value"));
  CHECK_THAT(message_of("# only\n"), Contains("no entry"));
  CHECK_THAT(message_of(std::string(kSnap) + "3 0 0 0 1 1 1 \"kn\xF6"
                                             "chern\"\n"),
             Contains("line 6") && Contains("UTF-8"));
  const test_data::TemporaryFolder folder;
  CHECK_THROWS_AS(read_label_names(folder / "absent"), Error);
  CHECK_THROWS_WITH(read_label_names(folder.path()), Contains("is no file"));
  CHECK_THROWS_WITH(read_label_names("/dev/zero"), Contains("is no file"));
}
