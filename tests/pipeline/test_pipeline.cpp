// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/pipeline/stage_names.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <vector>

using namespace cvmesh;
namespace fs = std::filesystem;

namespace {

/// Records what a progress sink is told.
class Recorder : public ProgressSink {
 public:
  std::vector<std::string> begun, ended, faults;

  void begin(std::string_view stage) override {
    begun.emplace_back(stage);
    last_ = 0;
  }

  void advance(std::string_view stage, double fraction) override {
    if (stage != begun.back() || fraction < last_ || fraction > 1)
      faults.push_back(std::string(stage) + " at " + std::to_string(fraction) + " after " +
                       std::to_string(last_) + " of " + begun.back());
    last_ = fraction;
  }

  void end(std::string_view stage, double seconds, std::string_view summary) override {
    ended.emplace_back(stage);
    if (seconds < 0 || summary.empty()) faults.push_back(std::string(stage) + " ended badly");
  }

 private:
  double last_ = 0;
};

RunRequest request_for(const fs::path& input, const fs::path& out) {
  RunRequest request;
  request.input = input;
  request.out_dir = out;
  request.force = true;  // many tests run more than once into one folder
  request.parameters.sizing.epsilon = 1.5;
  return request;
}

std::string bytes_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

TEST_CASE("input_stem: takes off the suffixes of all formats", "[pipeline][unit]") {
  CHECK(input_stem("/data/a.nii.gz") == "a");
  CHECK(input_stem("a.nii") == "a");
  CHECK(input_stem("a.b.mha") == "a.b");
  CHECK(input_stem("x/a.nrrd") == "a");
}

TEST_CASE("run_pipeline: every stage runs once, in order, and reports its progress",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(5, 9));
  Recorder recorder;
  StageContext context = silent_context();
  context.progress = &recorder;
  const RunResult result = run_pipeline(request_for(folder / "a.nii", folder / "out"), context);

  using namespace stage_names;
  const std::vector<std::string> expected = {
      kRead,         kLabels,        kLevelSets, kTightening, kDenseSurfaces, kMedialAxis,
      kSizingField,  kSeedParticles, kParticles, kInsertion,  kDecimation,    kVertexFit,
      kEdgeFlipping, kTetrahedra,    kMetrics,   kWrite};
  CHECK(recorder.begun == expected);
  CHECK(recorder.ended == expected);
  CHECK(recorder.faults == std::vector<std::string>{});
  CHECK(result.report.timings.size() == expected.size());
  CHECK(names_in(folder / "out") ==
        std::vector<std::string>{"a.mesh", "a.metrics.json", "a.surface.vtp", "a.vtu"});
  CHECK(result.files.back().filename() == "a.metrics.json");

  const auto json = read_json(folder / "out" / "a.metrics.json");
  CHECK(json["status"] == "success");
  CHECK(json["results"]["checks"]["tets_are_valid"] == true);
  CHECK(json["results"]["labels"].size() == 2);
  for (const auto& label : json["results"]["labels"]) {
    INFO(label.dump());
    CHECK(label["tets"] > 0);
    // About 36 vertices on the inner ball: even the regular sphere of 42 loses 13 % to its chords.
    CHECK(std::abs(label["volume"]["relative_error"].get<double>()) < 0.25);
    CHECK(label["topology"]["mesh"]["components"] == 1);
  }
}

TEST_CASE("run_pipeline: the sequential schedule tells what it took to conform the boundaries",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(9, 15));
  Recorder recorder;
  StageContext context = silent_context();
  context.progress = &recorder;
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  request.parameters.schedule = Schedule::Sequential;
  run_pipeline(request, context);
  const auto place = std::find(recorder.begun.begin(), recorder.begun.end(), "edge conformity");
  REQUIRE(place != recorder.begun.end());
  CHECK(*(place - 1) == stage_names::kDecimation);
  CHECK(*(place + 1) == stage_names::kVertexFit);
  CHECK(recorder.faults == std::vector<std::string>{});

  const auto json = read_json(folder / "out" / "a.metrics.json");
  CHECK(json["parameters"]["schedule"] == "sequential");
  CHECK(json["results"]["checks"]["surface_intersections"] == 0);
  const auto& conformity = json["results"]["stages"]["edge_conformity"];
  INFO(conformity.dump());
  CHECK(conformity["passes"] == 2);
  CHECK(conformity["edges_differing"] > 0);
  CHECK(conformity["flips"] >= conformity["edges_differing"]);
  CHECK(conformity["edges_not_flippable"] == 0);
  REQUIRE(conformity["pairs"].size() == 2);
  std::size_t differing = 0, edges = 0;
  for (const auto& pair : conformity["pairs"]) {
    CHECK(pair["slave_label"] == 2);  // the shell; the exterior and the core have smaller labels
    CHECK(pair["master_label"] == (edges == 0 ? 0 : 1));
    differing += pair["edges_differing"].get<std::size_t>();
    edges += pair["edges"].get<std::size_t>();
  }
  CHECK(conformity["edges_differing"] == differing);
  CHECK(conformity["edges"] == edges);
  // Closed surfaces of triangles: E = 3 F / 2.
  CHECK(2 * edges == 3 * json["results"]["mesh"]["surface_triangles"].get<std::size_t>());

  request.out_dir = folder / "lock-step";
  request.parameters.schedule = Schedule::LockStep;
  run_pipeline(request, silent_context());
  const auto other = read_json(folder / "lock-step" / "a.metrics.json");
  CHECK_FALSE(other["results"]["stages"].contains("edge_conformity"));
  CHECK(other["results"]["mesh"]["surface_vertices"] ==
        json["results"]["mesh"]["surface_vertices"]);
}

TEST_CASE(
    "run_pipeline: where boundaries do not agree, the sequential schedule says so and writes "
    "nothing",
    "[pipeline][unit]") {
  // Balls that squeeze each other meet at small angles: in some of these, boundaries that were
  // thinned out apart cross, or put one edge on two interfaces. Which ones is a matter of chance;
  // lock-step meshes all.
  const test_data::TemporaryFolder folder;
  int failures = 0;
  for (const std::uint64_t seed : {3, 10, 17, 26}) {
    CAPTURE(seed);
    write_volume_file(folder / "a.nii", phantoms::random_blobs(seed, 5));
    RunRequest request = request_for(folder / "a.nii", folder / std::to_string(seed));
    request.surface_only = true;
    request.parameters.sizing.epsilon = 2;
    request.parameters.schedule = Schedule::Sequential;
    try {
      run_pipeline(request, silent_context());
    } catch (const Error& error) {
      ++failures;
      CHECK(error.code() == ErrorCode::StageFailed);
      CHECK(error.stage() == stage_names::kEdgeConformity);
      CHECK_THAT(error.message(), Catch::Contains("the first between"));
      CHECK_THAT(error.message(),
                 Catch::Contains(" mm in RAS space; set schedule to \"lock-step\""));
      CHECK(names_in(request.out_dir) == std::vector<std::string>{"a.failed.json"});
      const auto json = read_json(request.out_dir / "a.failed.json");
      CHECK(json["results"]["stages"]["edge_conformity"]["edges_differing"] > 0);
    }
    request.parameters.schedule = Schedule::LockStep;
    CHECK_NOTHROW(run_pipeline(request, silent_context()));
  }
  CHECK(failures > 0);
}

TEST_CASE("run_pipeline: stages are kept on demand", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.keep_stages = true;
  request.surface_only = true;
  run_pipeline(request, silent_context());
  CHECK(names_in(folder / "out") ==
        std::vector<std::string>{"a.metrics.json", "a.stages", "a.surface.vtp"});
  CHECK(names_in(folder / "out/a.stages") ==
        std::vector<std::string>{"augmented.off", "dense.off", "medial_axis.vtp", "particles.vtp",
                                 "sizing_field.vtp", "sparse.off"});
}

TEST_CASE("run_pipeline: thick slices on a finer working grid stay where they are",
          "[pipeline][unit]") {
  // A ball of 8 mm in slices of 3 mm, turned and moved in the world. What is written is in the
  // world, what is measured against the voxels of the file.
  const test_data::TemporaryFolder folder;
  InputVolume volume = phantoms::ball(8, {1, 1, 3});
  const double c = std::cos(0.4), s = std::sin(0.4);
  const Affine turn{{Vec3{c, -s, 0}, Vec3{s, c, 0}, Vec3{0, 0, 1}}, {30, -20, 10}};
  const Affine before = volume.frame.index_to_world;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      volume.frame.index_to_world.rows[i][j] = turn.rows[i].x * before.rows[0][j] +
                                               turn.rows[i].y * before.rows[1][j] +
                                               turn.rows[i].z * before.rows[2][j];
  volume.frame.index_to_world.offset = turn(before.offset);
  write_volume_file(folder / "a.nii", volume);

  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.parameters.sizing.epsilon = 0.25;
  request.parameters.grid_spacing_mm = GridSpacing{.is_auto = true};
  const Report report = run_pipeline(request, silent_context()).report;
  REQUIRE(report.stages.resampling);
  CHECK(report.stages.resampling->spacing_mm.z == Approx(1).margin(0.05));
  CHECK(report.checks->topology_as_lattice14);
  CHECK(report.checks->tets_are_valid == true);
  CHECK(std::abs(report.volumes[1].relative_error) < 0.1);
  CHECK(report.distances->to_labels.overall.voxels.mean_symmetric() < 0.4);

  // The vertices of the mesh lie around the ball's centre in the world.
  std::ifstream mesh(folder / "out" / "a.mesh");
  std::string word;
  while (mesh >> word && word != "Vertices") {
  }
  std::size_t count = 0;
  mesh >> count;
  REQUIRE(count > 100);
  Vec3 lo{1e9, 1e9, 1e9}, hi{-1e9, -1e9, -1e9};
  for (std::size_t n = 0; n < count; ++n) {
    Vec3 p;
    int reference = 0;
    mesh >> p.x >> p.y >> p.z >> reference;
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = std::min(lo[axis], p[axis]);
      hi[axis] = std::max(hi[axis], p[axis]);
    }
  }
  const Vec3 centre{30, -20, 10};
  for (int axis = 0; axis < 3; ++axis) {
    CHECK(0.5 * (lo[axis] + hi[axis]) == Approx(centre[axis]).margin(0.3));
    CHECK(hi[axis] - lo[axis] == Approx(16).margin(1.2));
  }
}

TEST_CASE("run_pipeline: boxes count voxels of the input, whatever the working grid",
          "[pipeline][unit]") {
  // A ball of 9 mm around the world origin, the voxels around it cut off by the crop.
  const test_data::TemporaryFolder folder;
  const InputVolume volume = phantoms::ball(9, {1, 1, 2});
  write_volume_file(folder / "a.nii", volume);
  const auto& dims = volume.frame.dims;
  const auto check_run = [&](const RunRequest& request, double face_mm) {
    run_pipeline(request, silent_context());
    std::ifstream mesh(folder / "out" / "a.mesh");
    std::string word;
    while (mesh >> word && word != "Vertices") {
    }
    std::size_t count = 0;
    mesh >> count;
    std::size_t inside = 0, outside = 0;  // within 2 mm of the face of the box
    for (std::size_t n = 0; n < count; ++n) {
      Vec3 p;
      int reference = 0;
      mesh >> p.x >> p.y >> p.z >> reference;
      inside += p.z > face_mm && p.z < face_mm + 2 ? 1 : 0;
      outside += p.z < face_mm - 0.5 && p.z > face_mm - 2.5 ? 1 : 0;
    }
    CHECK(inside > 10 * outside);
  };
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.parameters.sizing.delta = 10;  // the step shows where the box is
  // The upper part, from 2 voxels above the middle on: its lower face lies at 1.5 voxels.
  const int first = dims[2] / 2 + 2;
  request.parameters.boxes = {
      {.box = {{0, 0, first}, {dims[0] - 1, dims[1] - 1, dims[2] - 1}}, .max_edge_mm = 0.7}};
  const double face_mm = 2 * 1.5;
  check_run(request, face_mm);
  request.parameters.clean_labels.region_of_interest =
      VoxelBox{{3, 4, 5}, {dims[0] - 3, dims[1] - 4, dims[2] - 3}};
  check_run(request, face_mm);
  request.parameters.clean_labels.region_of_interest = {};
  request.parameters.grid_spacing_mm = GridSpacing{.mm = 0.8};
  check_run(request, face_mm);
}

TEST_CASE("run_pipeline: guards of specks are told from those of larger parts",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  const auto counts_for = [&](const InputVolume& volume) {
    write_volume_file(folder / "a.nii", volume);
    RunRequest request = request_for(folder / "a.nii", folder / "out");
    request.surface_only = true;
    request.parameters.sizing.epsilon = 5;
    return *run_pipeline(request, silent_context()).report.particle_counts;
  };
  // Rings, whose handles need guards: 16 voxels around nine, and a large one.
  const InputVolume ring =
      phantoms::sample(phantoms::centred_frame({15, 15, 15}), [](const Vec3& p) -> Label {
        const double x = std::abs(p.x), y = std::abs(p.y);
        return std::abs(p.z) < 0.5 && std::max(x, y) < 2.5 && std::max(x, y) > 1.5 ? 1 : 0;
      });
  const ParticleCounts speck = counts_for(ring);
  CHECK(speck.guards > 0);
  CHECK(speck.guards_of_specks == speck.guards);
  const ParticleCounts larger = counts_for(phantoms::torus(9, 3));
  CHECK(larger.guards > 0);
  CHECK(larger.guards_of_specks == 0);
}

TEST_CASE("run_pipeline: elements of second order follow the dense surface on request",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(6, 11));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.parameters.sizing.epsilon = 3;
  request.parameters.element_order = 2;
  const SecondOrderStats straight =
      *run_pipeline(request, silent_context()).report.stages.second_order;
  CHECK(straight.moved == 0);
  CHECK(straight.least_jacobian == Approx(1));
  const auto warnings = [&] {
    return read_json(folder / "out" / "a.metrics.json")["results"]["warnings"].dump();
  };
  CHECK_THAT(warnings(), Catch::Contains("element_order is 2, but .mesh files hold the corners"));
  request.formats = {MeshFormat::Vtu};
  request.parameters.curved_elements = true;
  const RunResult curved = run_pipeline(request, silent_context());
  const SecondOrderStats& stats = *curved.report.stages.second_order;
  CHECK(stats.mid_nodes == straight.mid_nodes);
  CHECK(stats.moved > 100);
  CHECK(stats.least_jacobian >= 0.1);
  const auto json = read_json(folder / "out" / "a.metrics.json");
  CHECK(json["results"]["stages"]["second_order_nodes"]["moved"] == stats.moved);
  CHECK(json["parameters"]["element_order"] == 2);
  CHECK_THAT(warnings(), !Catch::Contains("element_order"));
}

TEST_CASE("run_pipeline: target_vertices is met within two percent", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(12));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  request.parameters.target_vertices = 400;
  const Report report = run_pipeline(request, silent_context()).report;
  REQUIRE(report.stages.epsilon_search);
  CHECK(std::abs(static_cast<double>(report.particle_counts->total) - 400) <= 8);
  CHECK(report.stages.epsilon_search->target == "target_vertices");
  CHECK(report.stages.epsilon_search->reached == double(report.particle_counts->total));
  CHECK(report.stages.epsilon_search->epsilon > 0);
  // The first search ends within a quarter of that, on the field that the particles follow.
  REQUIRE(report.stages.epsilon_search->rounds == 1);
  CHECK(std::abs(report.stages.sizing_field->expected_vertices - 400) <= 2);
}

TEST_CASE("run_pipeline: specks that need more than target_vertices keep only what they need",
          "[pipeline][unit]") {
  // Specks of eight voxels, six apart, in a ball.
  const test_data::TemporaryFolder folder;
  const auto speck_middle = [](double x) { return 6 * std::floor(x / 6) + 1; };
  int speck_voxels = 0;
  const auto label_at = [&](const Vec3& p) -> Label {
    if (norm(p) > 18) return 0;
    const Vec3 middle{speck_middle(p.x), speck_middle(p.y), speck_middle(p.z)};
    const Vec3 d = p - middle;
    if (norm(middle) > 13 || d.x > 1 || d.y > 1 || d.z > 1) return 1;
    ++speck_voxels;
    return 2;
  };
  write_volume_file(folder / "a.nii",
                    phantoms::sample(phantoms::centred_frame({44, 44, 44}), label_at));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  const auto search = [&](std::size_t target) {
    request.parameters.target_vertices = target;
    return *run_pipeline(request, silent_context()).report.stages.epsilon_search;
  };
  REQUIRE(speck_voxels > 0);
  REQUIRE(speck_voxels % 8 == 0);
  const double needed = 12 * speck_voxels / 8;  // vertices of a closed boundary
  const EpsilonSearch below = search(100);
  CHECK(below.rounds == 1);  // further ones would find as much
  CHECK(below.reached >= needed);
  CHECK(below.reached <= needed + 2 * 100);
  const EpsilonSearch above = search(static_cast<std::size_t>(2 * needed));
  CHECK(above.reached == Approx(2 * needed).epsilon(0.02));
}

TEST_CASE("run_pipeline: a wanted number of vertices goes where it lowers the distance",
          "[pipeline][unit]") {
  // a large ball and a small one: the local feature size gives both as many vertices, though the
  // large one has most of the surface
  const test_data::TemporaryFolder folder;
  write_volume_file(
      folder / "a.nii",
      phantoms::sample(phantoms::centred_frame({63, 45, 45}), [](const Vec3& p) -> Label {
        return distance(p, {-9, 0, 0}) < 18 ? 1 : distance(p, {20, 0, 0}) < 6 ? 2 : 0;
      }));
  std::map<TargetSizes, Report> reports;
  for (const auto sizes : {TargetSizes::Deviation, TargetSizes::FeatureSize}) {
    RunRequest request = request_for(folder / "a.nii", folder / "out");
    request.surface_only = true;
    request.parameters.target_vertices = 500;
    request.parameters.target_sizes = sizes;
    reports[sizes] = run_pipeline(request, silent_context()).report;
    CHECK(std::abs(static_cast<double>(reports[sizes].particle_counts->total) - 500) <= 10);
  }
  const auto mean = [&](TargetSizes sizes) {
    return reports[sizes].distances->to_dense->overall.voxels.mean_symmetric();
  };
  CHECK(mean(TargetSizes::Deviation) < 0.8 * mean(TargetSizes::FeatureSize));
  // with the feature size, the number found is the epsilon to give next time
  CHECK(reports[TargetSizes::FeatureSize].stages.epsilon_search->epsilon > 0.3);
}

TEST_CASE("run_pipeline: the tolerance of decimation grows with the edges of sparse meshes only",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(24));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  const auto stages_at = [&](double epsilon, std::optional<double> given) {
    request.parameters.sizing.epsilon = epsilon;
    request.parameters.deviation_vox = given;
    return run_pipeline(request, silent_context()).report.stages;
  };
  CHECK(stages_at(0.25, {}).decimation->deviation_vox == 0.5);
  CHECK(stages_at(1, 0.3).decimation->deviation_vox == 0.3);
  const StageResults sparse = stages_at(1, {});
  CHECK(sparse.decimation->deviation_vox > 0.5);
  CHECK(sparse.decimation->deviation_vox <= sparse.sizing_field->h_max_mm / 12);
}

TEST_CASE("run_pipeline: target_tets is met within five percent", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(12));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.parameters.target_tets = 4000;
  const Report report = run_pipeline(request, silent_context()).report;
  REQUIRE(report.stages.epsilon_search);
  CHECK(report.stages.epsilon_search->target == "target_tets");
  CHECK(report.stages.epsilon_search->reached == double(report.mesh->tets));
  CHECK(std::abs(static_cast<double>(report.mesh->tets) - 4000) <= 200);
  // The numbers of all stages are those of the mesh that was written.
  CHECK(report.particle_counts->total == report.mesh->surface_vertices);

  request.surface_only = true;
  CHECK_THROWS_WITH(run_pipeline(request, silent_context()),
                    Catch::Contains("target_tets (4000)") && Catch::Contains("surface"));
}

TEST_CASE("run_pipeline: target_tets below what small parts take ends after one round",
          "[pipeline][unit]") {
  // Specks of one voxel, whose topology takes more tets than are wanted at any size.
  const test_data::TemporaryFolder folder;
  const auto is_multiple_of_3 = [](double x) { return std::lround(x) % 3 == 0; };
  write_volume_file(
      folder / "a.nii", phantoms::sample(phantoms::centred_frame({11, 11, 11}), [&](const Vec3& p) {
        return is_multiple_of_3(p.x) && is_multiple_of_3(p.y) && is_multiple_of_3(p.z) ? 1 : 0;
      }));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.parameters.target_tets = 50;
  const Report report = run_pipeline(request, silent_context()).report;
  REQUIRE(report.stages.epsilon_search);
  CHECK(report.stages.epsilon_search->rounds == 1);
  CHECK(report.mesh->tets >= 27 * 4);
  CHECK(std::any_of(report.warnings.begin(), report.warnings.end(), [](const std::string& w) {
    return w.find("target_tets (50) was not reached") != std::string::npos;
  }));
}

TEST_CASE("run_pipeline: max_distance holds everywhere, in voxels and in mm", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(14));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  std::size_t vertices = 0;
  for (const double limit : {0.8, 0.4, 0.15}) {
    CAPTURE(limit);
    request.parameters.max_distance_vox = limit;
    const Report report = run_pipeline(request, silent_context()).report;
    REQUIRE(report.stages.epsilon_search);
    CHECK(report.stages.epsilon_search->reached <= limit);
    CHECK(report.distances->to_dense->overall.voxels.hausdorff_lower_bound() <= limit * 1.02);
    // Coarser than needed nowhere, but not much finer either: the sagitta is that of the limit.
    CHECK(report.distances->to_dense->overall.voxels.hausdorff_lower_bound() > limit / 3);
    CHECK(report.mesh->surface_vertices > vertices);
    vertices = report.mesh->surface_vertices;
  }
  request.parameters.max_distance_vox = {};
  request.parameters.max_distance_mm = 0.4;
  const Report in_mm = run_pipeline(request, silent_context()).report;
  CHECK(in_mm.stages.epsilon_search->target == "max_distance_mm");
  CHECK(in_mm.distances->to_dense->overall.mm.hausdorff_lower_bound() <= 0.4 * 1.02);

  // The edges that the user forbids stay forbidden, and the report says what is left.
  request.parameters.max_distance_mm = 0.1;
  request.parameters.sizing.min_edge_mm = 4;
  const Report coarse = run_pipeline(request, silent_context()).report;
  CHECK(coarse.stages.sizing_field->h_min_mm >= 4 - 1e-6);
  CHECK(coarse.stages.epsilon_search->reached > coarse.stages.epsilon_search->wanted);
}

TEST_CASE("run_pipeline: a failed run leaves its failure file only, a success removes it",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  RunRequest request = request_for(folder / "a.nii", folder / "out");
  request.surface_only = true;
  run_pipeline(request, silent_context());
  CHECK(fs::exists(folder / "out/a.metrics.json"));

  RunRequest bad = request;
  bad.keep_stages = true;
  bad.parameters.clean_labels.drop_labels = {77};
  CHECK_THROWS_AS(run_pipeline(bad, silent_context()), Error);
  CHECK(names_in(folder / "out") == std::vector<std::string>{"a.failed.json"});
  const auto failure = read_json(folder / "out/a.failed.json");
  CHECK(failure["code"] == "BadParameter");
  CHECK(failure["message"].get<std::string>().find("77") != std::string::npos);

  run_pipeline(request, silent_context());
  CHECK(names_in(folder / "out") == std::vector<std::string>{"a.metrics.json", "a.surface.vtp"});
}

TEST_CASE("run_pipeline: a cancel ends the run and leaves no mesh", "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const std::atomic<bool> cancel = true;
  StageContext context = silent_context();
  context.cancel = &cancel;
  try {
    run_pipeline(request_for(folder / "a.nii", folder / "out"), context);
    FAIL("the run was not cancelled");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Limit);
  }
  CHECK(names_in(folder / "out") == std::vector<std::string>{"a.failed.json"});
}

TEST_CASE("run_pipeline: one, two and eight threads write the same bytes",
          "[pipeline][determinism]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::four_material_corner(9));
  const auto schedule = GENERATE(Schedule::LockStep, Schedule::Sequential);
  std::map<std::string, std::string> first;
  for (const std::size_t threads : {1U, 2U, 8U}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    tbb::task_arena arena(static_cast<int>(threads));
    const fs::path out = folder / std::to_string(threads);
    RunRequest request = request_for(folder / "a.nii", out);
    request.parameters.schedule = schedule;
    arena.execute([&] { run_pipeline(request, silent_context()); });
    for (const char* name : {"a.vtu", "a.mesh", "a.surface.vtp"}) {
      INFO(name << " with " << threads << " threads");
      const std::string bytes = bytes_of(out / name);
      CHECK_FALSE(bytes.empty());
      const bool is_equal = first.try_emplace(name, bytes).first->second == bytes;
      CHECK(is_equal);
    }
    auto json = read_json(out / "a.metrics.json");
    json.erase("timings");
    const bool is_equal = first.try_emplace("results", json.dump()).first->second == json.dump();
    CHECK(is_equal);
  }
}
