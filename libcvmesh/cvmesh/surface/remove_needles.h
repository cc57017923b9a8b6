// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <cstddef>

namespace cvmesh {

struct RemoveNeedlesStats {
  std::size_t removed = 0;  ///< vertices
};

struct RemoveNeedlesResult {
  MaterialSurfaces surfaces;
  RemoveNeedlesStats stats;
};

/// Takes out vertices that only make facets flat. Where particles lie in a row on one side of a
/// long facet of the dense surface, no flip helps: there is but one triangulation, all of needles.
///
/// Vertices inside a patch go, at the flattest facets first. As in decimation the hole is closed by
/// the triangulation with the least objective, and every facet made is better than the one that
/// made the vertex go. The vertex that goes lies at most a needle's width from one that stays, or
/// from the side of a cap; how far the surface moves has no bound of its own.
/// @param deviation_vox  as in `DecimateOptions`
/// @throws Error Limit when cancelled
RemoveNeedlesResult remove_needles(MaterialSurfaces surfaces,
                                   double voxel_mm,
                                   double deviation_vox,
                                   const StageContext& context);

}  // namespace cvmesh
