// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/flat_triangle.h"

#include <algorithm>
#include <cmath>

namespace cvmesh {
namespace {

// Height over length of the thinnest triangle with a plane: the rounding of its corners turns the
// plane by less than 1e-9.
constexpr double kThin = 1e-6;

}  // namespace

FlatTriangle::FlatTriangle(const Vec3& a, const Vec3& b, const Vec3& c) : corner_{a, b, c} {
  const Vec3 ab = b - a, ac = c - a;
  length_ = {norm(ab), norm(c - b), norm(ac)};
  const double longest = std::max({length_[0], length_[1], length_[2]});
  const Vec3 area2 = cross(ab, ac);
  const double height_times_length = norm(area2);
  is_thin_ = !(height_times_length > kThin * longest * longest);
  if (is_thin_) return;
  along_ = ab / length_[0];
  normal_ = area2 / height_times_length;
  across_ = cross(normal_, along_);
  const double x_c = dot(ac, along_), y_c = dot(ac, across_);
  bc_ = {(x_c - length_[0]) / length_[1], y_c / length_[1]};
  ac_ = {x_c / length_[2], y_c / length_[2]};
}

DoublePair FlatTriangle::squared_distance_thin(const Vec3Pair& p) const {
  DoublePair result{};
  for (int lane = 0; lane < 2; ++lane) {
    const Vec3 q = p.at(lane);
    result[lane] = squared_norm(q - nearest_on_triangle(q, corner_[0], corner_[1], corner_[2]));
  }
  return result;
}

}  // namespace cvmesh
