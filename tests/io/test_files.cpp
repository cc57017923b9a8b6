// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/json_io.h"

#include <nlohmann/json.hpp>

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <cmath>
#include <filesystem>
#include <limits>

using namespace cvmesh;
using namespace cvmesh::image_files;
using nlohmann::ordered_json;

namespace {

std::size_t files_in(const std::filesystem::path& folder) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder))
    ++count;
  return count;
}

void check_output_error(const std::filesystem::path& path, const std::string& part) {
  try {
    AtomicFile file(path);
    file.write("x");
    file.commit();
    FAIL("accepted " + path.string());
  } catch (const Error& error) {
    CAPTURE(error.what());
    CHECK(error.code() == ErrorCode::Output);
    CHECK(std::string(error.what()).find(path.string()) != std::string::npos);
    CHECK(std::string(error.what()).find(part) != std::string::npos);
  }
}

std::string json_refusal(const std::filesystem::path& path, const std::string& text) {
  write_file(path, text);
  try {
    read_json(path);
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadParameter);
    return error.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("AtomicFile: a file appears under its name only when committed", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const auto path = folder / "a.txt";
  std::string large;
  for (int i = 0; i < 700'000; ++i)
    large += std::to_string(i % 10) + "abc";
  {
    AtomicFile file(path);
    file.write("head");
    file.write(large);  // more than two buffers
    CHECK_FALSE(std::filesystem::exists(path));
    CHECK(files_in(folder.path()) == 1);
    file.commit();
  }
  CHECK(read_file(path) == "head" + large);
  CHECK(files_in(folder.path()) == 1);
}

TEST_CASE("AtomicFile: an abandoned file leaves the older one and nothing else", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const auto path = folder / "a.txt";
  write_file(path, "older");
  {
    AtomicFile file(path);
    file.write(std::string(std::size_t{3} << 20, 'x'));
  }
  CHECK(read_file(path) == "older");
  CHECK(files_in(folder.path()) == 1);
}

TEST_CASE("AtomicFile: what cannot be written is told with path and reason", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  check_output_error(folder / "absent" / "a.txt", "No such file");
  std::filesystem::create_directory(folder / "dir");
  check_output_error(folder / "dir", "directory");
  write_file(folder / "file", "");
  check_output_error(folder / "file" / "a.txt", "Not a directory");
  CHECK(files_in(folder.path()) == 2);
}

TEST_CASE("AtomicFile: a name at the limit of the file system works", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const auto path = folder / (std::string(251, 'n') + ".txt");
  AtomicFile file(path);
  file.write("x");
  file.commit();
  CHECK(read_file(path) == "x");
}

TEST_CASE("write_json: what was written is read back, keys in order", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const ordered_json value = {{"zeta", 1}, {"alpha", {1.5, true, nullptr}}, {"r", 0.1}};
  write_json(folder / "a.json", value);
  CHECK(read_json(folder / "a.json") == value);
  const std::string text = read_file(folder / "a.json");
  CHECK(text.find("zeta") < text.find("alpha"));
  CHECK(text.back() == '\n');
}

TEST_CASE("write_json: bytes that are no UTF-8 and infinities do not stop it", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_json(folder / "a.json",
             {{"name", "\xff\xfe"}, {"x", std::numeric_limits<double>::infinity()}});
  CHECK(read_json(folder / "a.json")["x"].is_null());
}

TEST_CASE("read_json: faults are told by line and column", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const auto path = folder / "a.json";
  CHECK(json_refusal(path, "{\n  \"r\": 0.8,\n  oops\n}").find("line 3, column 3") !=
        std::string::npos);
  CHECK(json_refusal(path, "").find("no valid JSON") != std::string::npos);
  CHECK(json_refusal(path, "{\"r\": 1} x").find("line 1, column 10") != std::string::npos);
  CHECK(json_refusal(path, "{\"r\": 1,\n \"r\": 2}").find("key \"r\" twice") != std::string::npos);
  CHECK(json_refusal(path, std::string(100'000, '[')).find("nested deeper") != std::string::npos);
  CHECK_THROWS_WITH(read_json(folder / "absent.json"), Catch::Contains("does not exist"));
  CHECK_THROWS_WITH(read_json(folder.path()), Catch::Contains("not a file"));
  // The same key in two objects is no fault.
  write_file(path, "{\"a\": {\"r\": 1}, \"b\": [{\"r\": 2}, {\"r\": 3}]}");
  CHECK(read_json(path)["b"][1]["r"] == 3);
}
