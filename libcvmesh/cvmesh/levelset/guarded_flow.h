// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"

#include <cstddef>

namespace cvmesh {

struct GuardedFlowResult {
  Grid<MaterialId> labels;
  int iterations = 0;
  std::size_t nodes_changed = 0, nodes_guarded = 0;
};

/// Node labels after curvature flow between the opening and the closing by radius `r_vox` of every
/// material [Williams 2005], as threshold dynamics [Merriman 1994], with the topology of every
/// material on the 14-neighbour lattice kept: a node changes its label only where that is a simple
/// change for the materials involved.
GuardedFlowResult guarded_flow(const Grid<MaterialId>& labels,
                               std::size_t material_count,
                               double r_vox,
                               int max_iterations,
                               const StageContext& context);

}  // namespace cvmesh
