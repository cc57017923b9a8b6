// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"

#include <cstddef>
#include <memory>

namespace cvmesh {

struct BuildLevelSetsStats {
  std::size_t band_nodes = 0;  ///< over all materials
  std::size_t stored_bytes = 0;
};

struct BuildLevelSetsResult {
  LevelSets level_sets;
  BuildLevelSetsStats stats;
};

/// One level set per material, straight from the labels: the Gaussian-smoothed indicator (sigma
/// one voxel) scaled to [-1, 1], in the narrow band only, with the sign of the label at each node.
///
/// Memory follows the interface area: about 4 bytes for each node of the blocks that the band
/// touches, per material.
BuildLevelSetsResult build_level_sets(std::shared_ptr<const Grid<MaterialId>> labels,
                                      std::size_t material_count,
                                      const StageContext& context);

}  // namespace cvmesh
