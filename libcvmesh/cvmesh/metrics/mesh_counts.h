// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// How many of what a mesh has; per-material entries are indexed by material id.
struct MeshCounts {
  std::size_t points = 0;             ///< all points of the mesh
  std::size_t surface_vertices = 0;   ///< points that a facet uses
  std::size_t surface_triangles = 0;  ///< facets, those on the box among them
  std::size_t wall_triangles = 0;     ///< facets on the box
  std::size_t interior_points = 0;    ///< Steiner points: points that no facet uses
  std::size_t tets = 0;
  std::vector<std::size_t> tets_of;       ///< [0] stays 0: the exterior has no tets
  std::vector<std::size_t> triangles_of;  ///< facets with the material on either side
};

MeshCounts count_mesh(const TetMesh& mesh, std::size_t material_count);

}  // namespace cvmesh
