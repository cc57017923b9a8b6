// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"

#include <nlohmann/json.hpp>

#include "io/image_files.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include "support/run_cli.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

using namespace cvmesh;
namespace fs = std::filesystem;

namespace {

using run_cli::Outcome;
using Words = std::vector<std::string>;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// No mesh, no report, no temporary file: at most the failure file.
void check_nothing_written(const fs::path& folder) {
  if (!fs::exists(folder)) return;
  for (const auto& entry : fs::directory_iterator(folder)) {
    INFO(entry.path());
    CHECK(contains(entry.path().filename().string(), ".failed.json"));
  }
}

/// Runs `cvmesh mesh` on bytes that are to be refused.
Outcome mesh_bytes(const test_data::TemporaryFolder& folder,
                   const std::string& name,
                   const std::string& bytes) {
  image_files::write_file(folder / name, bytes);
  const Outcome outcome =
      run_cli::cvmesh({"mesh", (folder / name).string(), "--out", (folder / "out").string()});
  check_nothing_written(folder / "out");
  return outcome;
}

}  // namespace

TEST_CASE("cvmesh: help and version say what they should and succeed", "[cli]") {
  const Outcome help = run_cli::cvmesh({"--help"});
  CHECK(help.exit_code == 0);
  CHECK(contains(help.out, "Examples:"));
  CHECK(contains(help.out, "cvmesh mesh scan.nii.gz"));
  CHECK(contains(run_cli::cvmesh({"mesh", "--help"}).out, "--keep-stages"));
  const Outcome version = run_cli::cvmesh({"--version"});
  CHECK(version.exit_code == 0);
  CHECK(version.out.rfind("cvmesh 0.", 0) == 0);
}

TEST_CASE("cvmesh: a wrong command line is refused with code 2", "[cli]") {
  CHECK(run_cli::cvmesh({}).exit_code == 2);
  CHECK(run_cli::cvmesh({"smooth"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--colour", "red"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--threads", "0"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--space", "up"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--quiet", "--verbose"}).exit_code == 2);
  CHECK(
      run_cli::cvmesh({"mesh"}).err ==
      "cvmesh: error: command line: LABELS is required; cvmesh mesh --help lists what there is\n");
}

TEST_CASE("cvmesh schema and defaults: print JSON to standard output", "[cli]") {
  const Outcome schema = run_cli::cvmesh({"schema"});
  CHECK(schema.exit_code == 0);
  CHECK(nlohmann::json::parse(schema.out)["type"] == "object");
  const Outcome defaults = run_cli::cvmesh({"defaults"});
  CHECK(nlohmann::json::parse(defaults.out)["r"] == 0.8);
}

TEST_CASE("cvmesh mesh: bad inputs give one clear message and code 3", "[cli]") {
  const test_data::TemporaryFolder folder;
  const Outcome missing =
      run_cli::cvmesh({"mesh", (folder / "no.nii").string(), "--out", (folder / "out").string()});
  CHECK(missing.exit_code == 3);
  CHECK(contains(missing.err, "no.nii' does not exist"));
  CHECK_FALSE(fs::exists(folder / "out"));

  const Outcome no_image = mesh_bytes(folder, "text.nii", "this is no image at all");
  CHECK(no_image.exit_code == 3);
  CHECK(contains(no_image.err, "text.nii"));

  image_files::Nifti flat;
  flat.dim = {2, 4, 6, 1, 1, 1, 1, 1};
  CHECK(mesh_bytes(folder, "flat.nii", flat.bytes()).exit_code == 3);
  image_files::Nifti movie;
  movie.dim = {4, 4, 3, 2, 2, 1, 1, 1};
  movie.voxels.assign(48, '\1');
  CHECK(mesh_bytes(folder, "movie.nii", movie.bytes()).exit_code == 3);

  const Outcome one_label = mesh_bytes(folder, "one.nii", image_files::Nifti{}.bytes());
  CHECK(one_label.exit_code == 3);
  CHECK(contains(one_label.err, "label"));

  image_files::Nifti floats;
  floats.datatype = 16;
  std::vector<float> values(24, 0.0F);
  values[5] = 0.5F;
  floats.voxels = image_files::bytes_of_all(values);
  const Outcome fractions = mesh_bytes(folder, "floats.nii", floats.bytes());
  CHECK(fractions.exit_code == 3);
  CHECK(contains(fractions.err, "0.5"));

  for (const Outcome* outcome : {&missing, &no_image, &one_label, &fractions}) {
    INFO(outcome->err);
    CHECK(contains(outcome->err, "cvmesh: error: "));
    CHECK(outcome->out.empty());
  }
}

TEST_CASE("cvmesh mesh: bad parameters give code 2 before anything is written", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const std::string input = (folder / "a.nii").string(), out = (folder / "out").string();

  image_files::write_file(folder / "p.json", R"({"epsilom": 2})");
  const Outcome unknown =
      run_cli::cvmesh({"mesh", input, "--params", (folder / "p.json").string(), "--out", out});
  CHECK(unknown.exit_code == 2);
  CHECK(contains(unknown.err, "unknown key \"epsilom\"; did you mean \"epsilon\"?"));

  image_files::write_file(folder / "p.json", R"({"epsilon": -1})");
  const Outcome negative =
      run_cli::cvmesh({"mesh", input, "--params", (folder / "p.json").string(), "--out", out});
  CHECK(negative.exit_code == 2);
  CHECK(contains(negative.err, "epsilon (-1) must be greater than 0"));

  image_files::write_file(folder / "p.json", "{\"epsilon\": ");
  CHECK(run_cli::cvmesh({"mesh", input, "--params", (folder / "p.json").string(), "--out", out})
            .exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", input, "--params", (folder / "no.json").string(), "--out", out})
            .exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", input, "--seed", "x", "--out", out}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", input, "--set", "epsilon", "--out", out}).exit_code == 2);
  CHECK_FALSE(fs::exists(folder / "out"));
}

TEST_CASE("cvmesh mesh: sizes of interfaces rule there, or a warning says why not", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(6, 11));
  const std::string input = (folder / "a.nii").string(), out = (folder / "out").string();
  const auto mesh = [&](const std::string& interfaces) {
    return run_cli::cvmesh({"mesh", input, "--out", out, "--force", "--surface-only", "--set",
                            "interfaces=" + interfaces});
  };
  // Rows: the outer interface, of label 2 and the exterior, then that of labels 2 and 1.
  const auto particles_on = [&](std::size_t row) {
    return read_json(folder / "out/a.metrics.json")["results"]["interfaces"][row]["particles"]
        .get<int>();
  };
  REQUIRE(mesh("[]").exit_code == 0);
  const int outer = particles_on(0), inner = particles_on(1);
  const Outcome finer = mesh(R"([{"labels": [1, 2], "epsilon": 0.4}])");
  INFO(finer.err);
  REQUIRE(finer.exit_code == 0);
  CHECK_FALSE(contains(finer.err, "warning"));
  CHECK(particles_on(1) > 2 * inner);
  CHECK(particles_on(0) < 2 * outer);

  const Outcome idle = mesh(R"([{"labels": [1, 7]}, {"labels": [0, 1], "epsilon": 1}])");
  CHECK(idle.exit_code == 0);
  CHECK(contains(idle.err, "interfaces names labels 1 and 7, which are not both among the labels"));
  CHECK(contains(idle.err, "interfaces names labels 0 and 1, which do not touch each other"));

  const Outcome twice = mesh(R"([{"labels": [1, 2]}, {"labels": [2, 1]}])");
  CHECK(twice.exit_code == 2);
  CHECK(contains(twice.err, "interfaces[1].labels ([2, 1]) names the labels of interfaces[0]"));
}

TEST_CASE("cvmesh mesh: boxes outside the volume are refused, idle ones give a warning", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const std::string input = (folder / "a.nii").string(), out = (folder / "out").string();
  const auto mesh = [&](const std::string& boxes) {
    return run_cli::cvmesh({"mesh", input, "--out", out, "--force", "--set", "boxes=" + boxes});
  };
  const Outcome outside = mesh(R"([{"box": [0, 0, 0, 9, 99, 9], "epsilon": 1}])");
  CHECK(outside.exit_code == 2);
  CHECK(contains(outside.err,
                 "boxes[0].box reaches j = 99, outside the volume of 21 x 21 x 21 voxels; keep j "
                 "between 0 and 20"));
  check_nothing_written(folder / "out");

  const Outcome idle = mesh(R"([{"box": [0, 0, 0, 20, 20, 20], "epsilon": 1},
                                {"box": [0, 0, 0, 2, 2, 2], "epsilon": 1},
                                {"box": [9, 9, 9, 11, 11, 11], "max_edge_mm": 0.5}])");
  INFO(idle.err);
  CHECK(idle.exit_code == 0);
  CHECK_FALSE(contains(idle.err, "boxes[0]"));
  CHECK(contains(idle.err, "no surface crosses boxes[1], so it has no effect"));
  CHECK(
      contains(idle.err, "no surface crosses boxes[2], so its max_edge_mm bounds the tets in it"));
  // The small tets are there: without the box a ball this coarse has few points inside.
  const auto counts = read_json(folder / "out/a.metrics.json")["results"]["mesh"];
  REQUIRE(mesh("[]").exit_code == 0);
  const auto plain = read_json(folder / "out/a.metrics.json")["results"]["mesh"];
  CHECK(counts["interior_points"] > 3 * plain["interior_points"].get<int>());
}

TEST_CASE("cvmesh mesh: one warning names the labels that are too coarse around", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "rod.nii", phantoms::rod(2));
  const auto mesh = [&](const char* name, const char* epsilon, const char* label_name) {
    return run_cli::cvmesh({"mesh", (folder / name).string(), "--out", (folder / "out").string(),
                            "--force", "--surface-only", "--set", epsilon, "--set", label_name});
  };
  const Outcome fine = mesh("rod.nii", "epsilon=1", "labels.1.name=rod");
  CHECK(fine.exit_code == 0);
  CHECK_FALSE(contains(fine.err, "too coarse"));
  const Outcome coarse = mesh("rod.nii", "epsilon=4", "labels.1.name=rod");
  INFO(coarse.err);
  CHECK(coarse.exit_code == 0);
  CHECK(contains(coarse.err,
                 " % of label 1 (rod); lower epsilon or set max_edge_mm for them, as "
                 "in labels.1.epsilon"));
  const auto labels = read_json(folder / "out/rod.metrics.json")["results"]["labels"];
  CHECK(labels[0]["share_below_three_facets"] > 0.5);

  write_volume_file(folder / "blobs.nii", phantoms::random_blobs(3, 9));
  const Outcome many = mesh("blobs.nii", "epsilon=8", "labels.1.name=blob");
  INFO(many.err);
  CHECK(many.exit_code == 0);
  const auto first = many.err.find("too coarse");
  REQUIRE(first != std::string::npos);
  CHECK(many.err.find("too coarse", first + 1) == std::string::npos);
  CHECK(contains(many.err, "more; lower epsilon"));
}

TEST_CASE("cvmesh mesh: an output folder that cannot be made gives code 6 at once", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  image_files::write_file(folder / "file", "x");
  const Outcome outcome = run_cli::cvmesh(
      {"mesh", (folder / "a.nii").string(), "--out", (folder / "file" / "out").string()});
  CHECK(outcome.exit_code == 6);
  CHECK(contains(outcome.err, "output folder"));
  CHECK_FALSE(contains(outcome.err, "level sets"));
}

TEST_CASE("cvmesh mesh: logs one line per stage and a summary, or nothing when quiet", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii.gz", phantoms::ball(6));
  const std::string input = (folder / "a.nii.gz").string();
  const Outcome loud = run_cli::cvmesh({"mesh", input, "--out", (folder / "out").string(), "--set",
                                        "epsilon=1.5", "--threads", "2"});
  INFO(loud.err);
  REQUIRE(loud.exit_code == 0);
  CHECK(loud.out.empty());
  for (const char* stage : {"tightening: ", "medial axis: ", "decimation: ", "tetrahedra: "})
    CHECK(contains(loud.err, stage));
  CHECK(contains(loud.err, "smallest dihedral"));
  CHECK(contains(loud.err, "2 threads"));
  CHECK_FALSE(contains(loud.err, "\r"));
  CHECK(fs::exists(folder / "out/a.metrics.json"));
  const auto json = read_json(folder / "out/a.metrics.json");
  CHECK(json["parameters"]["epsilon"] == 1.5);

  const Outcome quiet =
      run_cli::cvmesh({"mesh", input, "--out", (folder / "out").string(), "--force", "--quiet"});
  CHECK(quiet.exit_code == 0);
  CHECK(quiet.err.empty());

  // As many threads as the SLURM task was given, and no more than there are cores.
  const auto threads_given = [&](const char* cpus) {
    const Outcome slurm = run_cli::cvmesh(
        {"mesh", input, "--out", (folder / "out").string(), "--force", "--surface-only"},
        {.environment = {{"SLURM_CPUS_PER_TASK", cpus}}});
    CHECK(slurm.exit_code == 0);
    return read_json(folder / "out/a.metrics.json")["timings"]["threads"].get<unsigned>();
  };
  CHECK(threads_given("1") == 1);
  CHECK(threads_given("4096") <= std::thread::hardware_concurrency());
}

TEST_CASE("cvmesh: a word that is no command is named", "[cli]") {
  for (const char* word : {"mehs", "scan.nii.gz"}) {
    const Outcome outcome = run_cli::cvmesh({word, "--out", "x"});
    CHECK(outcome.exit_code == 2);
    CHECK(contains(outcome.err, "cvmesh: error: command line: '" + std::string(word) +
                                    "' is none of the commands mesh, metrics, "));
  }
}

TEST_CASE("cvmesh mesh: --formats chooses the files of the tets", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const auto mesh = [&](const std::vector<std::string>& more) {
    Words words = {"mesh", "--force", "--out", (folder / "out").string()};
    words.insert(words.end(), more.begin(), more.end());
    words.push_back((folder / "a.nii").string());
    return run_cli::cvmesh(words);
  };
  const auto written = [&] {
    Words suffixes;
    for (const char* suffix : {".vtu", ".mesh", ".inp", ".surface.vtp", ".metrics.json"})
      if (fs::exists(folder / (std::string("out/a") + suffix))) suffixes.emplace_back(suffix);
    return suffixes;
  };
  for (const char* names : {"obj", "vtu,obj", ""}) {
    const Outcome unknown = mesh({"--formats", names});
    INFO(unknown.err);
    CHECK(unknown.exit_code == 2);
    for (const char* known : {"--formats", "inp", "mesh", "vtu"})
      CHECK(contains(unknown.err, known));
  }
  CHECK(mesh({"--formats", "inp", "--surface-only"}).exit_code == 2);
  CHECK_FALSE(fs::exists(folder / "out"));

  CHECK(mesh({"--formats", "inp"}).exit_code == 0);
  CHECK(written() == Words{".inp", ".surface.vtp", ".metrics.json"});
  CHECK(mesh({"--formats", "inp,VTU"}).exit_code == 0);
  CHECK(written() == Words{".vtu", ".inp", ".surface.vtp", ".metrics.json"});
  CHECK(mesh({}).exit_code == 0);
  CHECK(written() == Words{".vtu", ".mesh", ".surface.vtp", ".metrics.json"});

  // Somebody's own deck is no result of an earlier run.
  image_files::write_file(folder / "out/a.inp", "** my job\n*INCLUDE, INPUT=mesh.inp\n");
  CHECK(mesh({}).exit_code == 0);
  CHECK(written() == Words{".vtu", ".mesh", ".inp", ".surface.vtp", ".metrics.json"});
}

TEST_CASE("cvmesh mesh: SIGTERM ends the run with 128+15 and leaves no mesh", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(45));
  run_cli::Process process({"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(),
                            "--set", "epsilon=0.3"});
  for (int wait = 0; wait < 200 && !fs::exists(folder / "out"); ++wait)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  process.send_signal(SIGTERM);
  const Outcome outcome = process.wait();
  INFO(outcome.err);
  CHECK(outcome.exit_code == 128 + SIGTERM);
  check_nothing_written(folder / "out");
}
