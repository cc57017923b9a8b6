// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Topology of one material's voxels on the 14-neighbour (Freudenthal) lattice: voxel centres are
/// the vertices, cubes are split into six tets around the diagonal (1,1,1), and a simplex belongs
/// to the material when all its vertices do.
struct LatticeTopology {
  std::size_t components = 0;
  long long euler = 0;  ///< V - E + F - T; the boundary surface has twice this
  std::size_t voxels = 0;
};

/// One entry per material id; [0] (the exterior) stays empty. Linear in the number of voxels.
std::vector<LatticeTopology> lattice_topology(const Grid<MaterialId>& ids,
                                              std::size_t material_count);

}  // namespace cvmesh
