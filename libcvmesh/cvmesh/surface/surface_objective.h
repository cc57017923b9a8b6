// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <algorithm>
#include <cmath>

namespace cvmesh {

/// What decimation and flips minimise, summed over facets and edges:
///
///     max(0, d / tau - 1)^2 + kShapeWeight (1 / q - 1)      per facet
///     kFoldWeight max(0, kFoldCosine - cos)^2               per edge inside a patch
///
/// d is the two-sided distance between the facet and the dense samples there, q its shape 2r/R,
/// cos the cosine between the normals of the two facets of an edge. While the distance is below the
/// tolerance tau shape rules, beyond it the distance does.
struct SurfaceObjective {
  /// Shape against distance: a facet of quality 0.5 costs as much as one at 1.7 tau.
  static constexpr double kShapeWeight = 0.5;
  static constexpr double kFoldWeight = 2.0;
  /// Normals up to 60 degrees apart are no fold: sharp edges of real parts cost nothing.
  static constexpr double kFoldCosine = 0.5;
  /// Facets poorer than this cost as much as this: keeps the terms finite.
  static constexpr double kLeastQuality = 1e-4;

  /// tau, in mm. The same for all facets: a tolerance that grows with a facet's own edges rewards
  /// long, poor facets with less regard for their distance (bunny at 558 vertices, tau of at least
  /// a twelfth of the edges: 0.48 voxel from the dense surface instead of 0.44).
  double deviation_mm = 0.25;

  [[nodiscard]] double facet_term(const Vec3& a,
                                  const Vec3& b,
                                  const Vec3& c,
                                  double distance_mm) const {
    return facet_term(triangle_quality(a, b, c), distance_mm);
  }

  /// The same for a facet of known quality.
  [[nodiscard]] double facet_term(double quality, double distance_mm) const {
    const double excess = std::max(0.0, distance_mm / deviation_mm - 1);
    return excess * excess + shape_term(quality);
  }

  /// The other direction: how far the middle of a facet and that of its longest edge are from the
  /// nearest sample, less the `spacing_mm` of the samples. A facet that bridges a gap has no
  /// samples beneath it that would tell. 0 for facets too short to bridge anything.
  /// @param nearest_mm2  squared distance of a point to the nearest sample
  template <typename Nearest>
  [[nodiscard]] double bridge_mm(const Vec3& a,
                                 const Vec3& b,
                                 const Vec3& c,
                                 const Nearest& nearest_mm2,
                                 double spacing_mm) const {
    const double ab = squared_norm(b - a), bc = squared_norm(c - b), ca = squared_norm(a - c);
    const double longest = std::max({ab, bc, ca});
    constexpr double kShort = 16;  // over tau: a fold of such edges is hardly deeper than 4 tau
    if (longest < kShort * kShort * deviation_mm * deviation_mm) return 0;
    const Vec3 side = longest == ab ? a + b : longest == bc ? b + c : c + a;
    const double farthest = std::max(nearest_mm2((a + b + c) / 3), nearest_mm2(0.5 * side));
    return std::max(0.0, std::sqrt(farthest) - spacing_mm);
  }

  [[nodiscard]] static double shape_term(double quality) {
    return kShapeWeight * (1 / std::max(quality, kLeastQuality) - 1);
  }

  /// Of two unit normals.
  [[nodiscard]] static double fold_term(const Vec3& n1, const Vec3& n2) {
    const double excess = std::max(0.0, kFoldCosine - dot(n1, n2));
    return kFoldWeight * excess * excess;
  }
};

}  // namespace cvmesh
