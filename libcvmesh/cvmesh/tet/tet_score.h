// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {

/// How good a tet is, by the two measures that meshes are judged by.
struct TetScore {
  double min_sine = 0;      ///< of the six dihedral angles; 0 when flat, negative when inverted
  double radius_ratio = 0;  ///< 3 r / R, 1 when regular, 0 when flat or inverted
};

/// The score of tet abcd; its radius ratio stays 0 where the smallest sine is below `floor`.
inline TetScore score_any_tet(
    const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, double floor) {
  // All from one corner: u, v, w span the tet, and the area vectors of its faces follow from the
  // three cross products (they sum to zero).
  const Vec3 u = b - a, v = c - a, w = d - a;
  const Vec3 face_d = cross(v, u), face_b = cross(w, v), face_c = cross(u, w);
  const Vec3 face_a = -(face_b + face_c + face_d);
  const double volume = dot(u, cross(v, w));  // six times the tet's
  const double area2_a = squared_norm(face_a), area2_b = squared_norm(face_b);
  const double area2_c = squared_norm(face_c), area2_d = squared_norm(face_d);
  const double ab = squared_norm(u), ac = squared_norm(v), ad = squared_norm(w);
  const double bc = squared_norm(c - b), bd = squared_norm(d - b), cd = squared_norm(d - c);
  // sin(dihedral at edge e) = 3 V |e| / (2 A B), A and B the areas of the two faces on e: in six
  // volumes and doubled areas, volume |e| / (A B). An edge's faces are those opposite the two
  // other corners; over the product of all four areas, the other two stand above the line.
  const double x_ab = ab * area2_a * area2_b, x_ac = ac * area2_a * area2_c;
  const double x_ad = ad * area2_a * area2_d, x_bc = bc * area2_b * area2_c;
  const double x_bd = bd * area2_b * area2_d, x_cd = cd * area2_c * area2_d;
  const double product = (area2_a * area2_b) * (area2_c * area2_d);
  // A face without area makes the sines meaningless; so does a product that underflows.
  if (!(product > 0)) return {volume < 0 ? -1.0 : 0.0, 0};
  const double least = std::min({x_ab, x_ac, x_ad, x_bc, x_bd, x_cd});
  const double most = std::max({x_ab, x_ac, x_ad, x_bc, x_bd, x_cd});
  TetScore score;
  score.min_sine = volume * std::sqrt((volume > 0 ? least : most) / product);
  if (!(volume > 0) || score.min_sine < floor) return score;
  // r = 3 V / sum of areas; 24 V R = sqrt of Heron's product of the products of opposite edges.
  const double x = ab * cd, y = ac * bd, z = ad * bc;
  const double heron = 2 * (x * y + y * z + z * x) - (x * x + y * y + z * z);
  const double areas =
      std::sqrt(area2_a) + std::sqrt(area2_b) + std::sqrt(area2_c) + std::sqrt(area2_d);
  if (heron > 0) score.radius_ratio = 12 * volume * volume / (areas * std::sqrt(heron));
  return score;
}

/// The score of tet abcd. For changes that are refused anyway it saves the time: below `floor` the
/// radius ratio stays 0, and below a floor above 0 all flat and inverted tets get a sine of -1.
inline TetScore score_tet(const Vec3& a,
                          const Vec3& b,
                          const Vec3& c,
                          const Vec3& d,
                          double floor = -std::numeric_limits<double>::infinity()) {
  if (floor > 0 && !(dot(b - a, cross(c - a, d - a)) > 0)) return {-1, 0};
  return score_any_tet(a, b, c, d, floor);
}

/// Smallest sine of the dihedral angles of tet abcd, negative when the tet is inverted, 0 when it
/// is flat.
inline double min_dihedral_sine(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return score_any_tet(a, b, c, d, std::numeric_limits<double>::infinity()).min_sine;
}

}  // namespace cvmesh
