// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include "support/analytic_level_sets.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

namespace cvmesh {
namespace {

using test_support::analytic_level_sets;
using test_support::middle_of;
using test_support::plain_frame;

struct Measured {
  InterfaceMesh dense;
  Strata strata;
  std::vector<double> lfs;
};

Measured measure(const LevelSets& level_sets) {
  const auto context = silent_context();
  Measured result;
  result.dense = extract_interfaces(level_sets, context);
  result.strata = find_strata(result.dense);
  const auto axis = extract_medial_axis(level_sets, result.dense, result.strata, {}, context);
  result.lfs = local_feature_size(result.dense, result.strata, axis.medial_axis,
                                  level_sets.frame().voxel_mm(), context);
  return result;
}

// The value below which `part` of the local feature sizes lie, among the vertices that `keep`
// takes.
double quantile(const Measured& m, double part, const std::function<bool(const Vec3&)>& keep) {
  std::vector<double> values;
  for (std::size_t v = 0; v < m.lfs.size(); ++v)
    if (keep(m.dense.points[v])) values.push_back(m.lfs[v]);
  REQUIRE(values.size() > 100);
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

const Vec3 kTilted = normalized(Vec3{0.3, 0.5, 1});

// A point beside the middle of the frame: nothing falls onto nodes.
Vec3 off_middle(const GridFrame& frame) {
  return middle_of(frame) + scaled_by(frame.spacing_mm, {0.13, 0.27, 0.41});
}

void check_truth(const Measured& m, double truth, const std::function<bool(const Vec3&)>& keep) {
  CHECK(quantile(m, 0.5, keep) == Approx(truth).epsilon(0.10));
  CHECK(quantile(m, 0.05, keep) >= 0.80 * truth);
  CHECK(quantile(m, 0.95, keep) <= 1.20 * truth);
}

TEST_CASE("local_feature_size: the radius on spheres", "[sizing][unit]") {
  for (const double radius : {6.0, 12.0, 20.0}) {
    const int n = static_cast<int>(2 * radius) + 8;
    const auto frame = plain_frame({n, n, n});
    const Vec3 centre = off_middle(frame);
    INFO("radius " << radius);
    check_truth(measure(analytic_level_sets(
                    frame, [&](const Vec3& p) { return radius - distance(p, centre); })),
                radius, [](const Vec3&) { return true; });
  }
}

TEST_CASE("local_feature_size: the radius on a sphere of anisotropic voxels", "[sizing][unit]") {
  const auto frame = plain_frame({50, 60, 34}, {0.5, 0.4, 0.8});
  const Vec3 centre = off_middle(frame);
  check_truth(
      measure(analytic_level_sets(frame, [&](const Vec3& p) { return 10 - distance(p, centre); })),
      10, [](const Vec3&) { return true; });
}

TEST_CASE("local_feature_size: thick slices do not make features of their own", "[sizing][unit]") {
  const auto frame = plain_frame({68, 68, 18}, {1, 1, 5});
  const Vec3 centre = off_middle(frame);
  const auto m =
      measure(analytic_level_sets(frame, [&](const Vec3& p) { return 30 - distance(p, centre); }));
  // The axis is a few slices wide: the truth less half a slice or so.
  CHECK(quantile(m, 0.05, [](const Vec3&) { return true; }) > 0.75 * 30);
}

TEST_CASE("local_feature_size: half the thickness on tilted plates", "[sizing][unit]") {
  const auto frame = plain_frame({46, 46, 46});
  const Vec3 middle = off_middle(frame);
  const auto is_central = [&](const Vec3& p) { return distance(p, middle) < 14; };
  for (const double thickness : {2.0, 3.0, 8.0}) {
    INFO("thickness " << thickness);
    check_truth(
        measure(analytic_level_sets(
            frame,
            [&](const Vec3& p) { return thickness / 2 - std::abs(dot(p - middle, kTilted)); })),
        thickness / 2, is_central);
  }
  // One voxel: the grid itself holds the plate only roughly, so its walls scatter.
  const auto thin = measure(analytic_level_sets(
      frame, [&](const Vec3& p) { return 0.5 - std::abs(dot(p - middle, kTilted)); }));
  CHECK(quantile(thin, 0.5, is_central) == Approx(0.5).epsilon(0.1));
  CHECK(quantile(thin, 0.05, is_central) > 0.5 * 0.5);
}

TEST_CASE("local_feature_size: the radius on tilted cylinders", "[sizing][unit]") {
  const auto frame = plain_frame({50, 50, 50});
  const Vec3 middle = off_middle(frame);
  for (const double radius : {2.0, 8.0}) {
    INFO("radius " << radius);
    check_truth(measure(analytic_level_sets(frame,
                                            [&](const Vec3& p) {
                                              const Vec3 d = p - middle;
                                              return radius - norm(d - dot(d, kTilted) * kTilted);
                                            })),
                radius, [&](const Vec3& p) { return distance(p, middle) < 16; });
  }
}

// Three materials around one tilted straight line; material 1 is the wedge of `angle_deg`.
struct Wedge {
  Vec3 origin, along, x, y;
  double half_angle;

  Wedge(const GridFrame& frame, double angle_deg)
      : origin(off_middle(frame)),
        along(normalized(Vec3{0.2, 0.15, 1})),
        x(normalized(cross(Vec3{0.1, 1, 0}, along))),
        y(cross(along, x)),
        half_angle(0.5 * angle_deg * M_PI / 180) {}

  [[nodiscard]] double signed_distance(MaterialId m, const Vec3& p) const {
    const double px = dot(p - origin, x), py = dot(p - origin, y);
    const auto sector = [&](double from, double to) {
      const double inside =
          0.5 * (to - from) -
          std::abs(std::remainder(std::atan2(py, px) - 0.5 * (from + to), 2 * M_PI));
      const double d = std::hypot(px, py) * std::sin(std::min(std::abs(inside), M_PI / 2));
      return inside > 0 ? d : -d;
    };
    switch (m) {
      case 1:
        return sector(-half_angle, half_angle);
      case 2:
        return sector(half_angle, M_PI);
      case 3:
        return sector(-M_PI, -half_angle);
      default:
        return -100;
    }
  }

  [[nodiscard]] double radius(const Vec3& p) const {
    return std::hypot(dot(p - origin, x), dot(p - origin, y));
  }

  [[nodiscard]] bool is_central(const Vec3& p) const {
    return std::abs(dot(p - origin, along)) < 8;
  }
};

TEST_CASE("local_feature_size: does not collapse towards the curve of a wedge", "[sizing][unit]") {
  const auto frame = plain_frame({64, 64, 32});
  for (const double angle : {26.0, 60.0, 90.0, 120.0}) {
    INFO("angle " << angle);
    const Wedge wedge(frame, angle);
    const auto m = measure(analytic_level_sets(frame, 4, [&](MaterialId material, const Vec3& p) {
      return wedge.signed_distance(material, p);
    }));
    // Nothing but the wedge is there: the next features are the ends of the line, 13 mm away.
    // Half of that is the least that the distance between curves may give.
    CHECK(quantile(m, 0.01,
                   [&](const Vec3& p) { return wedge.is_central(p) && wedge.radius(p) < 20; }) > 4);
  }
}

TEST_CASE("local_feature_size: a needle of 10 degrees is small at its tip only", "[sizing][unit]") {
  const auto frame = plain_frame({90, 64, 32});
  const Wedge wedge(frame, 10);
  const auto m = measure(analytic_level_sets(frame, 4, [&](MaterialId material, const Vec3& p) {
    return wedge.signed_distance(material, p);
  }));
  // Up to 10 mm from its edge the wedge is thinner than two voxels, and comes to pieces there.
  CHECK(quantile(m, 0.01, [&](const Vec3& p) {
          return wedge.is_central(p) && wedge.radius(p) > 10 && wedge.radius(p) < 26;
        }) > 4);
}

TEST_CASE("local_feature_size: a thin plate that ends at a curve stays thin", "[sizing][unit]") {
  // A disk of material 1 lies on 2, under 3; all three meet at its rim.
  const auto frame = plain_frame({60, 60, 32});
  const Vec3 middle = off_middle(frame);
  const double thickness = 3, rim = 22;
  const auto m = measure(analytic_level_sets(frame, 4, [&](MaterialId material, const Vec3& p) {
    const double r = std::hypot(p.x - middle.x, p.y - middle.y), z = p.z - middle.z;
    const double disk = std::min({rim - r, z, thickness - z});
    switch (material) {
      case 1:
        return disk;
      case 2:
        return -z;
      case 3:
        return std::min(z, -disk);
      default:
        return -100.0;
    }
  }));
  check_truth(m, thickness / 2, [&](const Vec3& p) {
    return std::hypot(p.x - middle.x, p.y - middle.y) < rim - 6 && p.z > middle.z - 1 &&
           p.z < middle.z + thickness + 1;
  });
}

TEST_CASE("local_feature_size: a curve has its radius of curvature", "[sizing][unit]") {
  // A ball cut into halves: the curve is a circle. Without medial points nothing else limits it.
  const auto frame = plain_frame({40, 40, 40});
  const Vec3 middle = off_middle(frame);
  const double radius = 15;
  const auto level_sets = analytic_level_sets(frame, 3, [&](MaterialId material, const Vec3& p) {
    const double ball = radius - distance(p, middle), cut = dot(p - middle, kTilted);
    return material == 0 ? -ball : material == 1 ? std::min(ball, cut) : std::min(ball, -cut);
  });
  const auto context = silent_context();
  const auto dense = extract_interfaces(level_sets, context);
  const auto strata = find_strata(dense);
  REQUIRE(strata.curves.size() == 1);
  const auto lfs = local_feature_size(dense, strata, {}, 1, context);
  std::vector<double> on_curve;
  for (const auto v : strata.curves[0].vertices)
    on_curve.push_back(lfs[v]);
  std::sort(on_curve.begin(), on_curve.end());
  CHECK(on_curve[on_curve.size() / 2] == Approx(radius).epsilon(0.1));
  // The extracted curve strays from the circle by up to 0.6 voxel, which bends it here and there.
  CHECK(on_curve[on_curve.size() / 20] > 0.5 * radius);
  CHECK(on_curve.front() > 0.4 * radius);
}

TEST_CASE("local_feature_size: bounded by the box where nothing limits it", "[sizing][unit]") {
  const auto frame = plain_frame({20, 20, 20});
  const auto m = measure(
      analytic_level_sets(frame, [&](const Vec3& p) { return p.z - middle_of(frame).z - 0.2; }));
  for (std::size_t v = 0; v < m.lfs.size(); ++v) {
    CHECK(m.lfs[v] > 0);
    CHECK(m.lfs[v] < 20 * std::sqrt(3.0) + 1);
  }
}

}  // namespace
}  // namespace cvmesh
