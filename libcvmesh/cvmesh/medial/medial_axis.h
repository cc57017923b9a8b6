// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"

#include <vector>

namespace cvmesh {

/// Points of the medial axis of every material, the exterior included, in grid mm.
///
/// A sample of the centres of the largest balls that fit into a material: about one point per voxel
/// of the axis and direction of the grid. Branches that only reach into a wedge at a junction curve
/// are left out, and so are those caused by the staircase of the voxels. In order of the grid, so
/// the same level sets give the same points.
struct MedialAxis {
  std::vector<Vec3> points;
  std::vector<double> radius_mm;  ///< distance to the nearest boundary site
  std::vector<MaterialId> material_of;
};

}  // namespace cvmesh
