// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <vector>

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"

namespace cvmesh {

/// Points of the medial axis of every material, the exterior included, in grid mm.
struct MedialAxis {
  std::vector<Vec3> points;
  std::vector<double> radius_mm;           ///< distance to the nearest boundary site
  std::vector<MaterialId> material_of;
};

}  // namespace cvmesh
