// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace cvmesh {

/// A node of a grid that nothing limits yet.
inline constexpr float kUnlimited = std::numeric_limits<float>::max();

/// `frame` with its spacing multiplied by the smallest whole number that leaves at most `max_nodes`
/// nodes. Node (i, j, k) is node `factor` times (i, j, k) of `frame`; the last one of an axis lies
/// at the last one of `frame` or beyond it.
GridFrame coarsened(const GridFrame& frame, std::size_t max_nodes);

/// Extends values at points, and at nodes of a grid, over the grid: u(x) = min over the points and
/// nodes of value + delta |x - point|.
///
/// The viscosity solution of |grad u| = delta with the points as sources [Persson 2006], by fast
/// sweeping [Zhao 2005] from the nodes of the cells that hold a point, where the formula is exact.
/// Nodes are visited only when a neighbour fell since the last visit [Bak 2010], which changes no
/// value. The first-order scheme overestimates distances slightly, by less than a spacing.
/// @param u  values at nodes, `kUnlimited` where there is none
/// @note  linear; 1 byte per node besides
Grid<float> extend_from_points(const std::vector<Vec3>& points,
                               const std::vector<double>& values,
                               double delta,
                               Grid<float> u);

/// The vertices that share an edge with each vertex, as one flat list: those of vertex v are
/// `vertex[first[v]] .. vertex[first[v + 1] - 1]`, each once.
struct VertexNeighbours {
  std::vector<std::int32_t> first, vertex;
};

VertexNeighbours find_vertex_neighbours(const InterfaceMesh& mesh, const VertexStars& stars);

/// Lowers `values` at the vertices until no two ends of an edge differ by more than `delta` times
/// its length. The result is the largest such function below the values, so it does not depend on
/// the order of the updates, not even in its last bits. Parallel; fast where vertices with near
/// numbers lie near to each other.
void limit_along_edges(const std::vector<Vec3>& points,
                       const VertexNeighbours& neighbours,
                       double delta,
                       std::vector<double>& values);

}  // namespace cvmesh
