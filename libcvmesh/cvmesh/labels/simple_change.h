// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"

#include <array>

namespace cvmesh {

/// Neighbours of a node on the Freudenthal lattice: the steps +m for m = 1..7 (bits 0, 1, 2 are x,
/// y, z), then -m in the same order. They are the vertices of its link, a triangulated sphere of
/// 36 edges and 24 triangles.
inline constexpr std::array<std::array<int, 3>, 14> kLinkSteps{{{1, 0, 0},
                                                                {0, 1, 0},
                                                                {1, 1, 0},
                                                                {0, 0, 1},
                                                                {1, 0, 1},
                                                                {0, 1, 1},
                                                                {1, 1, 1},
                                                                {-1, 0, 0},
                                                                {0, -1, 0},
                                                                {-1, -1, 0},
                                                                {0, 0, -1},
                                                                {-1, 0, -1},
                                                                {0, -1, -1},
                                                                {-1, -1, -1}}};

/// One of eight colours; nodes of one colour are never neighbours on the lattice, so that changes
/// of them do not see each other.
constexpr int lattice_colour(int i, int j, int k) {
  return (i & 1) | (j & 1) << 1 | (k & 1) << 2;
}

/// True when node (i, j, k) may take material `to` without a change of topology: the voxels of
/// every material, the exterior included, keep components, tunnels and cavities on the 14-neighbour
/// lattice, and no two materials touch that did not touch around the node before.
///
/// A material keeps its homotopy type when its part of the node's link is contractible; that is
/// asked of the material that loses the node and of the one that gets it, in the grid and, for a
/// node of the border, in each face and edge of the box that holds it, so that the traces of the
/// materials on the box keep theirs too. A corner of the box never changes. Constant time.
bool is_simple_change(const Grid<MaterialId>& labels, int i, int j, int k, MaterialId to);

}  // namespace cvmesh
