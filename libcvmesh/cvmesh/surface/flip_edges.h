// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"

namespace cvmesh {

struct FlipEdgesOptions {
  double deviation_vox = 0.5;  ///< as in `DecimateOptions`
  int max_passes = 20;
};

struct FlipEdgesStats {
  std::size_t flips = 0, refused = 0;
  int passes = 0;
};

struct FlipEdgesResult {
  MaterialSurfaces surfaces;
  FlipEdgesStats stats;
};

/// Flips interface edges in lock-step while that lowers the objective of the decimation.
FlipEdgesResult flip_edges(MaterialSurfaces surfaces,
                           double voxel_mm,
                           const FlipEdgesOptions& options,
                           const StageContext& context);

}  // namespace cvmesh
