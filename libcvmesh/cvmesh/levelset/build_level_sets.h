// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"

#include <cstddef>
#include <memory>

namespace cvmesh {

struct BuildLevelSetsStats {
  std::size_t band_nodes = 0;  ///< stored
  std::size_t stored_bytes = 0;
};

struct BuildLevelSetsResult {
  LevelSets level_sets;
  BuildLevelSetsStats stats;
};

/// One level set per material, straight from the labels: the Gaussian-smoothed indicator (sigma
/// one voxel) as 2 x - 1, in the narrow band only, with the sign of the label at each node.
///
/// Memory follows the interface area: 4 bytes for each node of the blocks within four nodes of a
/// boundary, once where two materials are near, else once for each of them.
BuildLevelSetsResult build_level_sets(std::shared_ptr<const Grid<MaterialId>> labels,
                                      std::size_t material_count,
                                      const StageContext& context);

}  // namespace cvmesh
