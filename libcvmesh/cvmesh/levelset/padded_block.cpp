// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/padded_block.h"

#include "cvmesh/core/parallel.h"

namespace cvmesh {

SlotReader::SlotReader(const LevelSets& level_sets, float far)
    : level_sets_(level_sets), neighbours_(level_sets.slots.size()) {
  outside_.fill(-far);
  inside_.fill(far);
  parallel_for_each_index(
      0, size(),
      [&](std::size_t s) {
        const auto& [block, material, mirror] = level_sets.slots[s];
        const BlockTable& table = level_sets.tables[material];
        for (int n = 0; n < 27; ++n)
          neighbours_[s][n] =
              table.at({block[0] + n % 3 - 1, block[1] + n / 3 % 3 - 1, block[2] + n / 9 - 1});
      },
      64);
}

}  // namespace cvmesh
