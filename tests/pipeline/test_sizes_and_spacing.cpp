// SPDX-License-Identifier: AGPL-3.0-or-later
//
// From voxels to particles: what comes out of the stages together.
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include "levelset/label_grids.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

using namespace cvmesh;

namespace {

struct Surfaces {
  LevelSets level_sets;
  InterfaceMesh dense;
  Strata strata;
  std::vector<double> lfs_mm;
};

Surfaces surfaces_of(const label_grids::Labels& labels) {
  const auto context = silent_context();
  Surfaces result;
  result.level_sets = tighten(build_level_sets(label_grids::shared(labels),
                                               label_grids::material_count(labels), context)
                                  .level_sets,
                              {}, context)
                          .level_sets;
  result.dense = extract_interfaces(result.level_sets, context);
  result.strata = find_strata(result.dense);
  const auto axis =
      extract_medial_axis(result.level_sets, result.dense, result.strata, {}, context);
  result.lfs_mm = local_feature_size(result.dense, result.strata, axis.medial_axis,
                                     result.level_sets.frame().voxel_mm(), context);
  return result;
}

// The value below which `part` of the feature sizes lie, of the vertices that `is_counted` takes.
double quantile(const Surfaces& surfaces,
                double part,
                const std::function<bool(const Vec3&)>& is_counted) {
  std::vector<double> values;
  for (std::size_t v = 0; v < surfaces.lfs_mm.size(); ++v)
    if (is_counted(surfaces.dense.points[v])) values.push_back(surfaces.lfs_mm[v]);
  REQUIRE(values.size() > 100);
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

void check_truth(const Surfaces& surfaces,
                 double truth,
                 const std::function<bool(const Vec3&)>& is_counted) {
  CHECK(quantile(surfaces, 0.5, is_counted) == Approx(truth).epsilon(0.1));
  CHECK(quantile(surfaces, 0.05, is_counted) >= 0.8 * truth);
}

const Vec3 kTilted = normalized(Vec3{0.3, 0.5, 1});
const Vec3 kMiddle{32.13, 32.27, 31.59};

}  // namespace

TEST_CASE("local_feature_size: balls, plates and cylinders of voxels", "[sizing][property]") {
  for (const double radius : {6.0, 12.0, 20.0}) {
    INFO("ball of radius " << radius);
    check_truth(surfaces_of(label_grids::ball(radius, {0.13, 0.27, -0.41})), radius,
                [](const Vec3&) { return true; });
  }
  // A plate of one voxel bulges around its voxels and has no thickness of its own.
  for (const double thickness : {2.0, 3.0, 8.0}) {
    INFO("plate " << thickness << " thick");
    check_truth(surfaces_of(label_grids::sample({65, 65, 65},
                                                [&](const Vec3& p) -> MaterialId {
                                                  const Vec3 d = p - kMiddle;
                                                  const double z = dot(d, kTilted);
                                                  return std::abs(z) < 0.5 * thickness &&
                                                         norm(d - z * kTilted) < 24;
                                                })),
                0.5 * thickness, [](const Vec3& p) { return distance(p, kMiddle) < 12; });
  }
  for (const double radius : {2.0, 8.0}) {
    INFO("cylinder of radius " << radius);
    check_truth(surfaces_of(label_grids::sample({65, 65, 65},
                                                [&](const Vec3& p) -> MaterialId {
                                                  const Vec3 d = p - kMiddle;
                                                  const double z = dot(d, kTilted);
                                                  return norm(d - z * kTilted) < radius &&
                                                         std::abs(z) < 26;
                                                })),
                radius, [](const Vec3& p) { return std::abs(dot(p - kMiddle, kTilted)) < 13; });
  }
}

TEST_CASE("distribute_particles: a ball of voxels gets as many as its area holds at any epsilon",
          "[particles][property]") {
  const Surfaces surfaces = surfaces_of(label_grids::ball(40, {0.13, 0.27, -0.41}));
  for (const double epsilon : {0.1, 0.25, 0.5, 1.0}) {
    INFO("epsilon " << epsilon);
    SizingOptions sizing;
    sizing.epsilon = epsilon;
    const SizingResult sized =
        compute_sizing_field(surfaces.dense, surfaces.strata, surfaces.lfs_mm,
                             *surfaces.level_sets.labels, sizing, silent_context());
    const Sheets sheets({surfaces.dense, surfaces.strata, surfaces.level_sets, sized.sizing_field});
    auto seeds = seed_particles(sheets, {}, silent_context());
    const auto result =
        distribute_particles(std::move(seeds.particles), sheets, {}, silent_context());
    const auto count = static_cast<double>(result.particles.particles.size());
    // (2 / sqrt 3) times the area over h^2, h = epsilon times the radius.
    if (epsilon < 1) {
      CHECK(count == Approx(8 * M_PI / (std::sqrt(3.0) * epsilon * epsilon)).epsilon(0.05));
    } else {
      CHECK(count >= 12);
      CHECK(count <= 18);
    }
  }
}

TEST_CASE("run_pipeline: even spacing and well-shaped triangles on real volumes",
          "[pipeline][property][slow]") {
  struct Expected {
    const char* file;
    std::size_t vertices;
    double mean_shape, shape_sd;
  };

  for (const Expected& expected :
       {Expected{"bunny.nii.gz", 15361, 0.93, 0.08}, Expected{"tooth.nii.gz", 3981, 0.90, 0.12}}) {
    const auto input = test_data::file(expected.file);
    if (!input) {
      WARN("skipped: " << expected.file << " is not there; set CVMESH_TEST_DATA");
      continue;
    }
    INFO(expected.file);
    const test_data::TemporaryFolder folder;
    RunRequest request;
    request.input = *input;
    request.out_dir = folder.path();
    request.surface_only = true;
    request.parameters.target_vertices = expected.vertices;
    const Report report = run_pipeline(request, silent_context()).report;
    REQUIRE(report.stages.particles);
    const DistributeParticlesStats& spacing = *report.stages.particles;
    CHECK(spacing.edge_over_h_mean > 0.97);
    CHECK(spacing.edge_over_h_mean < 1.06);
    CHECK(spacing.edge_over_h_sd <= 0.14);
    CHECK(spacing.nearest_over_h_mean >= 0.85);
    CHECK(spacing.six_neighbour_share >= 0.65);
    CHECK(spacing.on_dense_facet <= 5);
    CHECK(report.quality->triangles.radius_ratio.mean >= expected.mean_shape);
    CHECK(report.quality->triangles.radius_ratio.standard_deviation <= expected.shape_sd);
  }
}
