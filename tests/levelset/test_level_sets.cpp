// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "levelset/label_grids.h"
#include "levelset/surface_error.h"
#include "support/catch.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

using namespace cvmesh;
using label_grids::Labels;
using label_grids::Smooth;
using label_grids::SurfaceError;
using label_grids::TruthAt;
using label_grids::volume_inside;

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
        for (std::size_t m = 0; m < level_sets.material_count(); ++m) {
          const double value = level_sets.at(static_cast<MaterialId>(m), i, j, k);
          if ((*level_sets.labels)(i, j, k) == m)
            e.least_own = std::min(e.least_own, value);
          else
            e.largest_other = std::max(e.largest_other, value);
        }
  return e;
}

Smooth smoothed(const Labels& labels) {
  Smooth result{tightened(labels), {}};
  result.mesh = extract_interfaces(result.level_sets, silent_context());
  return result;
}

// Over several places of the centre of a ball.
SurfaceError sphere_error(double radius) {
  SurfaceError error;
  for (const Vec3 shift :
       {Vec3{}, Vec3{0.37, -0.21, 0.11}, Vec3{0.5, 0.25, -0.4}, Vec3{-0.13, 0.49, 0.3}}) {
    const Vec3 centre = label_grids::ball_centre(radius, shift);
    error.add(smoothed(label_grids::ball(radius, shift)),
              [&](const Vec3& p) -> std::optional<TruthAt> {
                return TruthAt{distance(p, centre) - radius, normalized(p - centre)};
              });
  }
  return error;
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
  // 125 one-node labels, 24 nodes apart. Each is within four nodes of eight blocks, where nothing
  // but the exterior is near: one slot of 8^3 nodes serves both.
  GridFrame frame;
  frame.dims = {120, 120, 120};
  Labels labels(frame);
  for (int n = 0; n < 125; ++n)
    labels(12 + 24 * (n % 5), 12 + 24 * (n / 5 % 5), 12 + 24 * (n / 25)) =
        static_cast<MaterialId>(n + 1);
  const auto result = build_level_sets(label_grids::shared(labels), 126, silent_context());
  CHECK(result.stats.band_nodes == 125 * 8 * 512);
  CHECK(result.stats.stored_bytes < 125 * 8 * 600 * sizeof(float));
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
  // Voxels and degrees. A binary ball has an rms of 0.21 and normals 14 degrees off; smoothing
  // without the volume term leaves a bias of -0.12 at R = 3.
  struct Bound {
    double radius, rms, bias, normal_deg;
  };

  for (const Bound& bound : {Bound{20, 0.08, 0.02, 4}, Bound{10, 0.09, 0.04, 4},
                             Bound{5, 0.10, 0.06, 4}, Bound{3, 0.13, 0.07, 6}}) {
    const SurfaceError error = sphere_error(bound.radius);
    INFO("R = " << bound.radius << ": rms " << error.rms() << ", bias " << error.bias()
                << ", normals " << error.normal_deg());
    CHECK(error.rms() <= bound.rms);
    CHECK(std::abs(error.bias()) <= bound.bias);
    CHECK(error.normal_deg() <= bound.normal_deg);
  }
}

TEST_CASE("tighten: the terraces of tilted planes go", "[levelset][interfaces][unit]") {
  // Between lattice planes the labels do not say where a plane is: at (1, 1, 1) within 0.29 voxel.
  const Vec3 middle{24, 24, 24};
  for (const Vec3& direction : {Vec3{1, 2, 5}, Vec3{1, 1, 1}, Vec3{0.1, 0.07, 1}, Vec3{3, 1, 4}}) {
    const Vec3 n = normalized(direction);
    SurfaceError error;
    error.add(smoothed(label_grids::sample(
                  {49, 49, 49},
                  [&](const Vec3& p) -> MaterialId { return dot(p - middle, n) < 0.2 ? 1 : 0; })),
              [&](const Vec3& p) -> std::optional<TruthAt> {
                if (std::min({p.x, p.y, p.z}) <= 8 || std::max({p.x, p.y, p.z}) >= 40)
                  return std::nullopt;
                return TruthAt{dot(p - middle, n) - 0.2, n};
              });
    INFO("normal " << n.x << ' ' << n.y << ' ' << n.z << ": " << error.normal_deg() << " degrees");
    CHECK(error.normal_deg() <= 4);
    CHECK(error.rms() <= 0.15);
  }
}

TEST_CASE("tighten: thin parts keep their volume", "[levelset][interfaces][unit]") {
  // Smoothing alone takes 20 to 37 % of the rod and half of the plate of one voxel.
  struct Thin {
    const char* name;
    Labels labels;
  };

  for (const Thin& thin : {Thin{"disc (1 2 5)", label_grids::disc(12, 0.9, {1, 2, 5})},
                           Thin{"disc (1 1 1)", label_grids::disc(12, 0.9, {1, 1, 1})},
                           Thin{"disc (0 1 3)", label_grids::disc(12, 0.9, {0, 1, 3})},
                           Thin{"rod (1 2 4)", label_grids::rod(1, 12, {1, 2, 4})},
                           Thin{"rod (1 1 1)", label_grids::rod(1, 12, {1, 1, 1})},
                           Thin{"rod (3 1 1)", label_grids::rod(1, 12, {3, 1, 1})},
                           Thin{"plate of one voxel", label_grids::disc(12, 0.5, {0, 0, 1})}}) {
    const Smooth s = smoothed(thin.labels);
    const double ratio =
        volume_inside(s.mesh, 1) / static_cast<double>(label_grids::count(thin.labels, 1));
    INFO(thin.name << ": " << ratio);
    CHECK(ratio == Approx(1).margin(0.15));
    CHECK(s.level_sets.labels->values == thin.labels.values);
  }
}

TEST_CASE("tighten: specks of one and two voxels keep their volume",
          "[levelset][interfaces][unit]") {
  // Also where the blocks that store them meet: at node 8.
  for (const int place : {8, 11})
    for (const int length : {1, 2}) {
      Labels labels =
          label_grids::sample({20, 20, 20}, [](const Vec3&) -> MaterialId { return 0; });
      for (int n = 0; n < length; ++n)
        labels(place, place, place + n) = 1;
      INFO(length << " voxels at " << place);
      CHECK(volume_inside(smoothed(labels).mesh, 1) == Approx(length).epsilon(0.15));
    }
}

TEST_CASE("tighten: a label's own radius rules its boundary", "[levelset][unit]") {
  // Two noisy cubes far apart; the flow moves nodes of the one with the large radius only.
  const CounterRandom random(4, "noisy cubes");
  std::uint64_t node = 0;
  const Labels labels = label_grids::sample({40, 20, 20}, [&](const Vec3& p) -> MaterialId {
    const bool is_flipped = random.uniform(node++) < 0.2;
    for (const MaterialId m : {MaterialId{1}, MaterialId{2}}) {
      const Vec3 q = p - Vec3{m == 1 ? 10.0 : 30.0, 10, 10};
      const double depth = 5.5 - std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z)});
      if (depth > 1 || (depth > -1 && (depth > 0) != is_flipped)) return m;
    }
    return 0;
  });
  TightenOptions options;
  options.r_vox_of = {{0, 2}, {1, 2}};
  const TightenResult result = tighten(built(labels), options, silent_context());
  std::array<std::size_t, 3> changed{};
  for (std::size_t n = 0; n < labels.values.size(); ++n)
    if (const MaterialId now = result.level_sets.labels->values[n]; now != labels.values[n])
      ++changed[std::max(now, labels.values[n])];
  CHECK(changed[1] > 20);
  CHECK(changed[2] == 0);
  CHECK(result.stats.nodes_changed == changed[1]);
}

TEST_CASE("tighten: below 0.8 a smaller radius smooths less", "[levelset][unit]") {
  const Vec3 shift{0.37, -0.21, 0.11};
  const Labels labels = label_grids::ball(8, shift);
  const Vec3 centre = label_grids::ball_centre(8, shift);
  const auto normal_deg = [&](double r) {
    SurfaceError error;
    Smooth s{tightened(labels, r), {}};
    s.mesh = extract_interfaces(s.level_sets, silent_context());
    error.add(s, [&](const Vec3& p) -> std::optional<TruthAt> {
      return TruthAt{distance(p, centre) - 8, normalized(p - centre)};
    });
    return error.normal_deg();
  };
  CHECK(normal_deg(0.8) < normal_deg(0.4));
  CHECK(normal_deg(0.4) < normal_deg(0.2));
}

TEST_CASE("tighten: where materials meet the smaller radius rules, also beside a third",
          "[levelset][unit]") {
  // Two halves of a ball in a third material: a radius of 0 for one half leaves its boundary rough,
  // the flat face included, wherever blocks begin; the other half's own boundary stays smooth.
  const Vec3 shift{0.37, -0.21, 0.11};
  Labels labels = label_grids::ball(9, shift);
  const Vec3 centre = label_grids::ball_centre(9, shift);
  const Vec3 tilt = normalized(Vec3{1, 0.13, 0.08});
  for (int k = 0; k < labels.frame.dims[2]; ++k)
    for (int j = 0; j < labels.frame.dims[1]; ++j)
      for (int i = 0; i < labels.frame.dims[0]; ++i)
        if (labels(i, j, k) == 1 && dot(Vec3{double(i), double(j), double(k)} - centre, tilt) > 0)
          labels(i, j, k) = 2;
  const auto roughness = [&](std::map<MaterialId, double> r_vox_of) {
    TightenOptions options;
    options.r_vox_of = std::move(r_vox_of);
    const auto mesh = extract_interfaces(
        tighten(built(labels), options, silent_context()).level_sets, silent_context());
    std::map<PatchKey, std::pair<double, double>> sums;  // squares, count
    for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
      const PatchKey key = mesh.patch_of[f];
      for (const auto v : mesh.facets[f]) {
        const Vec3 q = mesh.points[v] - centre;
        const double d = key.sides.outside == 0 ? norm(q) - 9 : dot(q, tilt);
        if (key.sides.outside == 0 && std::abs(dot(q, tilt)) < 3) continue;  // away from the rim
        if (key.sides.outside != 0 && norm(q) > 6) continue;
        sums[key].first += d * d;
        sums[key].second += 1;
      }
    }
    std::map<PatchKey, double> rms;
    for (const auto& [key, sum] : sums)
      rms[key] = std::sqrt(sum.first / sum.second);
    return rms;
  };
  auto smooth = roughness({}), mixed = roughness({{1, 0.0}});
  const PatchKey own{{1, 0}, 0}, other{{2, 0}, 0}, face{{2, 1}, 0};
  CHECK(mixed[own] > 1.2 * smooth[own]);
  CHECK(mixed[face] > 1.2 * smooth[face]);
  CHECK(mixed[other] < 1.2 * smooth[other]);
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
  CHECK(before.values == after.values);
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
      for (std::size_t m = 0; m < result.material_count(); ++m)
        CHECK(result.tables[m].entry == results[0].tables[m].entry);
      CHECK(result.values == results[0].values);
    }
  }
}
