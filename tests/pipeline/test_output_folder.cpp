// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/pipeline/output_folder.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"

using namespace cvmesh;
using image_files::read_file;
using image_files::write_file;
namespace fs = std::filesystem;

namespace {

const OutputPlan kMeshes{.suffixes = {".vtu", ".metrics.json"}};
const OutputPlan kDeck{.suffixes = {".inp", ".metrics.json"}};

OutputPlan replacing(OutputPlan plan) {
  plan.replace = true;
  return plan;
}

void check_refused(const test_data::TemporaryFolder& folder,
                   const OutputPlan& plan,
                   const std::string& file) {
  CAPTURE(file);
  try {
    const OutputFolder outputs(folder.path(), "a", plan);
    FAIL("the folder was taken");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Output);
    CHECK_THAT(error.message(), Catch::Contains("/" + file + "' is there already") &&
                                    Catch::Contains("--force") && Catch::Contains("--out"));
  }
  CHECK(read_file(folder / file).find("old") != std::string::npos);
}

}  // namespace

TEST_CASE("OutputFolder: results of an earlier run stay unless they may be replaced",
          "[pipeline][unit]") {
  // The last two are no file of this plan, but of a run of that name: half of the old results
  // beside half of new ones would be worse than either.
  for (const char* file : {"a.metrics.json", "a.vtu", "a.mesh", "a.surface.vtp"}) {
    const test_data::TemporaryFolder folder;
    write_file(folder / file, "old");
    write_file(folder / "b.vtu", "another run's");
    check_refused(folder, kMeshes, file);
    const OutputFolder outputs(folder.path(), "a", replacing(kMeshes));
    CHECK_FALSE(fs::exists(folder / file));
    CHECK(fs::exists(folder / "b.vtu"));
  }
}

TEST_CASE("OutputFolder: a deck that somebody wrote is in the way only of a deck",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.inp", "** my old job\n");
  CHECK_NOTHROW(OutputFolder(folder.path(), "a", kMeshes));
  CHECK_NOTHROW(OutputFolder(folder.path(), "a", replacing(kMeshes)));
  check_refused(folder, kDeck, "a.inp");
  write_file(folder / "a.inp", std::string(kInpFirstLine) + "\nold\n");
  check_refused(folder, kMeshes, "a.inp");
  const OutputFolder outputs(folder.path(), "a", replacing(kMeshes));
  CHECK_FALSE(fs::exists(folder / "a.inp"));
}

TEST_CASE("OutputFolder: kept stages are results, too; a failure file is not", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  fs::create_directory(folder / "a.stages");
  write_file(folder / "a.stages/dense.off", "old");
  write_file(folder / "a.failed.json", "old");
  fs::create_directory(folder / "b.stages");
  write_file(folder / "b.stages/dense.off", "another volume's");
  check_refused(folder, kMeshes, "a.stages/dense.off");
  CHECK(fs::exists(folder / "a.stages/dense.off"));
  const OutputFolder outputs(folder.path(), "a", replacing(kMeshes));
  CHECK_FALSE(fs::exists(folder / "a.stages"));
  CHECK_FALSE(fs::exists(folder / "a.failed.json"));
  CHECK(fs::exists(folder / "b.stages/dense.off"));
}

TEST_CASE("OutputFolder: a file where the stages would go is left alone", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.stages", "mine");
  OutputFolder outputs(folder.path(), "a", replacing(kMeshes));
  CHECK_THROWS_AS(outputs.add_stage("dense.off"), Error);
  outputs.discard();
  CHECK(fs::exists(folder / "a.stages"));
}

TEST_CASE("OutputFolder: abandoned, it holds neither results nor temporary files",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  OutputFolder outputs(folder / "out", "a", kMeshes);
  AtomicFile finished(outputs.add(".vtu"));
  finished.commit();
  AtomicFile writing(outputs.add(".mesh"));
  AtomicFile stage(outputs.add_stage("dense.off"));
  writing.write("half of it");
  write_file(folder / "out/.b.mesh.1-0.part", "another process's");
  outputs.abandon();
  CHECK_FALSE(fs::exists(folder / "out/a.vtu"));
  std::vector<std::string> left;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "out"))
    left.push_back(entry.path().filename().string());
  CHECK(left == std::vector<std::string>{".b.mesh.1-0.part"});
  CHECK_THROWS_AS(writing.commit(), Error);  // and never appears later
  CHECK_FALSE(fs::exists(folder / "out/a.mesh"));
}
