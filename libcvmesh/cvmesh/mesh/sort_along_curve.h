// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"

namespace cvmesh {

/// Renumbers points and facets along a Z curve through space [Morton 1966], so that what lies
/// together on a surface lies together in memory: every later stage walks over small
/// neighbourhoods. Points go by the cell that holds them, then by their old number; facets by their
/// smallest vertex, then by their old number.
/// @param cell_mm  side of the cells, about an edge; 2^21 of them along each axis at most
void sort_along_curve(InterfaceMesh& mesh, double cell_mm);

/// The same for the tets, by the cells of their centroids, and for the points inside; points of the
/// surface and facets keep their numbers.
void sort_along_curve(TetMesh& mesh, double cell_mm);

}  // namespace cvmesh
