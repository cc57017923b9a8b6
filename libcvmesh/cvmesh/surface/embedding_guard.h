// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <cstdint>
#include <span>
#include <vector>

namespace cvmesh {

/// An index of all living facets; whoever edits the surfaces keeps it.
FacetIndex index_facets(const MaterialSurfaces& surfaces, double voxel_mm);

/// Puts a new or changed facet into the index.
void insert_facet(const MaterialSurfaces& surfaces, std::int32_t facet, FacetIndex& index);

/// Clearance that decimation and flips keep, in voxels: what a file in single precision, and
/// TetGen's tolerance, still tell apart. More (0.02) made vertices stay in narrow places, 57
/// instead of 10 on the spine at epsilon 4, and tets there poorer.
inline constexpr double kClearanceVox = 0.001;

/// Decides whether facets may change places without any two facets intersecting or one part of the
/// surface jumping over another.
///
/// A change is looked at in two steps: `begin` collects what is near, then the questions. Nothing
/// is written to the surfaces and the index, so that guards of several threads may look at them at
/// the same time.
class EmbeddingGuard {
 public:
  /// Both must outlive the guard.
  /// @param clearance_mm  facets without a common vertex must stay this far from each other
  EmbeddingGuard(const MaterialSurfaces& surfaces, const FacetIndex& index, double clearance_mm)
      : surfaces_(surfaces), index_(index), clearance_mm_(clearance_mm) {}

  /// Collects the facets near `box` that are not among `replaced`.
  /// @param ring  vertices that belong to the change itself
  void begin(const Box3& box,
             std::span<const std::int32_t> replaced,
             std::span<const std::int32_t> ring);

  /// Facets that `begin` collected.
  [[nodiscard]] const std::vector<FacetIndex::Entry>& nearby() const { return nearby_; }

  /// True when triangle t meets a nearby facet in more than shared vertices and edges, or has none
  /// in common with it and comes nearer than the clearance.
  [[nodiscard]] bool intersects_nearby(const VertexTriple& t) const;

  /// True when a vertex of a nearby facet, other than those of the ring of the change, lies in the
  /// tet between `apex` and triangle t: t would jump over it.
  [[nodiscard]] bool sweeps_over_vertex(const Vec3& apex, const VertexTriple& t) const;

 private:
  const MaterialSurfaces& surfaces_;
  const FacetIndex& index_;
  double clearance_mm_;
  std::vector<FacetIndex::Entry> nearby_;
  std::vector<std::int32_t> nearby_vertices_;
};

}  // namespace cvmesh
