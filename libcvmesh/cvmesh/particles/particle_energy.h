// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace cvmesh::particle_energy {

/// Meyer's radial energy of a pair at scaled distance d, E(d) = ((1 - d) / d)^2 for d < 1
/// [Meyer 2007]. Distances are scaled by kScale over the target edge length, so that in the
/// hexagonal layout with edges h the six neighbours sit at d = kScale and the next ring at the
/// cut-off d = 1.
///
/// The target edge length of a pair is the mean of both h. Meyer takes the smaller one; on a
/// graded surface that asks for edges shorter than the field says everywhere (by a sixth where h
/// grows by 0.4), and the density would no longer be 2 / (sqrt 3 h^2).
inline constexpr double kScale = 0.57735026918962576;      // 1 / (2 cos 30 degrees)
inline constexpr double kReach = 1 / kScale;               // influence radius over h
inline constexpr double kIdeal = 6 * 0.53589838486224541;  // six neighbours at d = kScale

/// d is bounded from below so that two particles in one place still have finite forces.
inline constexpr double kLeastDistance = 1e-3;

inline double pair(double d) {
  if (d >= 1) return 0;
  const double q = 1 / std::max(d, kLeastDistance) - 1;
  return q * q;
}

/// dE/dd and d2E/dd2 for d < 1.
inline double slope(double d) {
  const double c = std::max(d, kLeastDistance);
  return -2 * (1 - c) / (c * c * c);
}

inline double curvature(double d) {
  const double c = std::max(d, kLeastDistance);
  return (6 - 4 * c) / (c * c * c * c);
}

/// The Delaunay neighbours of a particle in its tangent plane: indices into `offsets` (vectors
/// from the particle), counter-clockwise. Each offset is turned into the plane with its length
/// kept, as if the surface were unrolled. Inversion maps the Delaunay star of the origin to a
/// convex hull: v -> v / |v|^2.
struct Star {
  std::vector<std::int32_t> ring;
  bool is_closed = false;  ///< false at a rim: the neighbours leave a gap above 180 deg
  double hole_radius = 0;  ///< largest circumradius of the star's triangles
  Vec3 hole_centre;        ///< its centre, relative to the particle
};

Star find_star(std::span<const Vec3> offsets, const Vec3& normal);

}  // namespace cvmesh::particle_energy
