// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"

#include <vector>

namespace cvmesh {

/// A place where the sparse surface misses the dense one.
struct DeviationSpot {
  Vec3 position;  ///< on the dense surface, grid mm
  double distance_mm = 0;
};

struct Deviation {
  double max_mm = 0;                 ///< over all places looked at
  std::vector<DeviationSpot> above;  ///< those farther away than the limit
};

/// How far a thinned surface is from the dense one: from every dense vertex to the surface, and
/// from its vertices, the middles of its edges and regular points of its facets to the dense
/// surface.
/// @param spacing_mm  of the points of a facet
/// @note  O(n log n); parallel
Deviation measure_deviation(const InterfaceMesh& surface,
                            const InterfaceMesh& dense,
                            double limit_mm,
                            double spacing_mm);

}  // namespace cvmesh
