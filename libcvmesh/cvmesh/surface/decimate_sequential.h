// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/surface/decimate.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// How the material surfaces are thinned out.
enum class Schedule {
  LockStep,    ///< all together: every removal in all meshes of the vertex, or in none
  Sequential,  ///< each on its own, made conformal afterwards (paper, Algorithm 7.3.1)
};

/// A facet of one material's own sparse boundary.
struct OwnFacet {
  PatchKey patch;                        ///< as in the surfaces of all materials
  std::array<std::int32_t, 3> vertices;  ///< ids there; the smallest first, counter-clockwise seen
                                         ///< from the outside material of the patch
  std::vector<Vec3> samples;             ///< removed vertices that it stands for; see `is_master`
};

/// The closed boundary of one material, in order of (patch, vertices).
using OwnBoundary = std::vector<OwnFacet>;

/// Of the two materials of an interface the master is the one of the smaller label, which is the
/// outside one; the exterior is smaller than all.
inline bool is_master(MaterialId material, const PatchKey& patch) {
  return patch.sides.outside == material;
}

struct DecimateSequentialResult {
  std::vector<OwnBoundary> boundaries;  ///< per material; samples only where it is the master
  /// Vertices count once: removed are those that went from all of their meshes, kept those that
  /// stayed in one or more. Deferrals and refusals are summed over the meshes.
  DecimateStats stats;
  std::size_t repeated = 0;  ///< boundaries thinned out again, for the sake of a vertex that stays
};

/// The sparse boundary of every material, each thinned out as if it were alone: `decimate` on a
/// copy of its mesh, in a random order of its own. The copies know nothing of each other, so their
/// edges on a shared interface differ, and facets of two of them may intersect.
///
/// A vertex that one boundary cannot lose has to stay in all (the paper has no such vertices):
/// those that lost it are thinned out again, and keep it. A few rounds settle that, or the vertex
/// is left for `conform_edges` to find.
/// @param keep  one entry per vertex of `surfaces`: true for particles
/// @throws Error as `decimate`
DecimateSequentialResult decimate_sequential(const MaterialSurfaces& surfaces,
                                             const std::vector<bool>& keep,
                                             double voxel_mm,
                                             const DecimateOptions& options,
                                             const StageContext& context);

}  // namespace cvmesh
