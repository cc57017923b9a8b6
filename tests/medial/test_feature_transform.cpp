// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/medial/feature_transform.h"
#include "cvmesh/medial/point_tree.h"

#include "support/analytic_level_sets.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {
namespace {

using test_support::analytic_level_sets;
using test_support::middle_of;
using test_support::plain_frame;

TEST_CASE("find_interface_sites: sites lie on an analytic sphere with its normals",
          "[medial][unit]") {
  const auto frame = plain_frame({30, 30, 30});
  const Vec3 centre = middle_of(frame) + Vec3{0.13, 0.27, 0.41};
  const auto sites = find_interface_sites(
      analytic_level_sets(frame, [&](const Vec3& p) { return 10 - distance(p, centre); }));
  REQUIRE(sites.sites.size() > 1000);
  for (const auto& site : sites.sites) {
    // Interpolation over one voxel is off by 1 / (8 R) at most, the margin of 0.05 that nodes close
    // to the surface keep moves it by 0.075 voxel at most.
    CHECK(std::abs(distance(site.point(), centre) - 10) < 1.0 / 80 + 0.075);
    const Vec3 inward = normalized(centre - site.point());
    CHECK(dot(site.normal_into(1), inward) > std::cos(8 * M_PI / 180));
    CHECK(dot(site.normal_into(0), inward) < 0);
  }
}

TEST_CASE("nearest_sites: equals the search over all sites, anisotropic voxels included",
          "[medial][unit]") {
  for (const Vec3& spacing : {Vec3{1, 1, 1}, Vec3{0.5, 0.4, 0.8}, Vec3{1, 1, 5}}) {
    const auto frame = plain_frame({23, 31, 19}, spacing);
    // Three balls of two materials: concave exterior, several sheets of equal distance.
    const Vec3 extent = frame.index_to_mm({23, 31, 19});
    const double r = 0.2 * std::min(extent.x, std::min(extent.y, extent.z));
    const Vec3 a = scaled_by(extent, {0.3, 0.3, 0.3}), b = scaled_by(extent, {0.7, 0.5, 0.6}),
               c = scaled_by(extent, {0.3, 0.8, 0.5});
    const auto level_sets = analytic_level_sets(frame, 3, [&](MaterialId m, const Vec3& p) {
      const double one = r - std::min(distance(p, a), distance(p, b)), two = r - distance(p, c);
      return m == 1 ? one : m == 2 ? two : -std::max(one, two);
    });
    const auto sites = find_interface_sites(level_sets);
    REQUIRE(sites.sites.size() > 50);
    std::vector<Vec3> points;
    for (const auto& site : sites.sites)
      points.push_back(site.point());
    const PointTree tree(points);
    const auto nearest = nearest_sites(frame, sites);
    for (int k = 0; k < frame.dims[2]; ++k)
      for (int j = 0; j < frame.dims[1]; ++j)
        for (int i = 0; i < frame.dims[0]; ++i) {
          const Vec3 p = frame.index_to_mm({double(i), double(j), double(k)});
          REQUIRE(distance(points[nearest(i, j, k)], p) ==
                  Approx(tree.nearest(p).distance).margin(1e-5));
        }
  }
}

TEST_CASE("nearest_sites: a volume of one label has no sites", "[medial][unit]") {
  const auto frame = plain_frame({5, 6, 7});
  const auto sites =
      find_interface_sites(analytic_level_sets(frame, [](const Vec3&) { return -10.0; }));
  CHECK(sites.sites.empty());
  const auto nearest = nearest_sites(frame, sites);
  CHECK(std::all_of(nearest.values.begin(), nearest.values.end(),
                    [](std::int32_t s) { return s == -1; }));
}

TEST_CASE("PointTree: nearest and filtered queries equal the search over all points",
          "[medial][unit]") {
  const CounterRandom random(7, "point tree");
  const auto random_point = [&](std::uint64_t n) {
    return Vec3{random.uniform(n, 0), random.uniform(n, 1), random.uniform(n, 2)};
  };
  std::vector<Vec3> points;
  for (std::uint64_t n = 0; n < 500; ++n)
    points.push_back(random_point(n));
  const PointTree tree(points);
  const auto is_even = [](std::int32_t n) { return n % 2 == 0; };
  for (std::uint64_t n = 0; n < 50; ++n) {
    const Vec3 p = random_point(1000 + n);
    double any = std::numeric_limits<double>::infinity(), even = any;
    for (std::size_t m = 0; m < points.size(); ++m) {
      any = std::min(any, distance(p, points[m]));
      if (m % 2 == 0) even = std::min(even, distance(p, points[m]));
    }
    CHECK(tree.nearest(p).distance == Approx(any));
    CHECK(tree.nearest_if(p, 10, is_even).distance == Approx(even));
    CHECK(tree.nearest_if(p, 0.5 * even, is_even).index == -1);
  }
  CHECK(PointTree().nearest({0, 0, 0}).index == -1);
}

}  // namespace
}  // namespace cvmesh
