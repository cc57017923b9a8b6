// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/surface/triangulate_ring.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace cvmesh {

/// Why a vertex cannot be removed.
enum class Refusal { None, Topology, Shape, Intersection, Jump };

/// As the report calls them.
inline constexpr std::array<const char*, 5> kRefusalNames{"none", "topology", "fold",
                                                          "intersection", "jump"};

/// Removes vertices from all materials at the same time; each hole is closed at once by the
/// triangulation with the least objective that neither meets another facet nor jumps over a vertex.
///
/// All that a removal takes away, makes and looks at meets the box of its rings. So removals whose
/// boxes are apart do not know of each other: a batch of such is planned by all threads on the
/// surfaces as they are, then carried out. (CGAL's Euler operations share a free list in each mesh,
/// so edits of one mesh cannot run at the same time.)
class VertexRemover {
 public:
  /// @param surfaces  is referred to; nobody else may change it
  VertexRemover(MaterialSurfaces& surfaces, double voxel_mm, double deviation_mm);
  ~VertexRemover();

  /// Tries each vertex once; calls `tell(vertex, refusal)` in the order in which they were settled.
  void try_each(const std::vector<std::int32_t>& queue,
                const RingLimits& limits,
                const std::function<void(std::int32_t, Refusal)>& tell);

  /// Plans made so far.
  [[nodiscard]] std::size_t planned() const;

 private:
  class Batches;
  std::unique_ptr<Batches> batches_;
};

}  // namespace cvmesh
