// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/sizing/size_by_deviation.h"

#include "support/analytic_level_sets.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

namespace cvmesh {
namespace {

using test_support::analytic_level_sets;
using test_support::plain_frame;

struct Surface {
  InterfaceMesh dense;
  Strata strata;

  explicit Surface(const LevelSets& level_sets)
      : dense(extract_interfaces(level_sets, silent_context())), strata(find_strata(dense)) {}

  [[nodiscard]] std::vector<double> sizes(double vertices) const {
    return size_by_deviation(dense, strata, vertices, 1);
  }

  [[nodiscard]] double median_where(const std::vector<double>& sizes,
                                    const std::function<bool(const Vec3&)>& is_there) const {
    std::vector<double> chosen;
    for (std::size_t v = 0; v < sizes.size(); ++v)
      if (is_there(dense.points[v])) chosen.push_back(sizes[v]);
    REQUIRE_FALSE(chosen.empty());
    std::nth_element(chosen.begin(), chosen.begin() + std::ptrdiff_t(chosen.size() / 2),
                     chosen.end());
    return chosen[chosen.size() / 2];
  }

  // Vertices at spacing h, a hexagon each.
  [[nodiscard]] double vertices_at(const std::vector<double>& sizes) const {
    double sum = 0;
    for (const auto& [a, b, c] : dense.facets) {
      const double h = (sizes[a] + sizes[b] + sizes[c]) / 3;
      const double area = norm(area_vector2(dense.points[a], dense.points[b], dense.points[c])) / 2;
      sum += area / (std::sqrt(3.0) / 2 * h * h);
    }
    return sum;
  }
};

TEST_CASE("size_by_deviation: a ball gets equal edges for the vertices asked for",
          "[sizing][unit]") {
  const Vec3 centre{20.1, 20.2, 20.4};
  const Surface ball(analytic_level_sets(plain_frame({41, 41, 41}),
                                         [&](const Vec3& p) { return 16 - distance(p, centre); }));
  for (const double vertices : {150.0, 600.0}) {
    CAPTURE(vertices);
    const auto sizes = ball.sizes(vertices);
    const auto [least, most] = std::minmax_element(sizes.begin(), sizes.end());
    CHECK(*most < 1.3 * *least);
    CHECK(std::abs(ball.vertices_at(sizes) - vertices) < 0.1 * vertices);
  }
}

TEST_CASE("size_by_deviation: edges go with the fourth root of the radius of curvature",
          "[sizing][unit]") {
  // most of the area, and so the median, belongs to the ball of radius 24
  const Vec3 large{30.1, 30.2, 30.4}, small{68.1, 30.2, 30.4};
  const Surface balls(analytic_level_sets(plain_frame({80, 60, 60}), [&](const Vec3& p) {
    return std::max(24 - distance(p, large), 8 - distance(p, small));
  }));
  const auto sizes = balls.sizes(1000);
  const double at_large = balls.median_where(sizes, [](const Vec3& p) { return p.x < 56; });
  const double at_small = balls.median_where(sizes, [](const Vec3& p) { return p.x > 58; });
  CHECK(std::abs(at_large / at_small - std::pow(3, 0.25)) < 0.07);
}

TEST_CASE("size_by_deviation: the walls of a thin plate are flat, its rim is not",
          "[sizing][unit]") {
  // walls 2 voxels apart, facets of 4: only walls that are kept apart are flat
  const Vec3 centre{20.1, 20.2, 8.4};
  const Surface plate(analytic_level_sets(plain_frame({41, 41, 17}), [&](const Vec3& p) {
    const double across = std::hypot(p.x - centre.x, p.y - centre.y);
    return std::min(1 - std::abs(p.z - centre.z), 15 - across);
  }));
  const auto radius = [&](const Vec3& p) { return std::hypot(p.x - centre.x, p.y - centre.y); };
  const auto sizes = plate.sizes(100);
  const double inside = plate.median_where(sizes, [&](const Vec3& p) { return radius(p) < 8; });
  const double rim = plate.median_where(sizes, [&](const Vec3& p) { return radius(p) > 14.5; });
  CHECK(inside == *std::max_element(sizes.begin(), sizes.end()));
  CHECK(rim < 0.8 * inside);
}

TEST_CASE("size_by_deviation: a sharp edge between two patches is no deviation of either",
          "[sizing][unit]") {
  // a box cut in two materials: the cut is flat up to its border
  const Surface box(
      analytic_level_sets(plain_frame({32, 32, 32}), 3, [](MaterialId m, const Vec3& p) {
        const double inside = 12 - distance(p, {15.6, 15.3, 15.8});
        const double side = p.x - 15.4;
        return m == 1 ? std::min(inside, side) : m == 2 ? std::min(inside, -side) : -inside;
      }));
  const auto sizes = box.sizes(200);
  std::vector<bool> is_on_cut(sizes.size(), true);
  for (std::size_t f = 0; f < box.dense.facets.size(); ++f)
    if (box.dense.patch_of[f].sides.outside == kExterior)
      for (const auto v : box.dense.facets[f])
        is_on_cut[v] = false;
  const double most = *std::max_element(sizes.begin(), sizes.end());
  std::size_t count = 0;
  for (std::size_t v = 0; v < sizes.size(); ++v)
    if (is_on_cut[v]) {
      ++count;
      CHECK(sizes[v] == most);
    }
  CHECK(count > 200);
}

}  // namespace
}  // namespace cvmesh
