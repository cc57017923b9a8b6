// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"

#include <cstddef>

namespace cvmesh {

struct TightenOptions {
  double r_vox = 0.8;         ///< smallest radius of curvature, voxels of the working grid; 0: off
  int smoothing_sweeps = 100;  ///< upper bound of the constrained biharmonic sweeps
  double margin = 0.05;       ///< least magnitude at a node, with the sign of its label
  int max_iterations = 200;   ///< upper bound of the guarded flow (r of a voxel and more)
};

struct TightenStats {
  int iterations = 0;             ///< of the guarded flow
  int sweeps = 0;                 ///< of the biharmonic smoothing
  std::size_t nodes_changed = 0;  ///< nodes whose label differs from the input's
  std::size_t nodes_guarded = 0;  ///< moves refused: they would have changed a topology
};

struct TightenResult {
  LevelSets level_sets;
  TightenStats stats;
};

/// The level sets smoothed within radius r, every label kept [Williams 2005, Lempitsky 2010].
TightenResult tighten(LevelSets level_sets,
                      const TightenOptions& options,
                      const StageContext& context);

}  // namespace cvmesh
