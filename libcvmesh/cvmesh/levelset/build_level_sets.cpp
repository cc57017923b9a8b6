// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/build_level_sets.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cvmesh {
namespace {

constexpr int kBlock = BlockTable::kBlock;
constexpr int kBlockNodes = BlockTable::kBlockNodes;

// Reach of the truncated Gaussian, and of a material: at four sigma its tail moves the distances
// that are made of it by less than a hundredth of a voxel.
constexpr int kReach = 4;
constexpr int kPadded = kBlock + 2 * kReach;

using Kernel1d = std::array<float, 2 * kReach + 1>;

Kernel1d gaussian_kernel() {
  Kernel1d kernel;
  float sum = 0;
  for (int d = -kReach; d <= kReach; ++d)
    sum += kernel[d + kReach] = std::exp(-0.5F * d * d);
  for (float& w : kernel)
    w /= sum;
  return kernel;
}

// Labels of a block and of `kReach` nodes around it; border nodes of the grid are repeated.
struct PaddedLabels {
  std::array<MaterialId, kPadded * kPadded * kPadded> ids;
  std::vector<MaterialId> present;  // ascending
};

class BlockGrid {
 public:
  explicit BlockGrid(const Grid<MaterialId>& labels) : labels_(labels) {
    for (int axis = 0; axis < 3; ++axis)
      blocks_[axis] = (labels.frame.dims[axis] + kBlock - 1) / kBlock;
  }

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(blocks_[0]) * blocks_[1] * blocks_[2];
  }

  [[nodiscard]] std::array<int, 3> place(std::size_t block) const {
    return {static_cast<int>(block % blocks_[0]), static_cast<int>(block / blocks_[0] % blocks_[1]),
            static_cast<int>(block / blocks_[0] / blocks_[1])};
  }

  void gather(std::size_t block, PaddedLabels& out) const { gather(place(block), out); }

  void gather(const std::array<int, 3>& at, PaddedLabels& out) const {
    const auto& dims = labels_.frame.dims;
    std::array<int, kPadded> x;
    for (int i = 0; i < kPadded; ++i)
      x[i] = std::clamp(at[0] * kBlock - kReach + i, 0, dims[0] - 1);
    out.present.clear();
    std::size_t n = 0;
    MaterialId last = 0;
    bool has_last = false;
    for (int k = 0; k < kPadded; ++k) {
      const int z = std::clamp(at[2] * kBlock - kReach + k, 0, dims[2] - 1);
      for (int j = 0; j < kPadded; ++j) {
        const int y = std::clamp(at[1] * kBlock - kReach + j, 0, dims[1] - 1);
        const MaterialId* row = &labels_.values[labels_.frame.linear(0, y, z)];
        for (int i = 0; i < kPadded; ++i) {
          const MaterialId id = row[x[i]];
          out.ids[n++] = id;
          if (has_last && id == last) continue;
          last = id;
          has_last = true;
          const auto it = std::lower_bound(out.present.begin(), out.present.end(), id);
          if (it == out.present.end() || *it != id) out.present.insert(it, id);
        }
      }
    }
  }

 private:
  const Grid<MaterialId>& labels_;
  std::array<int, 3> blocks_{};
};

// 2 G * [label == m] - 1 on the nodes of one block, with the sign of the label kept at each node.
void fill_block(
    const PaddedLabels& padded, MaterialId m, const Kernel1d& kernel, float margin, float* values) {
  static_assert(kPadded == 16);
  std::array<float, kPadded * kPadded * kBlock> x_pass;
  for (int row = 0; row < kPadded * kPadded; ++row)
    for (int i = 0; i < kBlock; ++i) {
      float sum = 0;
      for (int d = 0; d <= 2 * kReach; ++d)
        if (padded.ids[row * kPadded + i + d] == m) sum += kernel[d];
      x_pass[row * kBlock + i] = sum;
    }
  std::array<float, kPadded * kBlock * kBlock> y_pass;
  for (int k = 0; k < kPadded; ++k)
    for (int j = 0; j < kBlock; ++j)
      for (int i = 0; i < kBlock; ++i) {
        float sum = 0;
        for (int d = 0; d <= 2 * kReach; ++d)
          sum += kernel[d] * x_pass[(k * kPadded + j + d) * kBlock + i];
        y_pass[(k * kBlock + j) * kBlock + i] = sum;
      }
  for (int k = 0; k < kBlock; ++k)
    for (int j = 0; j < kBlock; ++j)
      for (int i = 0; i < kBlock; ++i) {
        float sum = 0;
        for (int d = 0; d <= 2 * kReach; ++d)
          sum += kernel[d] * y_pass[((k + d) * kBlock + j) * kBlock + i];
        const bool is_inside =
            padded.ids[((k + kReach) * kPadded + j + kReach) * kPadded + i + kReach] == m;
        const float value = std::clamp(2 * sum - 1, -1.0F, 1.0F);
        *values++ = is_inside ? std::max(value, margin) : std::min(value, -margin);
      }
}

// Boxes of blocks around all blocks that hold a node of a material or lie near one.
class MaterialBoxes {
 public:
  explicit MaterialBoxes(std::size_t material_count)
      : lo_(material_count, {1 << 30, 1 << 30, 1 << 30}), hi_(material_count, {-1, -1, -1}) {}

  void add(MaterialId m, const std::array<int, 3>& block) {
    for (int axis = 0; axis < 3; ++axis) {
      lo_[m][axis] = std::min(lo_[m][axis], block[axis]);
      hi_[m][axis] = std::max(hi_[m][axis], block[axis]);
    }
  }

  [[nodiscard]] BlockTable empty_table(std::size_t m) const {
    BlockTable table;
    if (hi_[m][0] < 0) return table;
    table.first_block = lo_[m];
    for (int axis = 0; axis < 3; ++axis)
      table.blocks[axis] = hi_[m][axis] - lo_[m][axis] + 1;
    table.entry.assign(
        static_cast<std::size_t>(table.blocks[0]) * table.blocks[1] * table.blocks[2],
        BlockTable::kOutside);
    return table;
  }

 private:
  std::vector<std::array<int, 3>> lo_, hi_;
};

// Fills `tables` and `slots` from the materials that are in or near each block.
void allot_slots(const BlockGrid& grid,
                 const std::vector<std::vector<MaterialId>>& materials_near,
                 LevelSets& level_sets) {
  MaterialBoxes boxes(level_sets.tables.size());
  for (std::size_t block = 0; block < grid.size(); ++block)
    for (const MaterialId m : materials_near[block])
      boxes.add(m, grid.place(block));
  for (std::size_t m = 0; m < level_sets.tables.size(); ++m)
    level_sets.tables[m] = boxes.empty_table(m);

  for (std::size_t block = 0; block < grid.size(); ++block) {
    const auto& near = materials_near[block];
    const auto place = grid.place(block);
    const auto entry_of = [&](MaterialId m) -> std::int32_t& {
      BlockTable& table = level_sets.tables[m];
      return table.entry[table.index(place)];
    };
    const auto next_slot = static_cast<std::int32_t>(level_sets.slots.size());
    if (near.size() == 1) {
      entry_of(near[0]) = BlockTable::kInside;
    } else if (near.size() == 2) {
      entry_of(near[0]) = next_slot;
      entry_of(near[1]) = BlockTable::mirrored(next_slot);
      level_sets.slots.push_back({place, near[0], near[1]});
    } else {
      for (const MaterialId m : near) {
        entry_of(m) = static_cast<std::int32_t>(level_sets.slots.size());
        level_sets.slots.push_back({place, m, m});
      }
    }
  }
}

}  // namespace

BuildLevelSetsResult build_level_sets(std::shared_ptr<const Grid<MaterialId>> labels,
                                      std::size_t material_count,
                                      const StageContext& context) {
  // Least magnitude at a node; keeps cut points away from nodes.
  constexpr float kMargin = 0.05F;
  const BlockGrid grid(*labels);
  std::vector<std::vector<MaterialId>> materials_near(grid.size());
  parallel_for_each_index(
      0, grid.size(),
      [&](std::size_t block) {
        PaddedLabels padded;
        grid.gather(block, padded);
        materials_near[block] = padded.present;
      },
      16);
  report_progress(context, "level sets", 0.3);

  BuildLevelSetsResult result;
  LevelSets& level_sets = result.level_sets;
  level_sets.labels = std::move(labels);
  level_sets.tables.resize(material_count);
  allot_slots(grid, materials_near, level_sets);
  materials_near = {};
  level_sets.values.resize(level_sets.slots.size() * kBlockNodes);
  result.stats.band_nodes = level_sets.values.size();
  result.stats.stored_bytes =
      level_sets.values.size() * sizeof(float) + level_sets.slots.size() * sizeof(LevelSets::Slot);
  for (const BlockTable& table : level_sets.tables)
    result.stats.stored_bytes += table.entry.size() * sizeof(std::int32_t);

  const Kernel1d kernel = gaussian_kernel();
  parallel_for_each_index(
      0, level_sets.slots.size(),
      [&](std::size_t slot) {
        PaddedLabels padded;
        grid.gather(level_sets.slots[slot].block, padded);
        fill_block(padded, level_sets.slots[slot].material, kernel, kMargin,
                   &level_sets.values[slot * kBlockNodes]);
      },
      16);
  report_progress(context, "level sets", 1);
  return result;
}

}  // namespace cvmesh
