// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/core/vec3_pair.h"

#include <array>

namespace cvmesh {

/// A triangle in coordinates of its own plane, for the distances of many points: no branches, two
/// points at a time. Up to rounding the same as `nearest_on_triangle`, which it asks for triangles
/// so thin that their plane is uncertain.
class FlatTriangle {
 public:
  FlatTriangle() = default;
  FlatTriangle(const Vec3& a, const Vec3& b, const Vec3& c);

  [[nodiscard]] DoublePair squared_distance(const Vec3Pair& p) const {
    if (is_thin_) return squared_distance_thin(p);
    const Vec3 &o = corner_[0], &i = along_, &j = across_, &k = normal_;
    const DoublePair px = p.x - o.x, py = p.y - o.y, pz = p.z - o.z;
    const DoublePair x = px * i.x + py * i.y + pz * i.z;
    const DoublePair y = px * j.x + py * j.y + pz * j.z;
    const DoublePair z = px * k.x + py * k.y + pz * k.z;
    // Of each edge: how far outside of its line, how far along it.
    const DoublePair out_ab = -y;
    const DoublePair x_b = x - length_[0];
    const DoublePair out_bc = x_b * bc_[1] - y * bc_[0], along_bc = x_b * bc_[0] + y * bc_[1];
    const DoublePair out_ca = y * ac_[0] - x * ac_[1], along_ac = x * ac_[0] + y * ac_[1];
    // Within its plane, a point outside of the triangle is nearest to one of the edges.
    const DoublePair to_edge = smaller_of(
        smaller_of(to_segment(out_ab, x, length_[0]), to_segment(out_bc, along_bc, length_[1])),
        to_segment(out_ca, along_ac, length_[2]));
    const DoublePair outmost = larger_of(larger_of(out_ab, out_bc), out_ca);
    return z * z + (outmost > 0 ? to_edge : DoublePair{});
  }

 private:
  static DoublePair to_segment(const DoublePair& off, const DoublePair& along, double length) {
    const DoublePair beyond = larger_of(larger_of(-along, along - length), DoublePair{});
    return off * off + beyond * beyond;
  }

  [[nodiscard]] DoublePair squared_distance_thin(const Vec3Pair& p) const;

  std::array<Vec3, 3> corner_;
  bool is_thin_ = true;
  Vec3 along_, across_, normal_;       // the axes: ab, in the plane, out of it
  std::array<double, 3> length_{};     // of ab, bc, ac
  std::array<double, 2> bc_{}, ac_{};  // unit vectors in the plane
};

}  // namespace cvmesh
