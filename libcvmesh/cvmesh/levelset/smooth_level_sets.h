// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <memory>

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"

namespace cvmesh {

struct SmoothLevelSetsOptions {
  int sweeps = 100;           ///< of the constrained biharmonic flow
  double margin = 0.05;       ///< least magnitude of a value at a node, with the sign of its label
};

struct SmoothLevelSetsStats {
  std::size_t band_nodes = 0;   ///< over all materials
  std::size_t stored_bytes = 0;
};

struct SmoothLevelSetsResult {
  LevelSets level_sets;
  SmoothLevelSetsStats stats;
};

SmoothLevelSetsResult smooth_level_sets(std::shared_ptr<const Grid<MaterialId>> labels,
                                        std::size_t material_count,
                                        const SmoothLevelSetsOptions& options,
                                        const StageContext& context);

}  // namespace cvmesh
