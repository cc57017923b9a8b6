// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A point that a facet stands for.
struct FacetSample {
  std::int32_t facet;
  Vec3 position;  ///< grid mm
};

struct CompactionStats {
  std::size_t merged_vertices = 0;  ///< that went into others
  std::size_t barred_nodes = 0;     ///< around which none was merged, facets being too near there
};

struct CompactInterfaces {
  InterfaceMesh mesh;
  /// Where the vertices were that were merged, each with the facet nearest to it.
  std::vector<FacetSample> samples;
  CompactionStats stats;
};

/// Merges dense vertices next to the same lattice node where the surface is smooth there: a third
/// of them is left on a smooth surface, and what later stages take falls with them [Moore 1992,
/// Treece 1999].
///
/// What `extract_interfaces` promises is kept. Topology: edges are contracted one by one, and only
/// where the link condition [Dey 1999] holds. Embedding: no node comes to another side, so
/// that nothing is jumped over; and no two facets intersect or come nearer to each other than the
/// clearance, which is tested. Volume: a merged vertex is put where the volumes on both of its
/// sides stay as they were [Lindstrom 1998]. Shape: facets turn by little, and what is left
/// stays within a few hundredths of a voxel of every vertex that went. Where that cannot be,
/// vertices stay; so do those on curves, on the box and in the layer before it.
///
/// O(n log n), and the same at any number of threads.
/// @param mesh          from `extract_interfaces`
/// @param frame         of its lattice
/// @param clearance_mm  between facets, but for what they share
CompactInterfaces compact_interfaces(const InterfaceMesh& mesh,
                                     const GridFrame& frame,
                                     double clearance_mm,
                                     const StageContext& context);

}  // namespace cvmesh
