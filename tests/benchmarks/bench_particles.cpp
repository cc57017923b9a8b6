// SPDX-License-Identifier: AGPL-3.0-or-later
//
// Measures medial axis, sizing field and particles.
//
//   bench_particles shapes
//       local feature size of balls, plates and cylinders of voxels against the truth; number of
//       vertices on a ball
//   bench_particles volume FILE [--epsilon E | --vertices N] [--delta D] [--seeding NAME]
//                   [--sweeps N] [--seed N] [--threads N] [--sparse]
//       one label volume: seconds, how the particles are spread, and (--sparse) the shape of the
//       triangles that they become; one JSON line
//
// No test: nothing here passes or fails. `scripts/bench_particles.py` makes tables of it.
#include "cvmesh/core/timer.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/metrics/tet_quality.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/pipeline/find_epsilon.h"
#include "cvmesh/sizing/compute_sizing_field.h"
#include "cvmesh/surface/decimate.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/surface/insert_particles.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include "levelset/label_grids.h"
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

using namespace cvmesh;

namespace {

struct Options {
  std::string command, file;
  double epsilon = 1, vertices = 0, delta = SizingOptions{}.delta;
  Seeding seeding = SeedParticlesOptions{}.seeding;
  int threads = 0, sweeps = DistributeParticlesOptions{}.max_sweeps;
  std::uint64_t seed = 1;
  bool is_sparse = false;
};

/// What the particle stages start from.
struct Surfaces {
  LevelSets level_sets;
  InterfaceMesh dense;
  Strata strata;
};

Surfaces make_surfaces(std::shared_ptr<const Grid<MaterialId>> ids, std::size_t materials) {
  Surfaces result;
  result.level_sets =
      tighten(build_level_sets(std::move(ids), materials, silent_context()).level_sets, {},
              silent_context())
          .level_sets;
  result.dense = extract_interfaces(result.level_sets, silent_context());
  result.strata = find_strata(result.dense);
  return result;
}

std::vector<double> feature_sizes(const Surfaces& surfaces) {
  const auto axis = extract_medial_axis(surfaces.level_sets, surfaces.dense, surfaces.strata, {},
                                        silent_context());
  return local_feature_size(surfaces.dense, surfaces.strata, axis.medial_axis,
                            surfaces.level_sets.frame().voxel_mm(), silent_context());
}

// ---- shapes -----------------------------------------------------------------------------------

struct Shape {
  std::string name;
  double truth;
  std::array<int, 3> dims;
  std::function<double(const Vec3&)> inside;    ///< signed distance, positive inside, index space
  std::function<bool(const Vec3&)> is_counted;  ///< away from where the shape ends
};

std::vector<Shape> shapes() {
  const Vec3 tilted = normalized(Vec3{0.3, 0.5, 1});
  std::vector<Shape> list;
  for (const double radius : {6.0, 12.0, 20.0}) {
    const int n = 2 * static_cast<int>(radius) + 13;
    const Vec3 c{0.5 * (n - 1) + 0.13, 0.5 * (n - 1) + 0.27, 0.5 * (n - 1) - 0.41};
    list.push_back({"ball, R " + std::to_string(static_cast<int>(radius)),
                    radius,
                    {n, n, n},
                    [=](const Vec3& p) { return radius - distance(p, c); },
                    [](const Vec3&) { return true; }});
  }
  const Vec3 c{32.13, 32.27, 31.59};
  for (const double thickness : {1.0, 2.0, 3.0, 8.0})
    list.push_back({"plate, " + std::to_string(static_cast<int>(thickness)) + " thick",
                    0.5 * thickness,
                    {65, 65, 65},
                    [=](const Vec3& p) {
                      const Vec3 d = p - c;
                      const double z = dot(d, tilted);
                      return std::min(0.5 * thickness - std::abs(z), 24 - norm(d - z * tilted));
                    },
                    [=](const Vec3& p) { return distance(p, c) < 12; }});
  for (const double radius : {2.0, 8.0})
    list.push_back({"cylinder, R " + std::to_string(static_cast<int>(radius)),
                    radius,
                    {65, 65, 65},
                    [=](const Vec3& p) {
                      const Vec3 d = p - c;
                      const double z = dot(d, tilted);
                      return std::min(radius - norm(d - z * tilted), 26 - std::abs(z));
                    },
                    [=](const Vec3& p) { return std::abs(dot(p - c, tilted)) < 13; }});
  return list;
}

double quantile(std::vector<double>& sorted, double part) {
  return sorted[static_cast<std::size_t>(part * static_cast<double>(sorted.size() - 1))];
}

void measure_features() {
  std::printf(
      "| shape, voxels        | truth | median | 5 %%   | 95 %%  |\n|---|---|---|---|---|\n");
  for (const Shape& shape : shapes()) {
    const auto ids = label_grids::shared(label_grids::sample(
        shape.dims, [&](const Vec3& p) { return MaterialId(shape.inside(p) > 0 ? 1 : 0); }));
    const Surfaces surfaces = make_surfaces(ids, 2);
    const auto lfs = feature_sizes(surfaces);
    std::vector<double> values;
    for (std::size_t v = 0; v < lfs.size(); ++v)
      if (shape.is_counted(surfaces.dense.points[v])) values.push_back(lfs[v]);
    std::sort(values.begin(), values.end());
    std::printf("| %-20s | %5.1f | %6.2f | %5.2f | %5.2f |\n", shape.name.c_str(), shape.truth,
                quantile(values, 0.5), quantile(values, 0.05), quantile(values, 0.95));
  }
}

void count_on_ball() {
  const double radius = 40;
  const auto ids = label_grids::shared(label_grids::ball(radius, {0.13, 0.27, -0.41}));
  const Surfaces surfaces = make_surfaces(ids, 2);
  const auto lfs = feature_sizes(surfaces);
  std::printf(
      "\n| ball of R 40, epsilon | vertices | 8 pi / (sqrt 3 epsilon^2) | integral |\n"
      "|---|---|---|---|\n");
  for (const double epsilon : {0.1, 0.25, 0.5, 1.0}) {
    SizingOptions sizing;
    sizing.epsilon = epsilon;
    const SizingResult sized =
        compute_sizing_field(surfaces.dense, surfaces.strata, lfs, *surfaces.level_sets.labels,
                             sizing, silent_context());
    const Sheets sheets({surfaces.dense, surfaces.strata, surfaces.level_sets, sized.sizing_field});
    auto seeds = seed_particles(sheets, {}, silent_context());
    const auto result =
        distribute_particles(std::move(seeds.particles), sheets, {}, silent_context());
    std::printf("| %4.2f | %zu | %.1f | %.1f |\n", epsilon, result.particles.particles.size(),
                8 * M_PI / (std::sqrt(3.0) * epsilon * epsilon), sized.stats.expected_vertices);
  }
}

// ---- one volume -------------------------------------------------------------------------------

void measure_volume(const Options& options) {
  CleanLabelsResult cleaned;
  {
    const InputVolume input = read_label_volume(options.file);
    cleaned = clean_labels(input, {}, silent_context());
  }
  const LabelVolume labels = std::move(cleaned.labels);
  Surfaces surfaces =
      make_surfaces(std::make_shared<const Grid<MaterialId>>(labels.ids), labels.material_count());
  const double voxel_mm = labels.frame().voxel_mm();
  StageContext context = silent_context();
  context.seed = options.seed;
  nlohmann::ordered_json row;
  row["file"] = options.file;

  const Timer medial_timer;
  const auto axis =
      extract_medial_axis(surfaces.level_sets, surfaces.dense, surfaces.strata, {}, context);
  row["medial_axis_s"] = medial_timer.seconds();
  const Timer lfs_timer;
  const auto lfs =
      local_feature_size(surfaces.dense, surfaces.strata, axis.medial_axis, voxel_mm, context);
  row["feature_size_s"] = lfs_timer.seconds();

  SizingOptions sizing;
  sizing.delta = options.delta;
  sizing.epsilon = options.epsilon;
  const SizingProblem problem(surfaces.dense, surfaces.strata, lfs, *surfaces.level_sets.labels);
  const auto size = [&](double epsilon) {
    sizing.epsilon = epsilon;
    return problem.field(sizing, context);
  };
  if (options.vertices > 0)
    sizing.epsilon =
        find_epsilon([&](double epsilon) { return size(epsilon).stats.expected_vertices; },
                     {.target = options.vertices, .start = 1, .tolerance = 0.005, .max_rounds = 12})
            .epsilon;
  const Timer sizing_timer;
  const SizingResult sized = size(sizing.epsilon);
  row["sizing_s"] = sizing_timer.seconds();
  row["epsilon"] = sizing.epsilon;

  const Timer sheets_timer;
  const Sheets sheets({surfaces.dense, surfaces.strata, surfaces.level_sets, sized.sizing_field});
  row["sheets_s"] = sheets_timer.seconds();
  const Timer seed_timer;
  SeedParticlesOptions seed_options;
  seed_options.seeding = options.seeding;
  auto seeds = seed_particles(sheets, seed_options, context);
  row["seeds"] = seeds.particles.particles.size();
  row["seeds_s"] = seed_timer.seconds();
  const Timer particle_timer;
  const auto result = distribute_particles(std::move(seeds.particles), sheets,
                                           {.max_sweeps = options.sweeps}, context);
  row["particles_s"] = particle_timer.seconds();
  row["particles"] = result.particles.particles.size();
  row["sweeps"] = result.stats.sweeps;
  row["edge_over_h_mean"] = result.stats.edge_over_h_mean;
  row["edge_over_h_min"] = result.stats.edge_over_h_min;
  row["edge_over_h_max"] = result.stats.edge_over_h_max;
  row["edge_over_h_sd"] = result.stats.edge_over_h_sd;
  row["nearest_over_h_mean"] = result.stats.nearest_over_h_mean;
  row["six_neighbour_share"] = result.stats.six_neighbour_share;
  row["thinning_rounds"] = result.stats.thinning_rounds;
  row["loop_guards"] = result.stats.loop_guards;
  row["guards"] =
      std::count_if(result.particles.particles.begin(), result.particles.particles.end(),
                    [](const Particle& p) { return p.origin == ParticleOrigin::Guard; });
  row["split"] = result.stats.split;
  row["on_dense_facet"] = result.stats.on_dense_facet;
  row["energy"] = result.stats.energy;
  if (options.is_sparse) {
    InsertParticlesResult inserted =
        insert_particles(MaterialSurfaces(surfaces.dense, labels.material_count()), surfaces.strata,
                         result.particles, voxel_mm, context);
    std::vector<bool> keep(inserted.surfaces.points().size(), false);
    for (const std::int32_t vertex : inserted.vertex_of)
      keep[static_cast<std::size_t>(vertex)] = true;
    DecimateResult decimated = decimate(std::move(inserted.surfaces), keep, voxel_mm, {}, context);
    FlipEdgesResult flipped = flip_edges(std::move(decimated.surfaces), voxel_mm, {}, context);
    const auto quality =
        measure_quality(flipped.surfaces.to_interface_mesh(), labels.material_count());
    const Distribution& shape = quality.triangles.radius_ratio;
    row["kept"] = decimated.stats.kept.size();
    row["off_position"] = inserted.stats.off_position;
    row["shape"] = {{"mean", shape.mean},
                    {"sd", shape.standard_deviation},
                    {"min", shape.min},
                    {"p1", shape.p1}};
  }
  std::printf("%s\n", row.dump().c_str());
}

Options parse(int argc, char** argv) {
  Options options;
  for (int a = 1; a < argc; ++a) {
    const std::string word = argv[a];
    const auto value = [&] { return std::string(a + 1 < argc ? argv[++a] : ""); };
    if (word == "--epsilon")
      options.epsilon = std::stod(value());
    else if (word == "--vertices")
      options.vertices = std::stod(value());
    else if (word == "--delta")
      options.delta = std::stod(value());
    else if (word == "--seeding")
      options.seeding = value() == "dense" ? Seeding::Dense : SeedParticlesOptions{}.seeding;
    else if (word == "--sweeps")
      options.sweeps = std::stoi(value());
    else if (word == "--seed")
      options.seed = std::stoull(value());
    else if (word == "--threads")
      options.threads = std::stoi(value());
    else if (word == "--sparse")
      options.is_sparse = true;
    else if (options.command.empty())
      options.command = word;
    else
      options.file = word;
  }
  return options;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism,
                  static_cast<std::size_t>(options.threads));
  if (options.command == "shapes") {
    measure_features();
    count_on_ball();
  } else if (options.command == "volume" && !options.file.empty()) {
    measure_volume(options);
  } else {
    std::fprintf(stderr,
                 "usage: bench_particles shapes | volume FILE  [--epsilon E | --vertices N] "
                 "[--delta D] [--seeding front|dense] [--sweeps N] [--seed N] [--threads N] "
                 "[--sparse]\n");
    return 2;
  }
  return 0;
}
