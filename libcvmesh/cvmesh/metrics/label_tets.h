// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// What is wrong with tets, whatever their surface looks like. All zero in a valid mesh.
struct TetFaults {
  std::size_t inverted = 0;         ///< tets turned against most others
  std::size_t flat = 0;             ///< tets of no volume, exactly
  std::size_t repeated_vertex = 0;  ///< tets that use a vertex twice
  std::size_t repeated_tets = 0;    ///< tets with the vertices of another one
  std::size_t crowded_faces = 0;    ///< faces in more than two tets
  std::size_t folded_faces = 0;     ///< faces whose two tets are on the same side

  friend bool operator==(const TetFaults&, const TetFaults&) = default;
};

/// Topology of the tets of one material.
struct SolidTopology {
  std::size_t components = 0;  ///< joined through faces
  long long euler = 0;         ///< V - E + F - T
};

/// A mesh made of labelled tets from anywhere.
struct LabelledTets {
  TetMesh mesh;  ///< facets where materials meet or tets end; as many faults as the tets have
  TetFaults faults;
  std::vector<SolidTopology> solids;  ///< by material id
  std::size_t unused_points = 0;
};

/// The mesh that tets with materials form: its facets are the faces between unequal materials and
/// those of one tet only, whose other side is the exterior; a facet in the planes of the box of
/// `frame` is a wall. Where most tets have a negative volume, all are turned over. Points that no
/// tet uses are left out. O(n log n).
///
/// @param points  in the grid mm of `frame`
/// @param tets    indices in range; tets that use a vertex twice are left out of the mesh
LabelledTets build_label_tets(const std::vector<Vec3>& points,
                              const std::vector<std::array<std::int32_t, 4>>& tets,
                              const std::vector<MaterialId>& material_of,
                              std::size_t material_count,
                              const GridFrame& frame);

}  // namespace cvmesh
