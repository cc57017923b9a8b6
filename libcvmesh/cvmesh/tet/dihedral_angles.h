// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

class OpenTets;

/// A tet is poor with an angle below the first or above the second; finite-element codes lose
/// accuracy, and then convergence, beyond.
inline constexpr double kPoorMinDeg = 12, kPoorMaxDeg = 165;

/// Where a material ends in a wedge narrower than this between two sheets of the surface, its tets
/// cannot do better than the wedge: they are counted apart.
inline constexpr double kNarrowWedgeDeg = 15;

struct PoorTet {
  Vec3 position;  ///< of its centroid, grid mm
  MaterialId material = kExterior;
  double min_deg = 0, max_deg = 0;  ///< of its dihedral angles
  double wedge_deg = 0;             ///< the narrow wedge at one of its edges; 0: none
  double bound_deg = 0;  ///< least of `AngleBounds` over its facets, where below 12; 0: none
};

/// Dihedral angles of a tet mesh with the surface it is bound to.
struct DihedralAngles {
  double min_deg = 180, max_deg = 0;  ///< of all tets
  double min_outside_wedges_deg = 180,
         max_outside_wedges_deg = 0;  ///< poor tets in wedges left out
  std::size_t poor = 0;               ///< outside narrow wedges
  std::size_t poor_in_wedges = 0;
  std::size_t poor_bound_by_surface = 0;  ///< of `poor`: on their facet no tet can be better
  double least_share_of_wedge = 1;        ///< smallest angle over the wedge's, of those in wedges
  std::vector<PoorTet> places;            ///< the poorest first, at most `kMostPlaces`

  static constexpr std::size_t kMostPlaces = 50;
};

/// Linear in the number of tets.
DihedralAngles measure_dihedral_angles(const OpenTets& tets);

}  // namespace cvmesh
