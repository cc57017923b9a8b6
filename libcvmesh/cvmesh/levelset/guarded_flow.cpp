// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/guarded_flow.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/labels/simple_change.h"
#include "cvmesh/levelset/distance_transform.h"
#include "cvmesh/levelset/level_sets.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

// Three steps. The obstacles say which material may ever take a node: the mortar of [Williams 2005]
// between the opening and the closing of every material, as a short list of (node, material) in
// each block of 8^3 nodes. Then the flow: blur the indicator of every material, let the largest
// value win [Merriman 1994]. The wishes of all nodes are computed side by side from the labels at
// the start of an iteration and carried out one lattice colour after another, each only where it is
// a simple change at that moment. Blocks around which nothing has changed are not looked at again.
//
// Any subset of the wishes lowers the energy of threshold dynamics (it is concave in the labels and
// each wish alone lowers its linear part), so the iteration cannot go round in circles.

namespace cvmesh {
namespace {

constexpr int kBlock = BlockTable::kBlock;
constexpr int kBlockNodes = BlockTable::kBlockNodes;

// An opening reaches half a voxel beyond its balls of nodes: the boundary of a material lies half a
// voxel outside its outermost nodes. Without it the lattice takes twice what a ball would.
constexpr double kHalfVoxel = 0.5;

// Least gain for which a node changes its material: ten times the rounding of a blurred indicator.
constexpr float kLeastGain = 1e-6F;

std::size_t volume(const std::array<int, 3>& dims) {
  return static_cast<std::size_t>(dims[0]) * dims[1] * dims[2];
}

// Node spacing along each axis, in voxels (a voxel is the smallest spacing).
Vec3 steps_in_voxels(const GridFrame& frame) {
  return frame.spacing_mm / frame.voxel_mm();
}

// The part of the stage's progress that one flow reports.
struct StageProgress {
  const StageContext& context;
  double first, last;

  void report(double fraction) const {
    report_progress(context, "tightening", first + (last - first) * fraction);
  }
};

// ---- obstacles ----------------------------------------------------------------------------

// A material's bounding box in the grid, grown; it may stick out of the grid, whose border nodes
// are repeated there.
struct MaterialBox {
  std::array<int, 3> lo{1 << 30, 1 << 30, 1 << 30};
  std::array<int, 3> dims{0, 0, 0};

  [[nodiscard]] bool is_empty() const { return dims[0] <= 0; }
};

std::vector<MaterialBox> find_boxes(const Grid<MaterialId>& labels,
                                    std::size_t material_count,
                                    const std::array<int, 3>& padding) {
  const auto [nx, ny, nz] = labels.frame.dims;
  std::vector<std::array<int, 3>> lo(material_count, {1 << 30, 1 << 30, 1 << 30});
  std::vector<std::array<int, 3>> hi(material_count, {-1, -1, -1});
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j) {
      const MaterialId* row = &labels.values[labels.frame.linear(0, j, k)];
      for (int i = 0; i < nx;) {
        const MaterialId m = row[i];
        const int begin = i;
        while (i < nx && row[i] == m)
          ++i;
        lo[m] = {std::min(lo[m][0], begin), std::min(lo[m][1], j), std::min(lo[m][2], k)};
        hi[m] = {std::max(hi[m][0], i - 1), std::max(hi[m][1], j), std::max(hi[m][2], k)};
      }
    }
  std::vector<MaterialBox> boxes(material_count);
  for (std::size_t m = 0; m < material_count; ++m) {
    if (hi[m][0] < 0) continue;
    for (int axis = 0; axis < 3; ++axis) {
      boxes[m].lo[axis] = lo[m][axis] - padding[axis];
      boxes[m].dims[axis] = hi[m][axis] - lo[m][axis] + 1 + 2 * padding[axis];
    }
  }
  return boxes;
}

using Mask = std::vector<std::uint8_t>;

// Sets of the nodes that are in a and not in b, or in both.
Mask minus(Mask a, const Mask& b) {
  for (std::size_t n = 0; n < a.size(); ++n)
    if (b[n] != 0) a[n] = 0;
  return a;
}

Mask both(Mask a, const Mask& b) {
  for (std::size_t n = 0; n < a.size(); ++n)
    if (b[n] == 0) a[n] = 0;
  return a;
}

void add(Mask& a, const Mask& b) {
  for (std::size_t n = 0; n < a.size(); ++n)
    if (b[n] != 0) a[n] = 1;
}

bool is_empty(const Mask& a) {
  return std::find(a.begin(), a.end(), 1) == a.end();
}

// Sets of nodes of one box, and the distances between them.
class BoxSets {
 public:
  BoxSets(const std::array<int, 3>& dims, const Vec3& steps) : dims_(dims), steps_(steps) {}

  // Nodes at most `radius` from the set.
  [[nodiscard]] Mask dilated(const Mask& set, double radius) const {
    return where(set, radius, [](float d2) { return d2 != kNoSite; });
  }

  // Union of the balls of `radius` inside the set.
  [[nodiscard]] Mask opened(const Mask& set, double radius) const {
    const Mask eroded = where(inverse(set), radius, [](float d2) { return d2 == kNoSite; });
    return both(dilated(eroded, radius + kHalfVoxel), set);
  }

  [[nodiscard]] static Mask inverse(const Mask& set) {
    Mask out(set.size());
    for (std::size_t n = 0; n < set.size(); ++n)
      out[n] = set[n] == 0 ? 1 : 0;
    return out;
  }

 private:
  template <typename Predicate>
  [[nodiscard]] Mask where(const Mask& set, double radius, const Predicate& predicate) const {
    // Squared distances are sums of squared steps: a relative tolerance keeps r itself inside.
    const auto d2 = squared_distances(dims_, steps_, set, radius * (1 + 1e-6));
    Mask out(set.size());
    parallel_for_each_index(
        0, set.size(), [&](std::size_t n) { out[n] = predicate(d2[n]) ? 1 : 0; }, 1 << 16);
    return out;
  }

  std::array<int, 3> dims_;
  Vec3 steps_;
};

// Distance from the opening by `scale` up to which a node may be the corner of a thick part: that
// of a cube's corner, and half a lattice diagonal for the nodes that stand for the opening.
double corner_reach(double scale) {
  return (std::sqrt(3.0) - 1) * scale + 0.5 * std::sqrt(3.0);
}

// What curvature flow at radius r must not take from a set: its opening by r and, of parts too thin
// for that, the opening by r/2, r/4, ... and at last (below a voxel) the part itself.
//
// Plain tightening has the opening by r only, and loses what is thinner than 2r. A part counts as
// thin where it is farther from all coarser openings than a corner of a thick part can be; it is
// then kept back to its root, since the flow would thin the root of a spike to a thread.
Mask core_of(const Mask& set, double r, const BoxSets& sets) {
  Mask core = sets.opened(set, r);
  Mask claimed = sets.dilated(core, corner_reach(r));
  for (double scale = r; scale >= 1; scale /= 2) {
    const Mask thin = minus(set, claimed);
    if (is_empty(thin)) break;
    const double finer = scale / 2;
    const Mask finer_core = finer < 1 ? set : sets.opened(set, finer);
    const Mask kept = both(thin, finer_core);
    if (is_empty(kept)) continue;
    add(core, both(sets.dilated(kept, corner_reach(r)), finer_core));
    add(claimed, sets.dilated(kept, corner_reach(finer)));
  }
  return core;
}

// A material that may take a node.
struct Entry {
  std::uint16_t offset = 0;  // of the node in its block
  MaterialId material = 0;
};

// A change that a node wants, or was refused.
using Wish = Entry;

struct Block {
  std::array<int, 3> lo{};     // its first node
  std::vector<Entry> entries;  // by material, then offset
  std::vector<Wish> refused;   // what the guard held back when the block was last looked at
  bool is_due = true;          // labels within reach have changed since it was last looked at
};

class BlockGrid {
 public:
  explicit BlockGrid(const GridFrame& frame) : frame_(frame) {
    for (int axis = 0; axis < 3; ++axis)
      size_[axis] = (frame.dims[axis] + kBlock - 1) / kBlock;
    blocks.resize(volume(size_));
    for (std::size_t b = 0; b < blocks.size(); ++b)
      blocks[b].lo = {static_cast<int>(b % size_[0]) * kBlock,
                      static_cast<int>(b / size_[0] % size_[1]) * kBlock,
                      static_cast<int>(b / size_[0] / size_[1]) * kBlock};
  }

  std::vector<Block> blocks;

  // Nodes of a block that are in the grid.
  [[nodiscard]] std::array<int, 3> end_of(const Block& block) const {
    return {std::min(block.lo[0] + kBlock, frame_.dims[0]),
            std::min(block.lo[1] + kBlock, frame_.dims[1]),
            std::min(block.lo[2] + kBlock, frame_.dims[2])};
  }

  // Marks the blocks that look at any node at most `reach` from the box lo..hi as due.
  void mark_due(const std::array<int, 3>& lo,
                const std::array<int, 3>& hi,
                const std::array<int, 3>& reach) {
    std::array<int, 3> first, last;
    for (int axis = 0; axis < 3; ++axis) {
      first[axis] = std::max(0, lo[axis] - reach[axis]) / kBlock;
      last[axis] = std::min(frame_.dims[axis] - 1, hi[axis] + reach[axis]) / kBlock;
    }
    for (int k = first[2]; k <= last[2]; ++k)
      for (int j = first[1]; j <= last[1]; ++j)
        for (int i = first[0]; i <= last[0]; ++i)
          blocks[(static_cast<std::size_t>(k) * size_[1] + j) * size_[0] + i].is_due = true;
  }

 private:
  GridFrame frame_;
  std::array<int, 3> size_{};
};

std::array<int, 3> place_in(const Block& block, std::uint16_t offset) {
  return {block.lo[0] + offset % kBlock, block.lo[1] + offset / kBlock % kBlock,
          block.lo[2] + offset / kBlock / kBlock};
}

class Obstacles {
 public:
  Obstacles(const Grid<MaterialId>& labels, const std::vector<bool>& may_move, double r_vox)
      : labels_(labels), r_(r_vox), steps_(steps_in_voxels(labels.frame)) {
    // A ball that touches a node and avoids another reaches 2r; one node more for the test itself.
    std::array<int, 3> padding;
    for (int axis = 0; axis < 3; ++axis)
      padding[axis] = static_cast<int>(std::ceil(2 * r_vox / steps_[axis])) + 1;
    boxes_ = find_boxes(labels, may_move.size(), padding);
    for (std::size_t m = 0; m < boxes_.size(); ++m)
      if (!may_move[m]) boxes_[m] = {};
  }

  // Fills the entries of all blocks, by materials that may move.
  void find_entries(BlockGrid& grid, const StageProgress& progress) const {
    Mask is_held(labels_.values.size());
    const double phases = 2.0 * static_cast<double>(boxes_.size());
    for (std::size_t m = 0; m < boxes_.size(); ++m) {
      if (!boxes_[m].is_empty()) hold_core(m, is_held);
      progress.report(0.7 * static_cast<double>(m + 1) / phases);
    }
    for (std::size_t m = 0; m < boxes_.size(); ++m) {
      if (!boxes_[m].is_empty()) add_entries(m, is_held, grid);
      progress.report(0.35 + 0.7 * static_cast<double>(m + 1) / phases);
    }
  }

 private:
  // Nodes of the box of material m: 1 where it is m (or is not, for the complement).
  [[nodiscard]] Mask indicator(std::size_t m, bool is_complement) const {
    const MaterialBox& box = boxes_[m];
    const auto& dims = labels_.frame.dims;
    Mask mask(volume(box.dims));
    parallel_for_each_index(
        0, static_cast<std::size_t>(box.dims[1]) * box.dims[2],
        [&](std::size_t row) {
          const int j = std::clamp(box.lo[1] + static_cast<int>(row % box.dims[1]), 0, dims[1] - 1);
          const int k = std::clamp(box.lo[2] + static_cast<int>(row / box.dims[1]), 0, dims[2] - 1);
          const MaterialId* from = &labels_.values[labels_.frame.linear(0, j, k)];
          std::uint8_t* to = &mask[row * box.dims[0]];
          for (int i = 0; i < box.dims[0]; ++i)
            to[i] = (from[std::clamp(box.lo[0] + i, 0, dims[0] - 1)] == m) != is_complement ? 1 : 0;
        },
        64);
    return mask;
  }

  // Calls body(node of the box, i, j, k) for the nodes of box m in block `block`.
  template <typename Body>
  void for_each_common_node(std::size_t m,
                            const std::array<int, 3>& lo,
                            const std::array<int, 3>& end,
                            const Body& body) const {
    const MaterialBox& box = boxes_[m];
    std::array<int, 3> first, last;
    for (int axis = 0; axis < 3; ++axis) {
      first[axis] = std::max(lo[axis], box.lo[axis]);
      last[axis] = std::min(end[axis], box.lo[axis] + box.dims[axis]);
    }
    for (int k = first[2]; k < last[2]; ++k)
      for (int j = first[1]; j < last[1]; ++j)
        for (int i = first[0]; i < last[0]; ++i)
          body((static_cast<std::size_t>(k - box.lo[2]) * box.dims[1] + (j - box.lo[1])) *
                       box.dims[0] +
                   (i - box.lo[0]),
               i, j, k);
  }

  void hold_core(std::size_t m, Mask& is_held) const {
    const Mask core = core_of(indicator(m, false), r_, BoxSets(boxes_[m].dims, steps_));
    const auto& dims = labels_.frame.dims;
    parallel_for_each_index(
        0, static_cast<std::size_t>(dims[2]),
        [&](std::size_t slice) {
          const int k = static_cast<int>(slice);
          for_each_common_node(m, {0, 0, k}, {dims[0], dims[1], k + 1},
                               [&](std::size_t n, int i, int j, int z) {
                                 if (core[n] != 0) is_held[labels_.frame.linear(i, j, z)] = 1;
                               });
        },
        1);
  }

  void add_entries(std::size_t m, const Mask& is_held, BlockGrid& grid) const {
    const Mask outside = indicator(m, true);
    const Mask core = core_of(outside, r_, BoxSets(boxes_[m].dims, steps_));
    parallel_for_each_index(
        0, grid.blocks.size(),
        [&](std::size_t b) {
          Block& block = grid.blocks[b];
          for_each_common_node(
              m, block.lo, grid.end_of(block), [&](std::size_t n, int i, int j, int k) {
                if (outside[n] == 0 || core[n] != 0 || is_held[labels_.frame.linear(i, j, k)] != 0)
                  return;
                const int offset =
                    ((k - block.lo[2]) * kBlock + j - block.lo[1]) * kBlock + i - block.lo[0];
                block.entries.push_back(
                    {static_cast<std::uint16_t>(offset), static_cast<MaterialId>(m)});
              });
        },
        16);
  }

  const Grid<MaterialId>& labels_;
  double r_;
  Vec3 steps_;
  std::vector<MaterialBox> boxes_;
};

// ---- flow ---------------------------------------------------------------------------------

// Half of a symmetric kernel: weight of the nodes at distance 0, 1, ... along one axis.
using HalfKernel = std::vector<float>;

HalfKernel gaussian(double sigma_nodes) {
  // Three sigma hold 99.7 % of the weight; what is left out is the same for all materials.
  const int reach = static_cast<int>(std::ceil(3 * sigma_nodes));
  std::vector<double> weights(static_cast<std::size_t>(reach) + 1);
  double sum = 0;
  for (int d = 0; d <= reach; ++d) {
    weights[d] = std::exp(-0.5 * d * d / (sigma_nodes * sigma_nodes));
    sum += d == 0 ? weights[d] : 2 * weights[d];
  }
  HalfKernel kernel;
  for (const double w : weights)
    kernel.push_back(static_cast<float>(w / sum));
  return kernel;
}

class Flow {
 public:
  Flow(const Grid<MaterialId>& original,
       Grid<MaterialId> current,
       const std::vector<bool>& may_move,
       double r_vox)
      : labels(std::move(current)), original_(original), may_move_(may_move) {
    const Vec3 steps = steps_in_voxels(original.frame);
    for (int axis = 0; axis < 3; ++axis) {
      // Blurring by sigma moves a boundary of curvature 1/r by sigma^2 / (2 r): half a voxel.
      kernels_[axis] = gaussian(std::sqrt(r_vox) / steps[axis]);
      reach_[axis] = static_cast<int>(kernels_[axis].size()) - 1;
      padded_[axis] = kBlock + 2 * reach_[axis];
    }
  }

  Grid<MaterialId> labels;

  [[nodiscard]] const std::array<int, 3>& reach() const { return reach_; }

  // Nodes of the block that would rather have another material, by offset.
  [[nodiscard]] std::vector<Wish> wishes_of(const Block& block,
                                            const std::array<int, 3>& end) const {
    Scratch scratch(*this);
    gather(block, scratch);
    // Value of the node's own material, and the best of those that may take the node.
    std::array<float, kBlockNodes> own{}, best;
    std::array<MaterialId, kBlockNodes> best_material{};
    best.fill(-1);
    for (const MaterialId m : materials_at_stake(block, end)) {
      if (!may_move_[m] || !std::binary_search(scratch.present.begin(), scratch.present.end(), m))
        continue;
      blur(m, scratch);
      const auto offer = [&](std::size_t offset) {
        if (scratch.blurred[offset] <= best[offset]) return;
        best[offset] = scratch.blurred[offset];
        best_material[offset] = m;
      };
      for_each_node(block, end, [&](std::size_t offset, std::size_t node) {
        if (labels.values[node] == m)
          own[offset] = scratch.blurred[offset];
        else if (original_.values[node] == m)
          offer(offset);
      });
      const auto [from, to] =
          std::equal_range(block.entries.begin(), block.entries.end(), Entry{0, m},
                           [](const Entry& a, const Entry& b) { return a.material < b.material; });
      for (auto entry = from; entry != to; ++entry)
        offer(entry->offset);
    }
    std::vector<Wish> wishes;
    for_each_node(block, end, [&](std::size_t offset, std::size_t node) {
      if (may_move_[labels.values[node]] && best[offset] > own[offset] + kLeastGain &&
          best_material[offset] != labels.values[node])
        wishes.push_back({static_cast<std::uint16_t>(offset), best_material[offset]});
    });
    return wishes;
  }

 private:
  struct Scratch {
    std::vector<MaterialId> ids;      // the block and `reach` nodes around it
    std::vector<MaterialId> present;  // ascending
    std::vector<float> x_pass, y_pass;
    std::vector<float> column;
    std::array<float, kBlockNodes> blurred{};

    explicit Scratch(const Flow& flow)
        : ids(volume(flow.padded_)),
          x_pass(static_cast<std::size_t>(kBlock) * flow.padded_[1] * flow.padded_[2]),
          y_pass(static_cast<std::size_t>(kBlock) * kBlock * flow.padded_[2]),
          column(static_cast<std::size_t>(flow.padded_[0])) {}
  };

  template <typename Body>
  void for_each_node(const Block& block, const std::array<int, 3>& end, const Body& body) const {
    for (int k = block.lo[2]; k < end[2]; ++k)
      for (int j = block.lo[1]; j < end[1]; ++j) {
        const std::size_t offset =
            (static_cast<std::size_t>(k - block.lo[2]) * kBlock + (j - block.lo[1])) * kBlock;
        const std::size_t node = labels.frame.linear(block.lo[0], j, k);
        const auto count = static_cast<std::size_t>(end[0] - block.lo[0]);
        for (std::size_t i = 0; i < count; ++i)
          body(offset + i, node + i);
      }
  }

  // Materials that hold a node of the block or may take one, ascending.
  [[nodiscard]] std::vector<MaterialId> materials_at_stake(const Block& block,
                                                           const std::array<int, 3>& end) const {
    std::vector<MaterialId> list;
    for (const Entry& entry : block.entries)
      if (list.empty() || list.back() != entry.material) list.push_back(entry.material);
    for_each_node(block, end, [&](std::size_t, std::size_t node) {
      for (const MaterialId m : {labels.values[node], original_.values[node]}) {
        const auto at = std::lower_bound(list.begin(), list.end(), m);
        if (at == list.end() || *at != m) list.insert(at, m);
      }
    });
    return list;
  }

  // Nodes beyond the grid repeat its border.
  void gather(const Block& block, Scratch& scratch) const {
    const auto& dims = labels.frame.dims;
    std::size_t n = 0;
    for (int k = 0; k < padded_[2]; ++k)
      for (int j = 0; j < padded_[1]; ++j) {
        const int y = std::clamp(block.lo[1] - reach_[1] + j, 0, dims[1] - 1);
        const int z = std::clamp(block.lo[2] - reach_[2] + k, 0, dims[2] - 1);
        const MaterialId* row = &labels.values[labels.frame.linear(0, y, z)];
        for (int i = 0; i < padded_[0]; ++i) {
          const MaterialId m = row[std::clamp(block.lo[0] - reach_[0] + i, 0, dims[0] - 1)];
          if (n == 0 || m != scratch.ids[n - 1]) {
            const auto at = std::lower_bound(scratch.present.begin(), scratch.present.end(), m);
            if (at == scratch.present.end() || *at != m) scratch.present.insert(at, m);
          }
          scratch.ids[n++] = m;
        }
      }
  }

  // The blurred indicator of m on the nodes of the block.
  void blur(MaterialId m, Scratch& scratch) const {
    const auto [px, py, pz] = padded_;
    for (int row = 0; row < py * pz; ++row) {
      const MaterialId* ids = &scratch.ids[static_cast<std::size_t>(row) * px];
      float* out = &scratch.x_pass[static_cast<std::size_t>(row) * kBlock];
      int count = 0;
      for (int i = 0; i < px; ++i) {
        scratch.column[i] = ids[i] == m ? 1.0F : 0.0F;
        count += ids[i] == m ? 1 : 0;
      }
      if (count == 0 || count == px) {
        std::fill_n(out, kBlock, count == 0 ? 0.0F : 1.0F);
        continue;
      }
      weigh(scratch.column.data(), 1, kBlock, kernels_[0], out);
    }
    for (int k = 0; k < pz; ++k)
      weigh(&scratch.x_pass[static_cast<std::size_t>(k) * py * kBlock], kBlock, kBlock * kBlock,
            kernels_[1], &scratch.y_pass[static_cast<std::size_t>(k) * kBlock * kBlock]);
    weigh(scratch.y_pass.data(), kBlock * kBlock, kBlockNodes, kernels_[2], scratch.blurred.data());
  }

  // out[i] = sum over d of kernel[|d|] in[i + (reach + d) * stride].
  static void weigh(const float* in, int stride, int count, const HalfKernel& kernel, float* out) {
    const int reach = static_cast<int>(kernel.size()) - 1;
    const float* middle = in + static_cast<std::ptrdiff_t>(reach) * stride;
    for (int i = 0; i < count; ++i)
      out[i] = kernel[0] * middle[i];
    for (int d = 1; d <= reach; ++d) {
      const float* left = middle - static_cast<std::ptrdiff_t>(d) * stride;
      const float* right = middle + static_cast<std::ptrdiff_t>(d) * stride;
      const float weight = kernel[d];
      for (int i = 0; i < count; ++i)
        out[i] += weight * (left[i] + right[i]);
    }
  }

  const Grid<MaterialId>& original_;
  const std::vector<bool>& may_move_;
  std::array<HalfKernel, 3> kernels_;
  std::array<int, 3> reach_{}, padded_{};
};

// Carries out the wishes that are simple changes, colour after colour; the others stay in
// `refused` of their blocks. Returns which blocks have changed nodes.
std::vector<std::uint8_t> carry_out(std::vector<std::vector<Wish>>& wishes,
                                    const std::vector<std::size_t>& block_of,
                                    BlockGrid& grid,
                                    Grid<MaterialId>& labels) {
  std::vector<std::uint8_t> has_changed(wishes.size());
  for (int colour = 0; colour < 8; ++colour)
    parallel_for_each_index(
        0, wishes.size(),
        [&](std::size_t w) {
          Block& block = grid.blocks[block_of[w]];
          for (const Wish& wish : wishes[w]) {
            const auto at = place_in(block, wish.offset);
            if (lattice_colour(at[0], at[1], at[2]) != colour) continue;
            if (is_simple_change(labels, at[0], at[1], at[2], wish.material)) {
              labels(at[0], at[1], at[2]) = wish.material;
              has_changed[w] = 1;
            } else {
              block.refused.push_back(wish);
            }
          }
        },
        16);
  return has_changed;
}

// One iteration: false when no node has changed.
bool advance(Flow& flow, BlockGrid& grid) {
  std::vector<std::size_t> due;
  for (std::size_t b = 0; b < grid.blocks.size(); ++b)
    if (grid.blocks[b].is_due && !grid.blocks[b].entries.empty()) due.push_back(b);
  std::vector<std::vector<Wish>> wishes(due.size());
  parallel_for_each_index(
      0, due.size(),
      [&](std::size_t d) {
        Block& block = grid.blocks[due[d]];
        block.refused.clear();
        wishes[d] = flow.wishes_of(block, grid.end_of(block));
      },
      4);
  const auto has_changed = carry_out(wishes, due, grid, flow.labels);
  for (Block& block : grid.blocks)
    block.is_due = false;
  bool is_moving = false;
  for (std::size_t d = 0; d < due.size(); ++d) {
    if (has_changed[d] == 0) continue;
    is_moving = true;
    const Block& block = grid.blocks[due[d]];
    auto last = grid.end_of(block);
    for (int& c : last)
      --c;
    grid.mark_due(block.lo, last, flow.reach());
  }
  return is_moving;
}

// By block and material.
using GuardedPlaces = std::map<std::pair<std::size_t, MaterialId>, GuardedPlace>;

// What the guard held when a flow ended; a later flow has the last word on a place.
void list_guarded(const BlockGrid& grid, const Grid<MaterialId>& labels, GuardedPlaces& places) {
  GuardedPlaces found;
  for (std::size_t b = 0; b < grid.blocks.size(); ++b)
    for (const Wish& wish : grid.blocks[b].refused) {
      const auto at = place_in(grid.blocks[b], wish.offset);
      const MaterialId m = labels(at[0], at[1], at[2]);
      GuardedPlace& place = found[{b, m}];
      place.material = m;
      place.position += labels.frame.index_to_mm({double(at[0]), double(at[1]), double(at[2])});
      ++place.nodes;
    }
  for (auto& [key, place] : found) {
    place.position = place.position / static_cast<double>(place.nodes);
    places[key] = place;
  }
}

// The flow at one radius, from `result.labels` on.
void flow_at(double r_vox,
             const Grid<MaterialId>& original,
             const std::vector<bool>& may_move,
             int max_iterations,
             const StageProgress& progress,
             GuardedFlowResult& result,
             GuardedPlaces& guarded) {
  BlockGrid grid(original.frame);
  Obstacles(original, may_move, r_vox).find_entries(grid, progress);
  Flow flow(original, std::move(result.labels), may_move, r_vox);
  int iteration = 0;
  while (iteration < max_iterations && advance(flow, grid)) {
    ++iteration;
    progress.context.log->debug("tightening: r {:g}, iteration {}", r_vox, iteration);
    progress.report(0.7 + 0.3 * iteration / std::max(max_iterations, 1));
  }
  result.iterations += iteration;
  result.labels = std::move(flow.labels);
  progress.report(1);
  list_guarded(grid, result.labels, guarded);
}

}  // namespace

GuardedFlowResult guarded_flow(const Grid<MaterialId>& labels,
                               const std::vector<double>& r_vox,
                               int max_iterations,
                               const StageContext& context,
                               double last_progress) {
  std::set<double> radii(r_vox.begin(), r_vox.end());
  radii.erase(radii.begin(), radii.lower_bound(1));
  GuardedFlowResult result;
  result.labels = labels;
  GuardedPlaces guarded;
  double done = 0;
  for (const double r : radii) {
    std::vector<bool> may_move(r_vox.size());
    for (std::size_t m = 0; m < r_vox.size(); ++m)
      may_move[m] = r_vox[m] >= r;
    const double next = done + last_progress / static_cast<double>(radii.size());
    flow_at(r, labels, may_move, max_iterations, {context, done, next}, result, guarded);
    done = next;
  }
  for (const auto& [key, place] : guarded) {
    result.guarded.push_back(place);
    result.nodes_guarded += place.nodes;
  }
  std::stable_sort(result.guarded.begin(), result.guarded.end(),
                   [](const GuardedPlace& a, const GuardedPlace& b) { return a.nodes > b.nodes; });
  for (std::size_t n = 0; n < labels.values.size(); ++n)
    if (result.labels.values[n] != labels.values[n]) ++result.nodes_changed;
  return result;
}

}  // namespace cvmesh
