// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/build_level_sets.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cvmesh {
namespace {

constexpr int kBlock = SparseLevelSet::kBlock;
constexpr int kBlockNodes = SparseLevelSet::kBlockNodes;

// Reach of the truncated Gaussian: at three sigma its tail is below the margin that tighten keeps.
constexpr int kReach = 3;
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

  void gather(std::size_t block, PaddedLabels& out) const {
    const auto at = place(block);
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
  static_assert(kPadded == 14);
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

}  // namespace

BuildLevelSetsResult build_level_sets(std::shared_ptr<const Grid<MaterialId>> labels,
                                      std::size_t material_count,
                                      const StageContext& context) {
  // Least magnitude at a node; keeps cut points away from nodes.
  constexpr float kMargin = 0.05F;
  const BlockGrid grid(*labels);

  // Which materials need a value in which block: those whose boundary passes within reach.
  std::vector<std::vector<MaterialId>> materials_in(grid.size());
  parallel_for_each_index(
      0, grid.size(),
      [&](std::size_t block) {
        PaddedLabels padded;
        grid.gather(block, padded);
        if (padded.present.size() > 1) materials_in[block] = padded.present;
      },
      16);
  report_progress(context, "level sets", 0.3);

  BuildLevelSetsResult result;
  auto& fields = result.level_sets.fields;
  fields.resize(material_count);
  result.level_sets.labels = std::move(labels);
  std::vector<std::array<int, 3>> lo(material_count, {1 << 30, 1 << 30, 1 << 30});
  std::vector<std::array<int, 3>> hi(material_count, {-1, -1, -1});
  for (std::size_t block = 0; block < grid.size(); ++block)
    for (const MaterialId m : materials_in[block])
      for (int axis = 0; axis < 3; ++axis) {
        lo[m][axis] = std::min(lo[m][axis], grid.place(block)[axis]);
        hi[m][axis] = std::max(hi[m][axis], grid.place(block)[axis]);
      }
  for (std::size_t m = 0; m < material_count; ++m) {
    if (hi[m][0] < 0) continue;
    fields[m].first_block = lo[m];
    for (int axis = 0; axis < 3; ++axis)
      fields[m].blocks[axis] = hi[m][axis] - lo[m][axis] + 1;
    fields[m].block_at.assign(
        static_cast<std::size_t>(fields[m].blocks[0]) * fields[m].blocks[1] * fields[m].blocks[2],
        -1);
  }
  std::vector<std::int32_t> stored(material_count, 0);
  for (std::size_t block = 0; block < grid.size(); ++block)
    for (const MaterialId m : materials_in[block])
      fields[m].block_at[fields[m].table_index(grid.place(block))] = stored[m]++;
  for (std::size_t m = 0; m < material_count; ++m) {
    fields[m].values.resize(static_cast<std::size_t>(stored[m]) * kBlockNodes);
    result.stats.band_nodes += fields[m].values.size();
    result.stats.stored_bytes +=
        fields[m].values.size() * sizeof(float) + fields[m].block_at.size() * sizeof(std::int32_t);
  }

  const Kernel1d kernel = gaussian_kernel();
  parallel_for_each_index(
      0, grid.size(),
      [&](std::size_t block) {
        if (materials_in[block].empty()) return;
        PaddedLabels padded;
        grid.gather(block, padded);
        for (const MaterialId m : materials_in[block]) {
          const auto slot = fields[m].block_at[fields[m].table_index(grid.place(block))];
          fill_block(padded, m, kernel, kMargin,
                     &fields[m].values[static_cast<std::size_t>(slot) * kBlockNodes]);
        }
      },
      16);
  report_progress(context, "level sets", 1);
  return result;
}

}  // namespace cvmesh
