// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"

#include <nlohmann/json.hpp>

#include "io/image_files.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include "support/run_cli.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

using namespace cvmesh;
namespace fs = std::filesystem;

namespace {

using run_cli::Outcome;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// Meshes a small phantom of two labels into `out`; gives the path of its report.
std::string mesh(const test_data::TemporaryFolder& folder,
                 const std::string& out,
                 const std::vector<std::string>& more = {}) {
  write_volume_file(folder / "a.nii", phantoms::nested_balls(5, 9));
  std::vector<std::string> words = {
      "mesh", (folder / "a.nii").string(), "--out", (folder / out).string(), "-q", "--force"};
  words.insert(words.end(), more.begin(), more.end());
  const Outcome outcome = run_cli::cvmesh(words);
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
  return (folder / (out + "/a.metrics.json")).string();
}

}  // namespace

TEST_CASE("cvmesh compare: equal runs are within, a changed parameter is beyond", "[cli]") {
  const test_data::TemporaryFolder folder;
  const std::string a = mesh(folder, "a"), b = mesh(folder, "b"),
                    c = mesh(folder, "c", {"--set", "epsilon=1.5"});
  const Outcome same = run_cli::cvmesh({"compare", a, b});
  INFO(same.out);
  CHECK(same.exit_code == 0);
  CHECK(contains(same.out, "within: "));
  CHECK(contains(same.out, " 0 within, 0 new"));

  const std::string json = (folder / "c.json").string();
  const Outcome changed = run_cli::cvmesh({"compare", a, c, "--json", json});
  INFO(changed.out);
  CHECK(changed.exit_code == 5);
  CHECK(contains(changed.out, "note: parameters.epsilon differs: 1 and 1.5"));
  CHECK(contains(changed.out, "results.mesh.tets"));
  const auto comparison = read_json(json);
  CHECK(comparison["verdict"] == "beyond");
  CHECK(comparison["beyond"] > 5);
  bool has_tets = false;
  for (const auto& value : comparison["values"])
    if (value["path"] == "results.mesh.tets") {
      has_tets = true;
      CHECK(value["verdict"] == "beyond");
      CHECK(value["difference"].get<double>() ==
            value["b"].get<double>() - value["a"].get<double>());
    }
  CHECK(has_tets);

  image_files::write_file(folder / "t.json", R"({"**": {"ignore": true}})");
  CHECK(
      run_cli::cvmesh({"compare", a, c, "--tolerances", (folder / "t.json").string()}).exit_code ==
      0);
  // Tolerances of the user come after the built-in ones.
  image_files::write_file(folder / "t.json", R"({"results.stages.insertion.**": {}})");
  CHECK(
      contains(run_cli::cvmesh({"compare", a, c, "--tolerances", (folder / "t.json").string()}).out,
               "results.stages.insertion."));
  CHECK_FALSE(contains(changed.out, "results.stages.insertion."));
}

TEST_CASE("cvmesh compare: files that are no reports give code 3 and are named with the reason",
          "[cli]") {
  const test_data::TemporaryFolder folder;
  const std::string good = mesh(folder, "a", {"--surface-only"});
  const auto refused = [&](const std::string& name, const std::string& bytes) {
    image_files::write_file(folder / name, bytes);
    const Outcome outcome = run_cli::cvmesh({"compare", good, (folder / name).string()});
    CHECK(outcome.exit_code == 3);
    CHECK(contains(outcome.err, name));
    CHECK(outcome.out.empty());
    return outcome.err;
  };
  CHECK(contains(refused("cut.json", "{\"cvmesh\": "), "no valid JSON"));
  CHECK(contains(refused("empty.json", ""), "no valid JSON"));
  CHECK(contains(refused("other.json", R"({"epsilon": 1})"), "no report of cvmesh"));
  CHECK(contains(refused("list.json", "[1, 2]"), "no report of cvmesh"));
  CHECK(contains(refused("image.json", std::string("\x1f\x8b\0\0", 4)), "no valid JSON"));
  const Outcome missing = run_cli::cvmesh({"compare", good, (folder / "no.json").string()});
  CHECK(missing.exit_code == 3);
  CHECK(contains(missing.err, "no.json' does not exist"));

  CHECK(run_cli::cvmesh({"compare", good}).exit_code == 2);
  CHECK(run_cli::cvmesh({"compare", good, good, "--frobnicate"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"compare", good, good, "--all", "--quiet"}).exit_code == 2);
  image_files::write_file(folder / "t.json", R"({"results.mesh.tets": {"relative": 1}})");
  const Outcome tolerances =
      run_cli::cvmesh({"compare", good, good, "--tolerances", (folder / "t.json").string()});
  CHECK(tolerances.exit_code == 2);
  CHECK(contains(tolerances.err, "t.json': unknown key \"results.mesh.tets\".relative"));
  CHECK(
      run_cli::cvmesh({"compare", good, good, "--json", (folder / "no_folder" / "x.json").string()})
          .exit_code == 6);
}

TEST_CASE("cvmesh defaults --tolerances: prints a file that changes no verdict", "[cli]") {
  const test_data::TemporaryFolder folder;
  const std::string a = mesh(folder, "a", {"--surface-only"}),
                    b = mesh(folder, "b", {"--surface-only", "--seed", "2"});
  const Outcome defaults = run_cli::cvmesh({"defaults", "--tolerances"});
  REQUIRE(defaults.exit_code == 0);
  image_files::write_file(folder / "t.json", defaults.out);
  const Outcome with =
      run_cli::cvmesh({"compare", a, b, "--tolerances", (folder / "t.json").string()});
  const Outcome without = run_cli::cvmesh({"compare", a, b});
  CHECK(with.out == without.out);
  CHECK(with.exit_code == without.exit_code);
}

TEST_CASE("cvmesh summary: one row per run, whatever its file is like, in order of the paths",
          "[cli]") {
  const test_data::TemporaryFolder folder;
  fs::create_directories(folder / "runs/z");
  mesh(folder, "runs/good", {"--surface-only", "--set", "labels.1.name==cmd,\"x\""});
  fs::copy(folder / "runs/good/a.metrics.json", folder / "runs/z/late.metrics.json");
  image_files::write_file(folder / "runs/b.metrics.json", "{\"cut");
  image_files::write_file(folder / "runs/notes.json", "{}");
  image_files::write_file(folder / "one.nii", "no image");
  REQUIRE(run_cli::cvmesh(
              {"mesh", (folder / "one.nii").string(), "--out", (folder / "runs").string(), "-q"})
              .exit_code == 3);

  const std::string csv = (folder / "runs.csv").string();
  const Outcome outcome = run_cli::cvmesh({"summary", (folder / "runs").string(), "--out", csv});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 5);
  CHECK(outcome.out.empty());
  CHECK(contains(outcome.err, "4 runs: 2 succeeded, 0 missed gates, 1 failed, 1 unreadable"));
  std::ifstream file(csv, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  CHECK(text.rfind("run,status,file,", 0) == 0);
  std::vector<std::size_t> places;
  for (const char* run :
       {"runs/b,unreadable", "runs/good/a,success", "runs/one,failed", "runs/z/late,success"})
    places.push_back(text.find(run));
  CHECK(std::is_sorted(places.begin(), places.end()));
  CHECK(places.back() != std::string::npos);
  CHECK(contains(text, "no valid JSON"));
  CHECK_FALSE(contains(text, "notes"));

  // A folder named twice, or inside another one, gives no row twice; the same bytes on stdout.
  const Outcome twice =
      run_cli::cvmesh({"summary", (folder / "runs").string(), (folder / "runs/z").string()});
  CHECK(twice.exit_code == 5);
  CHECK(twice.out == text);

  CHECK(run_cli::cvmesh({"summary", (folder / "runs/good").string()}).exit_code == 0);
  const Outcome none = run_cli::cvmesh({"summary", (folder / "nowhere").string()});
  CHECK(none.exit_code == 3);
  CHECK(contains(none.err, "nowhere' is no folder"));
  fs::create_directories(folder / "empty");
  const Outcome empty = run_cli::cvmesh({"summary", (folder / "empty").string()});
  CHECK(empty.exit_code == 3);
  CHECK(contains(empty.err, "no NAME.metrics.json"));
  CHECK(run_cli::cvmesh({"summary"}).exit_code == 2);
}

TEST_CASE("cvmesh mesh: a missed gate gives code 5, with the mesh and a report that tells",
          "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(5, 9));
  const auto run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {
        "mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(), "-q", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    return run_cli::cvmesh(words);
  };
  const Outcome missed =
      run({"--set", "gates.min_dihedral_deg=60", "--set", "gates.max_distance_vox=50", "--set",
           "gates.max_mean_distance_vox=1e-6"});
  INFO(missed.err);
  CHECK(missed.exit_code == 5);
  CHECK(contains(missed.err, "2 of 3 gates missed: min_dihedral_deg is "));
  CHECK(contains(missed.err, "max_mean_distance_vox is "));
  CHECK_FALSE(contains(missed.err, "max_distance_vox is "));
  CHECK(fs::exists(folder / "out/a.vtu"));
  CHECK_FALSE(fs::exists(folder / "out/a.failed.json"));
  const auto report = read_json(folder / "out/a.metrics.json");
  CHECK(report["status"] == "success");
  CHECK(report["results"]["gates"].size() == 3);
  CHECK(report["results"]["gates"][0]["passed"] == false);
  CHECK(report["parameters"]["gates"]["max_distance_vox"] == 50.0);
  const Outcome summary = run_cli::cvmesh({"summary", (folder / "out").string()});
  CHECK(summary.exit_code == 5);
  CHECK(contains(summary.out, "missed gates"));
  CHECK(contains(summary.out, "min_dihedral_deg max_mean_distance_vox"));

  CHECK(run({"--set", "gates.max_distance_vox=50"}).exit_code == 0);
  const Outcome no_tets = run({"--surface-only", "--set", "gates.min_dihedral_deg=60"});
  CHECK(no_tets.exit_code == 2);
  CHECK(contains(no_tets.err, "gates.min_dihedral_deg cannot be measured without tets"));
  CHECK(run({"--surface-only", "--set", "gates.max_distance_vox=50"}).exit_code == 0);
  CHECK(run({"--surface-only", "--set", "gates.max_distance_vox=0.001"}).exit_code == 5);
}
