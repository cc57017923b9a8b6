// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/tighten.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/guarded_flow.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr int kBlock = SparseLevelSet::kBlock;
constexpr int kBlockNodes = SparseLevelSet::kBlockNodes;

// Part of the stage's progress that the guarded flow reports.
constexpr double kFlowShare = 0.75;

// The stencil of the bilaplacian reaches two nodes.
constexpr int kSweepHalo = 2;

// Values are signed distances in voxels while they are smoothed, cut off here: nodes beyond have no
// part in a boundary, and the blurred indicator tells no distance there.
constexpr float kClip = 2.5F;

// Weight of the signed distance that the labels give against the bilaplacian energy. What is
// shorter than 2 pi kPull^(-1/4), eight voxels, is smoothed; the rest follows the labels, so the
// slope stays one and the result depends neither on the sweeps done nor on where blocks begin.
constexpr float kPull = 0.3F;

// Largest eigenvalue of the squared 7-point Laplacian in three dimensions is 12^2; a gradient step
// may be at most the inverse of it and the pull together.
constexpr float kStep = 1 / (144 + kPull);

// Corrections of the volume, one after each round of sweeps but the last, and their gain: a round
// of ten sweeps takes up about a third of what its pull is moved by. Measured on balls, rods and
// plates of half thickness 0.5 to 10 voxels.
constexpr int kCorrections = 5;
constexpr float kGain = 3;
// Reach of the window in which a volume is compared, and its standard deviation (1.4 voxels): wide
// enough for the noise of a lattice boundary to cancel, narrow against what the boundary follows.
constexpr int kWindow = 4;
constexpr float kWindowVariance = 2;

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
    return field
        .block_at[(static_cast<std::size_t>(bk) * field.blocks[1] + bj) * field.blocks[0] + bi];
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

// A block with `Halo` nodes around it, row after row.
template <int Halo>
struct Padded {
  static constexpr int kSpan = kBlock + 2 * Halo;
  static constexpr int kSpan2 = kSpan * kSpan;
  std::array<float, kSpan * kSpan2> values;

  static int at(int i, int j, int k) { return ((k + Halo) * kSpan + j + Halo) * kSpan + Halo + i; }
};

// Reads the blocks of one material.
class BlockReader {
 public:
  BlockReader(const SparseLevelSet& field, MaterialId m, const Grid<MaterialId>& labels)
      : blocks_(list_blocks(field)), m_(m), labels_(labels) {}

  [[nodiscard]] std::size_t size() const { return blocks_.size(); }

  // The block with its halo from the neighbouring blocks; nodes beyond the grid repeat its border,
  // nodes that are not stored are +-far by their label.
  template <int Halo>
  void gather(std::size_t b,
              const std::vector<float>& values,
              float far,
              Padded<Halo>& padded) const {
    constexpr int kSpan = Padded<Halo>::kSpan;
    const SmoothingBlock& block = blocks_[b];
    const auto& dims = labels_.frame.dims;
    std::array<std::array<int, kSpan>, 3> node;
    for (int axis = 0; axis < 3; ++axis)
      for (int i = 0; i < kSpan; ++i)
        node[axis][i] = std::clamp(block.first_node[axis] - Halo + i, 0, dims[axis] - 1);
    const auto neighbour_axis = [&](int axis, int i) {
      return node[axis][i] / kBlock - block.first_node[axis] / kBlock + 1;
    };
    std::array<int, kSpan> nx, ox;
    for (int i = 0; i < kSpan; ++i) {
      nx[i] = neighbour_axis(0, i);
      ox[i] = node[0][i] % kBlock;
    }
    float* out = padded.values.data();
    for (int k = 0; k < kSpan; ++k)
      for (int j = 0; j < kSpan; ++j) {
        const int row = neighbour_axis(2, k) * 9 + neighbour_axis(1, j) * 3;
        const int offset = ((node[2][k] % kBlock) * kBlock + node[1][j] % kBlock) * kBlock;
        for (int i = 0; i < kSpan; ++i) {
          const int slot = block.neighbours[row + nx[i]];
          *out++ = slot >= 0 ? values[static_cast<std::size_t>(slot) * kBlockNodes + offset + ox[i]]
                             : (labels_(node[0][i], node[1][j], node[2][k]) == m_ ? far : -far);
        }
      }
  }

 private:
  std::vector<SmoothingBlock> blocks_;
  MaterialId m_;
  const Grid<MaterialId>& labels_;
};

// The 7-point Laplacian at place n of a padded block.
template <int Halo>
float laplacian_at(const float* f, int n) {
  constexpr int kSpan = Padded<Halo>::kSpan, kSpan2 = Padded<Halo>::kSpan2;
  return f[n - 1] + f[n + 1] + f[n - kSpan] + f[n + kSpan] + f[n - kSpan2] + f[n + kSpan2] -
         6 * f[n];
}

// The inverse error function for |x| < 0.993 [Giles 2012].
float inverse_erf(float x) {
  const float w = -std::log((1 - x) * (1 + x)) - 2.5F;
  float p = 2.81022636e-08F;
  for (const float c : {3.43273939e-07F, -3.5233877e-06F, -4.39150654e-06F, 0.00021858087F,
                        -0.00125372503F, -0.00417768164F, 0.246640727F, 1.50140941F})
    p = c + p * w;
  return p * x;
}

// Turns values of the blurred indicator (sigma one voxel) into signed distances in voxels: across a
// plane at distance d the indicator is erf(d / sqrt 2).
void to_distances(std::vector<float>& values) {
  const float largest = std::erf(kClip / std::sqrt(2.0F));
  parallel_for_each_index(
      0, values.size(),
      [&](std::size_t n) {
        values[n] = std::abs(values[n]) >= largest ? std::copysign(kClip, values[n])
                                                   : std::sqrt(2.0F) * inverse_erf(values[n]);
      },
      1 << 14);
}

// The smoothing of one material's field: least
//   integral |Laplacian f|^2 + kPull |f - d|^2   with sign(f) by the label, |f| >= margin,
// by accelerated projected gradients [Nesterov 1983, Lempitsky 2010]. The distance d is that of the
// blurred labels without the blur's curvature error, and is then moved, round by round, until the
// volume inside the boundary is that of the voxels in every window: what smoothing takes from
// convex and thin parts comes back.
class FieldSmoother {
 public:
  FieldSmoother(SparseLevelSet& field, MaterialId m, const Grid<MaterialId>& labels, float margin)
      : reader_(field, m, labels), margin_(margin), current_(field.values) {
    sign_.resize(current_.size());
    for (std::size_t n = 0; n < sign_.size(); ++n)
      sign_[n] = current_[n] > 0 ? 1.0F : -1.0F;
    to_distances(current_);
    distance_.resize(current_.size());
    // Blurring by sigma moves a boundary by -sigma^2 / 2 times the Laplacian of its distance.
    for_each_block([&](std::size_t b) {
      Padded<1> f;
      reader_.gather(b, current_, kClip, f);
      for_each_node(b, [&](std::size_t n, int i, int j, int k) {
        const int at = Padded<1>::at(i, j, k);
        distance_[n] =
            std::clamp(f.values[at] - 0.5F * laplacian_at<1>(f.values.data(), at), -kClip, kClip);
      });
    });
    for (std::size_t n = 0; n < sign_.size(); ++n)
      current_[n] = kept(n, distance_[n]);
  }

  void run(int sweeps) {
    for (int round = 0; round <= kCorrections; ++round) {
      const int done = sweeps * round / (kCorrections + 1);
      relax(sweeps * (round + 1) / (kCorrections + 1) - done);
      if (round < kCorrections) correct_volume();
    }
    parallel_for_each_index(
        0, current_.size(), [&](std::size_t n) { current_[n] /= kClip; }, 1 << 16);
  }

 private:
  template <typename Body>
  void for_each_block(const Body& body) const {
    parallel_for_each_index(0, reader_.size(), body, 8);
  }

  template <typename Body>
  static void for_each_node(std::size_t b, const Body& body) {
    std::size_t n = b * kBlockNodes;
    for (int k = 0; k < kBlock; ++k)
      for (int j = 0; j < kBlock; ++j)
        for (int i = 0; i < kBlock; ++i)
          body(n++, i, j, k);
  }

  // The nearest value that has the label's sign.
  [[nodiscard]] float kept(std::size_t n, float value) const {
    return sign_[n] * std::clamp(sign_[n] * value, margin_, kClip);
  }

  void relax(int sweeps) {
    // Limit of the momentum for a problem of condition 1 / (kStep kPull) [Nesterov 2004].
    const float root = std::sqrt(kStep * kPull);
    const float limit = (1 - root) / (1 + root);
    ahead_ = current_;
    for (int sweep = 1; sweep <= sweeps; ++sweep) {
      previous_.swap(current_);
      current_.resize(previous_.size());
      for_each_block([&](std::size_t b) { descend(b); });
      const float momentum =
          std::min(limit, static_cast<float>(sweep - 1) / static_cast<float>(sweep + 2));
      parallel_for_each_index(
          0, current_.size(),
          [&](std::size_t n) { ahead_[n] = current_[n] + momentum * (current_[n] - previous_[n]); },
          1 << 16);
    }
  }

  void descend(std::size_t b) {
    constexpr int kSpan = Padded<kSweepHalo>::kSpan;
    Padded<kSweepHalo> f, laplacian;
    reader_.gather(b, ahead_, kClip, f);
    for (int k = -1; k <= kBlock; ++k)
      for (int j = -1; j <= kBlock; ++j) {
        const int row = Padded<kSweepHalo>::at(-1, j, k);
        for (int n = row; n < row + kSpan - 2; ++n)
          laplacian.values[n] = laplacian_at<kSweepHalo>(f.values.data(), n);
      }
    for (int k = 0; k < kBlock; ++k)
      for (int j = 0; j < kBlock; ++j) {
        const int row = Padded<kSweepHalo>::at(0, j, k);
        const std::size_t first = b * kBlockNodes + (k * kBlock + j) * kBlock;
        for (int i = 0; i < kBlock; ++i) {
          const float value = f.values[row + i];
          const float gradient = laplacian_at<kSweepHalo>(laplacian.values.data(), row + i) +
                                 kPull * (value - distance_[first + i]);
          current_[first + i] = kept(first + i, value - kStep * gradient);
        }
      }
  }

  // Moves the distance by what the volume inside the boundary lacks, per area, in a window.
  void correct_volume() {
    // The arrays of the sweeps are free between rounds.
    std::vector<float>& lack = previous_;
    std::vector<float>& area = ahead_;
    lack.resize(current_.size());
    for_each_block([&](std::size_t b) {
      Padded<1> f;
      reader_.gather(b, current_, kClip, f);
      for_each_node(b, [&](std::size_t n, int i, int j, int k) {
        const float own = own_part(f.values.data(), Padded<1>::at(i, j, k));
        lack[n] = sign_[n] * (1 - own);
        area[n] = own < 1 ? 1.0F : 0.0F;
      });
    });
    for_each_block([&](std::size_t b) {
      Padded<kWindow> window;
      std::array<float, kBlockNodes> lack_here, area_here;
      reader_.gather(b, lack, 0, window);
      blur(window, lack_here.data());
      reader_.gather(b, area, 0, window);
      blur(window, area_here.data());
      for (int i = 0; i < kBlockNodes; ++i) {
        // Far from a boundary both are next to nothing.
        constexpr float kLeastArea = 0.02F, kLargestMove = 0.5F, kRange = kClip + 2;
        const float move = std::clamp(kGain * lack_here[i] / (area_here[i] + kLeastArea),
                                      -kLargestMove, kLargestMove);
        float& d = distance_[b * kBlockNodes + i];
        d = std::clamp(d + move, -kRange, kRange);
      }
    });
  }

  // Part of the voxel of node `at` that is on the node's side of the boundary: along each axis what
  // the cuts of the two half edges leave, and of the axes the least (a boundary across one of them
  // cuts the others far away or not at all).
  static float own_part(const float* f, int at) {
    constexpr int kSpan = Padded<1>::kSpan, kSpan2 = Padded<1>::kSpan2;
    float part = 1;
    for (const int step : {1, kSpan, kSpan2}) {
      float along = 0;
      for (const int other : {at - step, at + step}) {
        const bool is_cut = (f[at] > 0) != (f[other] > 0);
        const float cut = is_cut ? std::abs(f[at]) / (std::abs(f[at]) + std::abs(f[other])) : 1;
        along += std::min(cut, 0.5F);
      }
      part = std::min(part, along);
    }
    return part;
  }

  static void blur(const Padded<kWindow>& window, float* out) {
    constexpr int kSpan = Padded<kWindow>::kSpan;
    std::array<float, 2 * kWindow + 1> weight;
    float sum = 0;
    for (int d = -kWindow; d <= kWindow; ++d)
      sum += weight[d + kWindow] = std::exp(-0.5F * static_cast<float>(d * d) / kWindowVariance);
    for (float& w : weight)
      w /= sum;
    const auto pass = [&](const float* in, int lines, int stride, int line_in, int line_out,
                          int count, float* to) {
      for (int line = 0; line < lines; ++line)
        for (int n = 0; n < count; ++n) {
          float value = 0;
          for (int d = 0; d <= 2 * kWindow; ++d)
            value += weight[d] * in[line * line_in + n + d * stride];
          to[line * line_out + n] = value;
        }
    };
    std::array<float, kSpan * kSpan * kBlock> x_pass;
    pass(window.values.data(), kSpan * kSpan, 1, kSpan, kBlock, kBlock, x_pass.data());
    std::array<float, kSpan * kBlock * kBlock> y_pass;
    pass(x_pass.data(), kSpan, kBlock, kSpan * kBlock, kBlock * kBlock, kBlock * kBlock,
         y_pass.data());
    pass(y_pass.data(), 1, kBlock * kBlock, 0, 0, kBlockNodes, out);
  }

  BlockReader reader_;
  float margin_;
  std::vector<float>& current_;  // the field's own values
  std::vector<float> previous_, ahead_, distance_, sign_;
};

}  // namespace

TightenResult tighten(LevelSets level_sets,
                      const TightenOptions& options,
                      const StageContext& context) {
  TightenResult result;
  result.level_sets = std::move(level_sets);
  if (options.r_vox >= 1) {
    GuardedFlowResult flow =
        guarded_flow(*result.level_sets.labels, result.level_sets.fields.size(), options.r_vox,
                     options.max_iterations, context);
    result.stats.iterations = flow.iterations;
    result.stats.nodes_changed = flow.nodes_changed;
    result.stats.nodes_guarded = flow.nodes_guarded;
    if (flow.nodes_changed > 0)
      result.level_sets =
          build_level_sets(std::make_shared<Grid<MaterialId>>(std::move(flow.labels)),
                           result.level_sets.fields.size(), context)
              .level_sets;
  }
  if (options.r_vox > 0) {
    const std::size_t materials = result.level_sets.fields.size();
    const double start = options.r_vox >= 1 ? kFlowShare : 0;
    for (std::size_t m = 0; m < materials; ++m) {
      FieldSmoother(result.level_sets.fields[m], static_cast<MaterialId>(m),
                    *result.level_sets.labels, static_cast<float>(options.margin))
          .run(options.smoothing_sweeps);
      report_progress(
          context, "tightening",
          start + (1 - start) * static_cast<double>(m + 1) / static_cast<double>(materials));
    }
    result.stats.sweeps = options.smoothing_sweeps;
  }
  return result;
}

}  // namespace cvmesh
