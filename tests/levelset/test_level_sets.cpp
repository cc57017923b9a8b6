// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "levelset/label_grids.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace cvmesh;
using label_grids::Labels;

namespace {

LevelSets built(const Labels& labels) {
  return build_level_sets(label_grids::shared(labels), label_grids::material_count(labels),
                          silent_context())
      .level_sets;
}

LevelSets tightened(const Labels& labels, double r_vox = TightenOptions{}.r_vox) {
  TightenOptions options;
  options.r_vox = r_vox;
  return tighten(built(labels), options, silent_context()).level_sets;
}

// Least own value and largest other value over all nodes.
struct Extremes {
  double least_own = std::numeric_limits<double>::infinity();
  double largest_other = -std::numeric_limits<double>::infinity();
};

Extremes extremes(const LevelSets& level_sets) {
  Extremes e;
  const auto [nx, ny, nz] = level_sets.frame().dims;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        for (std::size_t m = 0; m < level_sets.fields.size(); ++m) {
          const double value = level_sets.at(static_cast<MaterialId>(m), i, j, k);
          if ((*level_sets.labels)(i, j, k) == m)
            e.least_own = std::min(e.least_own, value);
          else
            e.largest_other = std::max(e.largest_other, value);
        }
  return e;
}

// Signed distances of the dense vertices from a true sphere, over several places of its centre.
struct SphereError {
  double rms = 0, bias = 0;
};

SphereError sphere_error(double radius) {
  double sum = 0, sum2 = 0;
  std::size_t n = 0;
  for (const Vec3 shift :
       {Vec3{}, Vec3{0.37, -0.21, 0.11}, Vec3{0.5, 0.25, -0.4}, Vec3{-0.13, 0.49, 0.3}}) {
    const Vec3 centre = label_grids::ball_centre(radius, shift);
    const auto mesh =
        extract_interfaces(tightened(label_grids::ball(radius, shift)), silent_context());
    for (const Vec3& p : mesh.points) {
      const double d = distance(p, centre) - radius;
      sum += d;
      sum2 += d * d;
      ++n;
    }
  }
  return {std::sqrt(sum2 / static_cast<double>(n)), sum / static_cast<double>(n)};
}

}  // namespace

TEST_CASE(
    "build_level_sets: the own label's value is positive and every other negative at every "
    "node of every phantom",
    "[levelset][property]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    const Extremes e = extremes(built(labels));
    CHECK(e.least_own >= 0.05F);
    CHECK(e.largest_other <= -0.05F);
  }
}

TEST_CASE(
    "tighten: the own label's value is positive and every other negative at every node of "
    "every phantom",
    "[levelset][property]") {
  for (const auto& [name, labels] : label_grids::phantoms())
    for (const double r : {0.8, 2.0}) {
      INFO(name << ", r = " << r);
      const LevelSets level_sets = tightened(labels, r);
      const Extremes e = extremes(level_sets);
      CHECK(e.least_own > 0);
      CHECK(e.largest_other < 0);
      if (r < 1) CHECK(level_sets.labels->values == labels.values);
    }
}

TEST_CASE("build_level_sets: values are those of the blurred indicator", "[levelset][unit]") {
  // Across a plane half way between nodes the blurred step at distance d is erf(d / sqrt 2).
  const LevelSets level_sets = built(label_grids::sample(
      {32, 9, 9}, [](const Vec3& p) -> MaterialId { return p.x < 16 ? 1 : 0; }));
  for (int i = 12; i < 20; ++i) {
    const double expected = std::erf((15.5 - i) / std::sqrt(2.0));
    CHECK(level_sets.at(1, i, 4, 4) == Approx(expected).margin(0.03));
    CHECK(level_sets.at(0, i, 4, 4) == Approx(-level_sets.at(1, i, 4, 4)).margin(1e-6));
  }
  CHECK(level_sets.at(1, 2, 4, 4) == 1);
  CHECK(level_sets.at(1, 30, 4, 4) == -1);
}

TEST_CASE("build_level_sets: memory follows the interface, not voxels times labels",
          "[levelset][unit]") {
  // Two hundred one-node labels in a volume of 64^3: 8^3 nodes for each block near one.
  GridFrame frame;
  frame.dims = {64, 64, 64};
  Labels labels(frame);
  for (int n = 0; n < 200; ++n)
    labels(4 + 8 * (n % 8), 4 + 8 * (n / 8 % 8), 4 + 8 * (n / 64)) = static_cast<MaterialId>(n + 1);
  const auto result = build_level_sets(label_grids::shared(labels), 201, silent_context());
  CHECK(result.stats.band_nodes <= 200 * 2 * 512);
  CHECK(result.stats.stored_bytes < 200 * 8 * labels.values.size() / 100);
}

TEST_CASE("LevelSets::sample_difference: value and gradient are those of the trilinear interpolant",
          "[levelset][unit]") {
  Labels labels = label_grids::ball(5);
  labels.frame.spacing_mm = {0.5, 0.4, 0.8};
  const LevelSets level_sets = tightened(labels);
  const Vec3 centre = labels.frame.index_to_mm(label_grids::ball_centre(5));
  for (const Vec3 direction : {Vec3{1, 0.1, 0.2}, Vec3{-1, 2, 0.3}, Vec3{0.4, -0.2, 1}}) {
    const Vec3 p = centre + scaled_by(4.8 * normalized(direction), labels.frame.spacing_mm);
    const auto sample = level_sets.sample_difference(1, 0, p);
    CHECK(sample.value == level_sets.difference(1, 0, p));
    CHECK(level_sets.difference(0, 1, p) == Approx(-sample.value));
    for (int axis = 0; axis < 3; ++axis) {
      // Inside one cell the interpolant is linear along each axis: differences are exact.
      Vec3 q = p;
      q[axis] += 1e-4;
      CHECK((level_sets.difference(1, 0, q) - sample.value) / 1e-4 ==
            Approx(sample.gradient[axis]).margin(1e-6));
    }
  }
}

TEST_CASE("tighten: spheres are met to a tenth of a voxel with the default options",
          "[levelset][interfaces][unit]") {
  // Bounds in voxels: what the constrained biharmonic smoothing reaches. A binary ball has 0.21.
  struct Bound {
    double radius, rms, bias;
  };

  for (const Bound& bound :
       {Bound{20, 0.09, 0.03}, Bound{10, 0.10, 0.05}, Bound{5, 0.12, 0.07}, Bound{3, 0.15, 0.12}}) {
    const SphereError error = sphere_error(bound.radius);
    INFO("R = " << bound.radius << ": rms " << error.rms << ", bias " << error.bias);
    CHECK(error.rms <= bound.rms);
    CHECK(std::abs(error.bias) <= bound.bias);
  }
}

TEST_CASE("tighten: a plane of nodes stays a plane half way between them", "[levelset][unit]") {
  const LevelSets level_sets = tightened(label_grids::sample(
      {24, 12, 12}, [](const Vec3& p) -> MaterialId { return p.x < 11 ? 1 : 0; }));
  const auto mesh = extract_interfaces(level_sets, silent_context());
  // Wherever the plane lies between the blocks that store it.
  double farthest = 0;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f)
    if (mesh.patch_of[f].wall == 0)
      for (const auto v : mesh.facets[f])
        farthest = std::max(farthest, std::abs(mesh.points[v].x - 10.5));
  CHECK(farthest < 0.01);
}

TEST_CASE("tighten: an anisotropic ball is met along each of its axes", "[levelset][unit]") {
  // The ball is round in mm; in the grid it is an ellipsoid of half axes 10, 12.5 and 6.25 nodes.
  const Vec3 spacing{0.5, 0.4, 0.8};
  const Vec3 middle{15, 18, 11};
  const Labels labels = label_grids::sample(
      {31, 37, 23},
      [&](const Vec3& p) -> MaterialId { return norm(scaled_by(p - middle, spacing)) < 5 ? 1 : 0; },
      spacing);
  for (const double r : {0.8, 2.0}) {
    const auto mesh = extract_interfaces(tightened(labels, r), silent_context());
    double sum2 = 0;
    for (const Vec3& p : mesh.points) {
      const double d = distance(p, scaled_by(middle, spacing)) - 5;
      sum2 += d * d;
    }
    // An eighth of the coarsest spacing.
    CHECK(std::sqrt(sum2 / static_cast<double>(mesh.points.size())) < 0.1);
  }
}

TEST_CASE("tighten: r = 0 leaves the level sets as they are", "[levelset][unit]") {
  const Labels labels = label_grids::ball(6);
  const LevelSets before = built(labels), after = tightened(labels, 0);
  for (std::size_t m = 0; m < before.fields.size(); ++m)
    CHECK(before.fields[m].values == after.fields[m].values);
}

TEST_CASE("tighten: with r of two voxels a noisy ball comes nearer to the ball",
          "[levelset][unit]") {
  const Labels noisy = label_grids::noisy_ball(12, 0.25, 5);
  const Vec3 centre = label_grids::ball_centre(12);
  const auto rms = [&](double r) {
    const auto mesh = extract_interfaces(tightened(noisy, r), silent_context());
    double sum2 = 0;
    for (const Vec3& p : mesh.points)
      sum2 += std::pow(distance(p, centre) - 12, 2);
    return std::sqrt(sum2 / static_cast<double>(mesh.points.size()));
  };
  CHECK(rms(2) < 0.8 * rms(0.8));
}

TEST_CASE("build_level_sets and tighten: 1 = 2 = 8 threads", "[levelset][determinism]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    std::vector<LevelSets> results;
    for (const int threads : {1, 2, 8}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(threads));
      tbb::task_arena arena(threads);
      arena.execute([&] { results.push_back(tightened(labels, 1.5)); });
    }
    for (const auto& result : results) {
      CHECK(result.labels->values == results[0].labels->values);
      for (std::size_t m = 0; m < result.fields.size(); ++m) {
        CHECK(result.fields[m].block_at == results[0].fields[m].block_at);
        CHECK(result.fields[m].values == results[0].fields[m].values);
      }
    }
  }
}
