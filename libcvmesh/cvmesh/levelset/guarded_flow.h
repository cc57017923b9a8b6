// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Where the guard refused moves that the flow wanted, in one block of 8^3 nodes.
struct GuardedPlace {
  MaterialId material = 0;  ///< that would have lost the nodes
  std::size_t nodes = 0;
  Vec3 position;  ///< their mean, grid mm
};

struct GuardedFlowResult {
  Grid<MaterialId> labels;
  int iterations = 0;
  std::size_t nodes_changed = 0, nodes_guarded = 0;
  std::vector<GuardedPlace> guarded;  ///< most nodes first
};

/// Node labels after curvature flow between the opening and the closing of every material
/// [Williams 2005], as threshold dynamics [Merriman 1994], with the topology of every material on
/// the 14-neighbour lattice kept: a node changes its label only where that is a simple change for
/// the materials involved.
///
/// One flow for each distinct radius of at least one voxel, ascending; in it move the boundaries
/// between materials whose radius is not smaller. A boundary thus has the smaller radius of its two
/// materials.
///
/// @param r_vox           radius of curvature for each material; below one its nodes stay
/// @param max_iterations  of each flow
/// @param last_progress   fraction of the stage's progress that is reported at the end
GuardedFlowResult guarded_flow(const Grid<MaterialId>& labels,
                               const std::vector<double>& r_vox,
                               int max_iterations,
                               const StageContext& context,
                               double last_progress = 1);

}  // namespace cvmesh
