// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/tighten.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "cvmesh/core/parallel.h"
#include "cvmesh/levelset/guarded_flow.h"
#include "cvmesh/levelset/build_level_sets.h"

namespace cvmesh {
namespace {

constexpr int kBlock = SparseLevelSet::kBlock;
constexpr int kBlockNodes = SparseLevelSet::kBlockNodes;

// The 13-point-squared stencil of the bilaplacian reaches two nodes.
constexpr int kHalo = 2;
constexpr int kSpan = kBlock + 2 * kHalo;
constexpr int kSpan2 = kSpan * kSpan;

// Largest eigenvalue of the squared 7-point Laplacian in three dimensions is 12^2; an accelerated
// projected gradient step may be at most its inverse.
constexpr float kStep = 1.0F / 144;

// Blocks of one material with the stored neighbours of each: what a sweep reads.
struct SmoothingBlock {
  std::array<int, 3> first_node;            // grid index of the block's first node
  std::array<std::int32_t, 27> neighbours;  // slots, -1 where not stored; [13] is the block itself
};

std::vector<SmoothingBlock> list_blocks(const SparseLevelSet& field) {
  std::vector<SmoothingBlock> list(field.values.size() / kBlockNodes);
  const auto slot_at = [&](int bi, int bj, int bk) {
    if (bi < 0 || bj < 0 || bk < 0 || bi >= field.blocks[0] || bj >= field.blocks[1] ||
        bk >= field.blocks[2])
      return -1;
    return field.block_at[(static_cast<std::size_t>(bk) * field.blocks[1] + bj) * field.blocks[0] +
                          bi];
  };
  for (int bk = 0; bk < field.blocks[2]; ++bk)
    for (int bj = 0; bj < field.blocks[1]; ++bj)
      for (int bi = 0; bi < field.blocks[0]; ++bi) {
        const int slot = slot_at(bi, bj, bk);
        if (slot < 0) continue;
        SmoothingBlock& block = list[slot];
        block.first_node = {(bi + field.first_block[0]) * kBlock,
                            (bj + field.first_block[1]) * kBlock,
                            (bk + field.first_block[2]) * kBlock};
        for (int n = 0; n < 27; ++n)
          block.neighbours[n] = slot_at(bi + n % 3 - 1, bj + n / 3 % 3 - 1, bk + n / 9 - 1);
      }
  return list;
}

// The block with its halo from the neighbouring blocks; nodes beyond the grid repeat its border.
void gather(const SmoothingBlock& block, const std::vector<float>& values, MaterialId m,
            const Grid<MaterialId>& labels, float* out) {
  const auto& dims = labels.frame.dims;
  std::array<std::array<int, kSpan>, 3> node;
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < kSpan; ++i)
      node[axis][i] = std::clamp(block.first_node[axis] - kHalo + i, 0, dims[axis] - 1);
  const auto neighbour_axis = [&](int axis, int i) {
    return node[axis][i] / kBlock - block.first_node[axis] / kBlock + 1;
  };
  std::array<int, kSpan> nx, ox;
  for (int i = 0; i < kSpan; ++i) {
    nx[i] = neighbour_axis(0, i);
    ox[i] = node[0][i] % kBlock;
  }
  for (int k = 0; k < kSpan; ++k)
    for (int j = 0; j < kSpan; ++j) {
      const int row = neighbour_axis(2, k) * 9 + neighbour_axis(1, j) * 3;
      const int offset = ((node[2][k] % kBlock) * kBlock + node[1][j] % kBlock) * kBlock;
      for (int i = 0; i < kSpan; ++i) {
        const int slot = block.neighbours[row + nx[i]];
        *out++ = slot >= 0
                     ? values[static_cast<std::size_t>(slot) * kBlockNodes + offset + ox[i]]
                     : (labels(node[0][i], node[1][j], node[2][k]) == m ? 1.0F : -1.0F);
      }
    }
}

// One projected gradient step of integral |Laplacian f|^2 on one block: out = P(f - step * L L f).
void descend(const float* f, float margin, const float* sign, float* out) {
  std::array<float, kSpan * kSpan2> laplacian;  // one ring around the block is used
  for (int k = 1; k < kSpan - 1; ++k)
    for (int j = 1; j < kSpan - 1; ++j) {
      const float* row = f + (k * kSpan + j) * kSpan;
      float* result = laplacian.data() + (k * kSpan + j) * kSpan;
      for (int i = 1; i < kSpan - 1; ++i)
        result[i] = row[i - 1] + row[i + 1] + row[i - kSpan] + row[i + kSpan] + row[i - kSpan2] +
                    row[i + kSpan2] - 6 * row[i];
    }
  for (int k = 0; k < kBlock; ++k)
    for (int j = 0; j < kBlock; ++j) {
      const int start = ((k + kHalo) * kSpan + j + kHalo) * kSpan + kHalo;
      const float* row = laplacian.data() + start;
      for (int i = 0; i < kBlock; ++i) {
        const float bilaplacian = row[i - 1] + row[i + 1] + row[i - kSpan] + row[i + kSpan] +
                                  row[i - kSpan2] + row[i + kSpan2] - 6 * row[i];
        const float moved = f[start + i] - kStep * bilaplacian;
        // clamp sign * value to [margin, 1]
        *out++ = *sign * std::clamp(*sign * moved, margin, 1.0F);
        ++sign;
      }
    }
}

// Accelerated projected gradient [Nesterov 1983] on one material's field.
void smooth_field(SparseLevelSet& field, MaterialId m, const Grid<MaterialId>& labels, int sweeps,
                  float margin) {
  if (field.values.empty()) return;
  const auto blocks = list_blocks(field);
  std::vector<float> sign(field.values.size());
  parallel_for_each_index(
      0, field.values.size(), [&](std::size_t i) { sign[i] = field.values[i] > 0 ? 1.0F : -1.0F; },
      1 << 16);
  std::vector<float> previous = field.values, extrapolated = field.values;
  std::vector<float>& current = field.values;
  for (int sweep = 1; sweep <= sweeps; ++sweep) {
    std::swap(previous, current);
    parallel_for_each_index(
        0, blocks.size(),
        [&](std::size_t b) {
          std::array<float, kSpan * kSpan2> f;
          gather(blocks[b], extrapolated, m, labels, f.data());
          descend(f.data(), margin, &sign[b * kBlockNodes], &current[b * kBlockNodes]);
        },
        8);
    const float momentum = static_cast<float>(sweep - 1) / static_cast<float>(sweep + 2);
    parallel_for_each_index(
        0, current.size(),
        [&](std::size_t i) {
          extrapolated[i] = current[i] + momentum * (current[i] - previous[i]);
        },
        1 << 16);
  }
}

}  // namespace

TightenResult tighten(LevelSets level_sets, const TightenOptions& options,
                      const StageContext& context) {
  TightenResult result;
  result.level_sets = std::move(level_sets);
  if (options.r_vox >= 1) {
    GuardedFlowResult flow = guarded_flow(*result.level_sets.labels,
                                          result.level_sets.fields.size(), options.r_vox,
                                          options.max_iterations, context);
    result.stats.iterations = flow.iterations;
    result.stats.nodes_changed = flow.nodes_changed;
    result.stats.nodes_guarded = flow.nodes_guarded;
    if (flow.nodes_changed > 0)
      result.level_sets = build_level_sets(std::make_shared<Grid<MaterialId>>(std::move(flow.labels)),
                                           result.level_sets.fields.size(), context)
                              .level_sets;
  }
  if (options.r_vox > 0) {
    const std::size_t materials = result.level_sets.fields.size();
    for (std::size_t m = 0; m < materials; ++m) {
      smooth_field(result.level_sets.fields[m], static_cast<MaterialId>(m),
                   *result.level_sets.labels, options.smoothing_sweeps,
                   static_cast<float>(options.margin));
      report_progress(context, "tightening", static_cast<double>(m + 1) / materials);
    }
    result.stats.sweeps = options.smoothing_sweeps;
  }
  return result;
}

}  // namespace cvmesh
