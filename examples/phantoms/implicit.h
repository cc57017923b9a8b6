// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <vector>

/// Implicit shapes: functions that are negative inside and, near their zero set, close to the
/// distance from it. Lengths in mm.
namespace cvmesh::examples {

inline double ellipsoid(const Vec3& p, const Vec3& centre, const Vec3& semi_axes) {
  const Vec3 q = divided_by(p - centre, semi_axes);
  const double value = norm(q), slope = norm(divided_by(q, semi_axes));
  if (slope == 0) return -std::min(semi_axes.x, std::min(semi_axes.y, semi_axes.z));
  return value * (value - 1) / slope;  // first order distance
}

/// A thick segment whose radius goes from `radius_a` at a to `radius_b` at b, with round ends.
inline double thick_segment(
    const Vec3& p, const Vec3& a, const Vec3& b, double radius_a, double radius_b) {
  const double t = std::clamp(dot(p - a, b - a) / squared_norm(b - a), 0.0, 1.0);
  return distance(p, a + t * (b - a)) - (radius_a + t * (radius_b - radius_a));
}

/// Signed distance along rays from the centre of |x/a|^n + |y/b|^n = 1.
inline double superellipse(double x, double y, double a, double b, double exponent) {
  const double r = std::hypot(x, y);
  if (r < 1e-9 * (a + b)) return -std::min(a, b);
  const double u = std::abs(x / a), v = std::abs(y / b);
  const double k = exponent == 2
                       ? std::hypot(u, v)
                       : std::pow(std::pow(u, exponent) + std::pow(v, exponent), 1 / exponent);
  return r - r / k;
}

/// Union that blends over a width of about `blend`.
inline double smooth_union(double a, double b, double blend) {
  const double h = std::max(blend - std::abs(a - b), 0.0) / blend;
  return std::min(a, b) - h * h * blend / 4;
}

inline double smooth_intersection(double a, double b, double blend) {
  return -smooth_union(-a, -b, blend);
}

/// A smooth curve z -> value through given points; constant beyond the first and the last.
class Profile {
 public:
  struct Point {
    double z, value;
  };

  Profile(std::initializer_list<Point> points) : points_(points) {}

  double operator()(double z) const {
    if (z <= points_.front().z) return points_.front().value;
    if (z >= points_.back().z) return points_.back().value;
    const auto next = std::upper_bound(points_.begin(), points_.end(), z,
                                       [](double at, Point p) { return at < p.z; });
    const auto n = static_cast<std::size_t>(next - points_.begin());
    const double width = points_[n].z - points_[n - 1].z;
    const double t = (z - points_[n - 1].z) / width;
    // Cubic Hermite with secant slopes; zero at both ends keeps the curve smooth where it stops.
    const double m0 = slope(n - 1) * width, m1 = slope(n) * width;
    const double t2 = t * t, t3 = t2 * t;
    return (2 * t3 - 3 * t2 + 1) * points_[n - 1].value + (t3 - 2 * t2 + t) * m0 +
           (3 * t2 - 2 * t3) * points_[n].value + (t3 - t2) * m1;
  }

 private:
  double slope(std::size_t n) const {
    if (n == 0 || n + 1 == points_.size()) return 0;
    const Point &before = points_[n - 1], &here = points_[n], &after = points_[n + 1];
    if ((here.value - before.value) * (after.value - here.value) <= 0) return 0;  // no overshoot
    return (after.value - before.value) / (after.z - before.z);
  }

  std::vector<Point> points_;
};

}  // namespace cvmesh::examples
