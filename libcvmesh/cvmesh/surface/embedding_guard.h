// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <cstdint>
#include <span>
#include <vector>

namespace cvmesh {

/// Decides whether facets may change places without any two facets intersecting or one part of the
/// surface jumping over another. Keeps an index of all living facets; whoever edits the surfaces
/// tells it.
///
/// A change is looked at in three steps: `begin` collects what is near, then the questions, then
/// the edit itself with `remove` before and `insert` after.
class EmbeddingGuard {
 public:
  EmbeddingGuard(const MaterialSurfaces& surfaces, double voxel_mm);

  /// Collects the facets near `box` that are not among `replaced`.
  void begin(const Box3& box, std::span<const std::int32_t> replaced);

  /// Facets that `begin` collected.
  [[nodiscard]] const std::vector<std::int32_t>& nearby() const { return nearby_; }

  /// True when triangle t meets a nearby facet in more than shared vertices and edges.
  [[nodiscard]] bool intersects_nearby(const VertexTriple& t) const;

  /// True when a vertex of a nearby facet, other than those of the ring of the change (`mark_ring`)
  /// lies in the tet between `apex` and triangle t: t would jump over it.
  [[nodiscard]] bool sweeps_over_vertex(const Vec3& apex, const VertexTriple& t) const;

  /// Tells the vertices that belong to the change itself.
  void mark_ring(std::span<const std::int32_t> vertices);

  void remove(std::int32_t facet) { index_.remove(facet); }

  void insert(std::int32_t facet);

 private:
  const MaterialSurfaces& surfaces_;
  FacetIndex index_;
  std::vector<std::int32_t> nearby_;
  std::vector<Box3> nearby_box_;
  std::vector<std::int32_t> nearby_vertices_;
  std::vector<std::uint32_t> facet_stamp_, vertex_stamp_;
  std::uint32_t stamp_ = 0;
};

}  // namespace cvmesh
