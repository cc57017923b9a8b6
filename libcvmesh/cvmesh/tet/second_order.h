// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <array>
#include <cstddef>

namespace cvmesh {

struct SecondOrderStats {
  std::size_t mid_nodes = 0;
  std::size_t moved = 0;      ///< onto the surface, in whole or in part
  std::size_t held_back = 0;  ///< of them those that a Jacobian kept from the surface itself
  double max_shift_mm = 0;    ///< from the middle of the edge
  double least_jacobian = 1;  ///< of all tets: its lower bound over the straight tet's
};

/// Gives every edge of the mesh a node in its middle: tets of second order.
///
/// With a `dense` surface, the nodes on edges of the mesh's surface move to its nearest point: on
/// the same interface, or on a curve between the same interfaces, and not on the border of the
/// image. A node whose move would spoil a tet goes back by halves, and in the end altogether: a tet
/// is sound while all coefficients of its Jacobian determinant, in Bernstein form, are at least a
/// tenth of the straight tet's, which bounds the determinant from below everywhere inside
/// [Johnen 2013].
/// @param dense  in the frame of the mesh; null: all nodes stay in the middle
SecondOrderStats make_second_order(TetMesh& mesh,
                                   const InterfaceMesh* dense,
                                   const StageContext& context);

/// Lower bound of the Jacobian determinant of a tet of second order, over six times the volume of
/// the straight tet with its corners: 1 for a straight tet, 0 or less where it may fold over.
/// @param mids  in the order of `TetMesh::mid_of`
double least_jacobian(const std::array<Vec3, 4>& corners, const std::array<Vec3, 6>& mids);

}  // namespace cvmesh
