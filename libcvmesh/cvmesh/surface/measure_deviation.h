// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <vector>

namespace cvmesh {

/// A place where the sparse surface misses the dense one.
struct DeviationSpot {
  Vec3 position;  ///< on the dense surface, grid mm
  double distance_mm = 0;
};

struct Deviation {
  double max_mm = 0;                 ///< over all places looked at
  std::vector<DeviationSpot> above;  ///< those farther away than the limit, in order of the facets
};

/// How far a thinned surface is from the dense one, looked at where it costs little: from every
/// sample that a facet carries to that facet (not less than its distance to the surface), and from
/// the centre of each facet and the middles of its edges to the facets around the nearest dense
/// vertex (not less than the distance to the dense surface).
Deviation measure_deviation(const MaterialSurfaces& surfaces,
                            const InterfaceMesh& dense,
                            double limit_mm);

}  // namespace cvmesh
