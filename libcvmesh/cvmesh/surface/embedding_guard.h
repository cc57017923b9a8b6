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

/// Clearance that decimation and flips keep, in voxels: what TetGen's tolerance, and rounding to
/// the file's coordinates, still tell apart. Without it facets folded onto each other to the last
/// bit remained at tiny contacts of labels; their tets turned over in the file. With more (0.02)
/// vertices stayed in narrow places, 57 instead of 10 on the spine at epsilon 4.
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
  /// @param clearance_mm  how far facets must stay from each other, but for what they share
  EmbeddingGuard(const MaterialSurfaces& surfaces, const FacetIndex& index, double clearance_mm)
      : surfaces_(surfaces), index_(index), clearance_mm_(clearance_mm) {}

  /// Collects the facets near `box` that are not among `replaced`.
  /// @param ring  vertices that belong to the change itself
  void begin(const Box3& box,
             std::span<const std::int32_t> replaced,
             std::span<const std::int32_t> ring);

  /// Facets that `begin` collected.
  [[nodiscard]] const std::vector<FacetIndex::Entry>& nearby() const { return nearby_; }

  /// True when triangle t meets a nearby facet in more than shared vertices and edges, or comes
  /// nearer to it than the clearance.
  [[nodiscard]] bool intersects_nearby(const VertexTriple& t) const;

  /// True when a part of the surface lies in the tet between `apex` and triangle t: t would jump
  /// over it. Parts are the vertices of nearby facets, other than those of the ring of the change,
  /// and the facets that have all theirs on the ring. Of these one point is looked at: a facet that
  /// meets neither the old facets nor the new ones is between them as a whole or not at all.
  [[nodiscard]] bool sweeps_over_part(const Vec3& apex, const VertexTriple& t) const;

 private:
  const MaterialSurfaces& surfaces_;
  const FacetIndex& index_;
  double clearance_mm_;
  std::vector<FacetIndex::Entry> nearby_;
  std::vector<std::int32_t> nearby_vertices_;
  std::vector<Vec3> middles_;  // of nearby facets with all vertices on the ring
};

}  // namespace cvmesh
