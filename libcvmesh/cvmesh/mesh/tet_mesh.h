// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A conformal tetrahedral mesh of all materials. Tets have positive volume (`volume6 > 0` in
/// grid mm); the first `surface.points.size()` points are the surface's, unchanged and in order;
/// every facet of `surface` is a face of a tet.
struct TetMesh {
  std::vector<Vec3> points;  ///< grid mm
  std::vector<std::array<std::int32_t, 4>> tets;
  std::vector<MaterialId> material_of;  ///< per tet, never the exterior
  InterfaceMesh surface;                ///< interfaces and outer boundary
};

}  // namespace cvmesh
