// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"
#include "cvmesh/pipeline/pipeline.h"

#include <nlohmann/json.hpp>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <filesystem>
#include <memory>
#include <sstream>

using namespace cvmesh;
namespace fs = std::filesystem;

namespace {

struct Outcome {
  Report report;
  std::string log;
  nlohmann::ordered_json json;
};

/// Meshes `volume`, and gives what the log and the report file say.
Outcome run(const InputVolume& volume, double epsilon, SurfaceMethod surface, bool surface_only) {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", volume);
  RunRequest request;
  request.input = folder / "a.nii";
  request.out_dir = folder / "out";
  request.parameters.sizing.epsilon = epsilon;
  request.parameters.surface = surface;
  request.surface_only = surface_only;
  std::ostringstream stream;
  StageContext context;
  context.log = std::make_shared<spdlog::logger>(
      "test", std::make_shared<spdlog::sinks::ostream_sink_mt>(stream));
  Outcome outcome;
  outcome.report = run_pipeline(request, context).report;
  outcome.log = stream.str();
  outcome.json = read_json(folder / "out/a.metrics.json");
  CHECK(fs::exists(folder / "out/a.surface.vtp"));
  CHECK(fs::exists(folder / "out/a.vtu") == !surface_only);
  return outcome;
}

}  // namespace

TEST_CASE("run_pipeline: the Delaunay baseline loses the topology that decimation keeps",
          "[pipeline][unit]") {
  // A plate of two voxels; with edges of many voxels, no circumcentre need be inside it.
  const InputVolume plate = phantoms::thin_plate(2, 20);
  const Outcome ours = run(plate, 5, SurfaceMethod::Decimation, false);
  CHECK(ours.report.checks->topology_as_lattice14);
  CHECK_FALSE(ours.json["results"].contains("is_baseline"));
  CHECK(ours.log.find("baseline") == std::string::npos);

  const Outcome baseline = run(plate, 5, SurfaceMethod::Delaunay, false);
  INFO(baseline.log);
  CHECK_FALSE(baseline.report.checks->topology_as_lattice14);
  CHECK(baseline.json["results"]["is_baseline"] == true);
  CHECK(baseline.json["results"]["checks"]["topology_as_lattice14"] == false);
  CHECK(baseline.json["results"]["labels"][0]["topology"]["mesh"].contains("nonmanifold_edges"));
  CHECK(baseline.json["results"]["stages"]["delaunay_tetrahedra"]["particles"] ==
        baseline.json["results"]["particles"]["total"]);
  CHECK(baseline.log.find("this mesh is a baseline") != std::string::npos);
  CHECK(baseline.log.find("Delaunay tetrahedra: label 1 (label_1) ") != std::string::npos);
}

TEST_CASE(
    "run_pipeline: the Delaunay baseline of a dense sampling is as valid as the method's mesh",
    "[pipeline][unit]") {
  const InputVolume ball = phantoms::ball(10);
  for (const bool surface_only : {false, true}) {
    const Outcome baseline = run(ball, 0.3, SurfaceMethod::Delaunay, surface_only);
    INFO(baseline.log);
    CHECK(baseline.report.checks->surface_is_valid);
    CHECK(baseline.report.checks->topology_as_lattice14);
    CHECK(baseline.report.checks->surface_intersections == 0);
    CHECK(baseline.report.checks->tets_are_valid.has_value() == !surface_only);
    CHECK(baseline.report.distances->to_dense->overall.voxels.mean_symmetric() < 0.1);
    CHECK(baseline.log.find("label 1") == std::string::npos);
  }
}
