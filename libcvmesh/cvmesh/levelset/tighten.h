// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/guarded_flow.h"
#include "cvmesh/levelset/level_sets.h"

#include <cstddef>
#include <map>
#include <vector>

namespace cvmesh {

struct TightenOptions {
  double r_vox = 0.8;          ///< smallest radius of curvature, voxels of the working grid; 0: off
  int smoothing_sweeps = 120;  ///< of the constrained biharmonic smoothing
  double margin = 0.05;        ///< least magnitude at a node, in voxels, with the sign of its label
  int max_iterations = 200;    ///< upper bound of each guarded flow (r of a voxel and more)
  std::map<MaterialId, double> r_vox_of;  ///< overrides `r_vox` for single materials
};

struct TightenStats {
  int iterations = 0;                 ///< of the guarded flows
  int sweeps = 0;                     ///< of the biharmonic smoothing
  std::size_t nodes_changed = 0;      ///< nodes whose label differs from the input's
  std::size_t nodes_guarded = 0;      ///< moves refused: they would have changed a topology
  std::vector<GuardedPlace> guarded;  ///< where, most nodes first
};

struct TightenResult {
  LevelSets level_sets;
  TightenStats stats;
};

/// The level sets smoothed within radius r, every label kept [Williams 2005, Lempitsky 2010].
///
/// Up to a radius below one voxel no node changes its label, and the stairs go by constrained
/// biharmonic smoothing alone (`smooth_level_sets`). From one voxel on the node labels first go
/// through curvature flow between opening and closing, under the topology guard (`guarded_flow`).
/// Where two materials share a boundary the smaller of their radii counts.
///
/// @param level_sets  as `build_level_sets` made them
TightenResult tighten(LevelSets level_sets,
                      const TightenOptions& options,
                      const StageContext& context);

}  // namespace cvmesh
