// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace cvmesh {

/// A dense vertex that needs smaller edges than the sizing field says.
struct LoweredSize {
  std::int32_t vertex;
  double h_mm;
};

/// Where h has to be lowered on one sheet of the dense surface because a tube or a tunnel is too
/// narrow for it: every short loop that bounds nothing gets room for at least three particles. With
/// fewer, the sparse surface could not have the handle at all.
///
/// A loop bounds nothing if it is not zero in the homology of the sheet with two coefficients. A
/// tree of edges and a tree of facets leave one edge per generator [Eppstein 2003]; random words
/// on these, carried through the tree of facets, make a cocycle that tells such loops by an
/// exclusive or along their edges. Shortest loops come from local shortest-path trees around roots
/// half a target edge apart along the cut where the words are, and are then tightened. Away from a
/// lowered place h may grow with slope 1.7 `delta` again.
/// @param facets  of the sheet, edge-connected
/// @param h_mm    of all dense vertices
/// @return        the vertices whose h is to be lower, ascending
std::vector<LoweredSize> sizes_at_short_loops(const InterfaceMesh& dense,
                                              const std::vector<std::int32_t>& facets,
                                              double delta,
                                              const std::vector<double>& h_mm);

/// Tells where a sheet needs more particles, so that no loop that bounds nothing passes fewer than
/// three cells of the particles' Voronoi diagram: with fewer, no triangulation of the particles has
/// the loop as edges, and the handle would be lost.
///
/// The test is combinatorial. Each cell grows along dense edges from its particle, and every vertex
/// carries the word of its way. A loop in one cell shows as an edge whose words do not cancel, one
/// in two cells as two edges between them with different words.
class LoopTest {
 public:
  /// @param facets  of the sheet, edge-connected
  LoopTest(const InterfaceMesh& dense, const std::vector<std::int32_t>& facets);
  ~LoopTest();
  LoopTest(LoopTest&&) noexcept;

  /// Dense vertices to add. Empty when the particles are enough; otherwise at most one for each
  /// cell, to be added before the next test.
  /// @param particle_vertices  the dense vertex next to each particle on the sheet, rim included
  [[nodiscard]] std::vector<std::int32_t> missing(
      const std::vector<std::int32_t>& particle_vertices) const;

 private:
  struct Sheet;
  std::unique_ptr<Sheet> sheet_;  // null: every loop bounds
};

}  // namespace cvmesh
