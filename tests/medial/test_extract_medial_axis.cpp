// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/medial/extract_medial_axis.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "support/analytic_level_sets.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>

namespace cvmesh {
namespace {

using test_support::analytic_level_sets;
using test_support::middle_of;
using test_support::plain_frame;

MedialAxisResult axis_of(const LevelSets& level_sets) {
  const auto context = silent_context();
  const auto dense = extract_interfaces(level_sets, context);
  return extract_medial_axis(level_sets, dense, find_strata(dense), {}, context);
}

TEST_CASE("extract_medial_axis: a ball has its centre and no other point", "[medial][unit]") {
  for (const Vec3& spacing : {Vec3{1, 1, 1}, Vec3{0.5, 0.4, 0.8}}) {
    const double radius = 14 * spacing.y;
    const auto frame = plain_frame(
        {int(32 / (spacing.x / spacing.y)), 36, int(36 / (spacing.z / spacing.y))}, spacing);
    const Vec3 centre = middle_of(frame) + Vec3{0.03, 0.07, 0.11};
    const auto result = axis_of(
        analytic_level_sets(frame, [&](const Vec3& p) { return radius - distance(p, centre); }));
    const auto& axis = result.medial_axis;
    REQUIRE(!axis.points.empty());
    const double coarsest = std::max(spacing.x, std::max(spacing.y, spacing.z));
    for (std::size_t n = 0; n < axis.points.size(); ++n) {
      CHECK(axis.material_of[n] == 1);
      // A pair of neighbours sees walls 70 degrees apart only next to the centre.
      CHECK(distance(axis.points[n], centre) < 2 * coarsest);
      CHECK(axis.radius_mm[n] == Approx(radius).margin(2 * coarsest));
    }
  }
}

TEST_CASE("extract_medial_axis: plates of every thickness have their middle plane",
          "[medial][unit]") {
  const Vec3 normal = normalized(Vec3{0.3, 0.5, 1});
  for (const double thickness : {1.0, 2.0, 3.0, 8.0}) {
    const auto frame = plain_frame({36, 36, 36});
    const Vec3 middle = middle_of(frame) + Vec3{0.13, 0.27, 0.41};
    const auto axis = axis_of(analytic_level_sets(frame, [&](const Vec3& p) {
                        return thickness / 2 - std::abs(dot(p - middle, normal));
                      })).medial_axis;
    // At least one point for each square voxel of the plane, counted far from the border.
    std::size_t inside = 0;
    for (std::size_t n = 0; n < axis.points.size(); ++n) {
      const Vec3 d = axis.points[n] - middle;
      if (norm(d) > 12) continue;
      ++inside;
      CHECK(axis.material_of[n] == 1);
      CHECK(std::abs(dot(d, normal)) < 0.35);
    }
    CHECK(inside > 0.6 * M_PI * 12 * 12);
  }
}

TEST_CASE("extract_medial_axis: an aligned sheet one voxel thick keeps its axis",
          "[medial][unit]") {
  const auto frame = plain_frame({16, 16, 15});
  const Vec3 middle = middle_of(frame);
  const auto axis = axis_of(analytic_level_sets(frame, [&](const Vec3& p) {
                      return 0.5 - std::abs(p.z - middle.z);
                    })).medial_axis;
  REQUIRE(axis.points.size() >= 16 * 16);
  for (std::size_t n = 0; n < axis.points.size(); ++n) {
    CHECK(axis.points[n].z == Approx(middle.z).margin(1e-3));
    CHECK(axis.radius_mm[n] == Approx(0.5).margin(0.05));
  }
}

TEST_CASE("extract_medial_axis: the gap between two balls belongs to the exterior",
          "[medial][unit]") {
  const auto frame = plain_frame({50, 24, 24});
  const Vec3 middle = middle_of(frame);
  const Vec3 a = middle - Vec3{12, 0, 0}, b = middle + Vec3{12, 0, 0};
  const auto axis = axis_of(analytic_level_sets(frame, [&](const Vec3& p) {
                      return 9 - std::min(distance(p, a), distance(p, b));
                    })).medial_axis;
  double nearest = 1e9;
  for (std::size_t n = 0; n < axis.points.size(); ++n)
    if (axis.material_of[n] == kExterior) {
      CHECK(std::abs(axis.points[n].x - middle.x) < 0.75);
      nearest = std::min(nearest, distance(axis.points[n], middle));
    }
  CHECK(nearest < 1);
}

TEST_CASE("extract_medial_axis: same points at 1, 2 and 8 threads", "[medial][determinism]") {
  const auto frame = plain_frame({40, 36, 33});
  const Vec3 middle = middle_of(frame);
  const auto level_sets = analytic_level_sets(frame, 3, [&](MaterialId m, const Vec3& p) {
    const double ball = 13 - distance(p, middle), cut = p.x - middle.x - 2.3;
    return m == 0 ? -ball : m == 1 ? std::min(ball, -cut) : std::min(ball, cut);
  });
  const auto run = [&](int threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    tbb::task_arena arena(threads);
    return arena.execute([&] { return axis_of(level_sets).medial_axis; });
  };
  const auto one = run(1);
  REQUIRE(!one.points.empty());
  for (const int threads : {2, 8}) {
    const auto other = run(threads);
    CHECK(other.points == one.points);
    CHECK(other.radius_mm == one.radius_mm);
    CHECK(other.material_of == one.material_of);
  }
}

}  // namespace
}  // namespace cvmesh
