// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <vector>

namespace cvmesh {

/// Extends values at points over a grid: u(x) = min over the points of value + delta |x - point|.
///
/// The viscosity solution of |grad u| = delta with the points as sources [Persson 2006], by fast
/// sweeping [Zhao 2005] from the nodes of the cells that hold a point, where the formula is exact.
/// The first-order scheme overestimates distances slightly, by less than a spacing.
/// @param frame  coarsened by a whole number until it has at most `max_nodes` nodes
/// @note  4 bytes per node; linear
Grid<float> extend_from_points(const std::vector<Vec3>& points,
                               const std::vector<double>& values,
                               double delta,
                               const GridFrame& frame,
                               std::size_t max_nodes);

/// Lowers `values` at the vertices of `mesh` until no two ends of an edge differ by more than
/// `delta` times its length. The result is the largest such function below the values, so it does
/// not depend on the order of the updates. O(n log n) in the number of vertices that change.
void limit_along_edges(const InterfaceMesh& mesh,
                       const VertexStars& stars,
                       double delta,
                       std::vector<double>& values);

}  // namespace cvmesh
