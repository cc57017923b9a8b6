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

  /// Of second order: the nodes on the edges, none where the mesh is of first order.
  std::vector<Vec3> mid_points;  ///< grid mm
  /// Per tet, indices into `mid_points`, on the edges 01, 12, 20, 03, 13, 23 (the order of VTK,
  /// Abaqus and CalculiX).
  std::vector<std::array<std::int32_t, 6>> mid_of;
};

}  // namespace cvmesh
