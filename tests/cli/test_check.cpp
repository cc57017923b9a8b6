// SPDX-License-Identifier: AGPL-3.0-or-later
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
#include <numbers>
#include <thread>

using namespace cvmesh;
using run_cli::Outcome;

TEST_CASE("cvmesh check: tells labels and a forecast, and writes nothing", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(4, 12, {0.5, 0.5, 0.5}));
  const std::string input = (folder / "a.nii").string();
  const Outcome text =
      run_cli::cvmesh({"check", input, "--set", "labels.2.name=shell", "--threads", "2"});
  CHECK(text.exit_code == 0);
  CHECK(text.err.empty());
  for (const char* part : {"a.nii: ", "shell", "thinnest", "expected: ", "on 2 threads"})
    CHECK_THAT(text.out, Catch::Contains(part));

  const Outcome json = run_cli::cvmesh({"check", input, "--json"});
  REQUIRE(json.exit_code == 0);
  const auto checked = nlohmann::json::parse(json.out);
  CHECK(checked["warnings"].empty());
  CHECK(checked["space"] == "RAS");
  REQUIRE(checked["labels"].size() == 2);
  const auto& core = checked["labels"][0];
  CHECK(core["label"] == 1);
  CHECK(core["components"] == 1);
  CHECK(core["volume_mm3"] == Approx(4 * std::numbers::pi / 3 * 64).epsilon(0.03));
  // A ball of radius 4 is 8 thick, a shell between 4 and 12 too, within a voxel on each side and
  // one between the two voxel centres at a ridge.
  CHECK(core["thinnest_mm"] == Approx(8).margin(1.5));
  CHECK(checked["labels"][1]["thinnest_mm"] == Approx(8).margin(1.5));
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("cvmesh check: what names labels and boxes is looked up", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(4, 12, {0.5, 0.5, 0.5}));
  const std::string input = (folder / "a.nii").string();
  const auto refusal = [&](const std::string& setting) {
    const Outcome outcome = run_cli::cvmesh({"check", input, "--set", setting});
    CHECK(outcome.exit_code == 2);
    return outcome.err;
  };
  CHECK_THAT(refusal("contact=[[1,9]]"), Catch::Contains("contact names \"9\""));
  CHECK_THAT(refusal("boxes=[{\"box\":[0,0,0,99,9,9],\"epsilon\":1}]"),
             Catch::Contains("boxes[0].box reaches i = 99"));
  image_files::write_file(folder / "names.ctbl", "1 core 0 0 255 255\n2 shell 255 0 0 255\n");
  CHECK(run_cli::cvmesh({"check", input, "--set", "contact=[[\"core\",\"shell\"]]", "--label-names",
                         (folder / "names.ctbl").string()})
            .exit_code == 0);
  const Outcome absent = run_cli::cvmesh({"check", input, "--set", "labels.7.epsilon=1"});
  CHECK(absent.exit_code == 0);
  CHECK_THAT(absent.out, Catch::Contains("label 7 has a radius or sizes"));
}

TEST_CASE("cvmesh check: the forecast of facets is exact, others follow the parameters", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::random_blobs(3, 6));
  const std::string input = (folder / "a.nii").string();
  const auto forecast = [&](const std::string& setting) {
    const Outcome outcome = run_cli::cvmesh({"check", input, "--json", "--set", setting});
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    return nlohmann::json::parse(outcome.out)["forecast"];
  };
  // At larger epsilon the many small parts keep their 12 vertices each.
  const auto fine = forecast("epsilon=0.5"), coarse = forecast("epsilon=1");
  CHECK(fine["surface_vertices"] > 1.5 * coarse["surface_vertices"].get<double>());
  CHECK(forecast("target_vertices=1234")["surface_vertices"] == 1200);
  CHECK(forecast("max_distance_vox=0.05")["surface_vertices"] > fine["surface_vertices"]);

  REQUIRE(run_cli::cvmesh({"mesh", input, "--out", (folder / "out").string(), "--surface-only"})
              .exit_code == 0);
  const auto metrics = nlohmann::json::parse(image_files::read_file(folder / "out/a.metrics.json"));
  CHECK(fine["dense_facets"] == metrics["results"]["stages"]["dense_surfaces"]["facets"]);
}

TEST_CASE("cvmesh check: SIGTERM ends it", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(60));
  run_cli::Process process({"check", (folder / "a.nii").string()});
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  process.send_signal(SIGTERM);
  const Outcome outcome = process.wait();
  CHECK(outcome.exit_code == 128 + SIGTERM);
  CHECK(outcome.out.empty());
}

TEST_CASE("cvmesh check: warnings of the header are told, and bad files refused", "[cli]") {
  const test_data::TemporaryFolder folder;
  image_files::Nifti odd;
  odd.qform_code = 1;
  odd.q_offset = {5, 0, 0};
  odd.voxels = image_files::bytes_of_all(image_files::counting<std::uint8_t>());
  image_files::write_file(folder / "odd.nii", odd.bytes());
  const Outcome warned = run_cli::cvmesh({"check", (folder / "odd.nii").string()});
  CHECK(warned.exit_code == 0);
  CHECK_THAT(warned.out, Catch::Contains("warning: the s-form and the q-form"));

  image_files::Nifti movie;
  movie.dim = {4, 4, 3, 2, 2, 1, 1, 1};
  movie.voxels = image_files::bytes_of_all(image_files::counting<std::uint8_t>(48));
  image_files::write_file(folder / "movie.nii", movie.bytes());
  const std::string input = (folder / "movie.nii").string();
  const Outcome refused = run_cli::cvmesh({"check", input});
  CHECK(refused.exit_code == 3);
  CHECK_THAT(refused.err, Catch::Contains("--volume, 0 to 1"));
  CHECK(run_cli::cvmesh({"check", input, "--volume", "1"}).exit_code == 0);
  CHECK(run_cli::cvmesh({"check", input, "--volume", "2"}).exit_code == 3);
  CHECK(run_cli::cvmesh({"check"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"check", input, "--set", "epsilom=1"}).exit_code == 2);
}
