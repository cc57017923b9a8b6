// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"

#include <vector>

namespace cvmesh {

struct SmoothLevelSetsOptions {
  std::vector<double> r_vox;  ///< per material; below 0.8 less is smoothed, at 0 next to nothing
  int sweeps = 120;           ///< of the descent
  double margin_vox = 0.05;   ///< least magnitude at a node, with the sign of its label
};

/// The level sets without the stairs of the voxels, no node having changed its label.
///
/// `level_sets` holds the blurred indicators (`build_level_sets`); the result the fields f of least
///
///     integral |Laplacian f|^2 + pull |f - d|^2,   f positive at own nodes, negative at others,
///
/// the constrained biharmonic smoothing of [Lempitsky 2010] with a weak pull to the distances d
/// that the blurred labels tell. What smoothing takes from convex and thin parts a volume term
/// gives back: d is moved until the volume inside the boundary is that of the voxels, in every
/// window of the boundary.
///
/// The pull grows with (0.8 / r)^4, so that r scales the length of the waves that are smoothed;
/// where materials meet the smallest of their r counts. From 0.8 on all is smoothed that the
/// node constraint allows.
///
/// Works in steps of the grid, also where it is anisotropic: stairs are a matter of the grid, and
/// between thick slices they are as long as the slices are thick.
///
/// 12 bytes for each node of the band; time linear in nodes times sweeps. Deterministic; parallel
/// over blocks.
/// @param first_progress  fraction of the stage's progress that is already reported
LevelSets smooth_level_sets(LevelSets level_sets,
                            const SmoothLevelSetsOptions& options,
                            const StageContext& context,
                            double first_progress = 0);

}  // namespace cvmesh
