// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace cvmesh {

/// Where the values of one material are: for each block of 8^3 nodes of the material's own box, a
/// slot of `LevelSets::values` or what stands for one.
struct BlockTable {
  static constexpr int kBlock = 8;
  static constexpr int kBlockNodes = kBlock * kBlock * kBlock;
  /// Entries of blocks far from the material's boundary: all -1, all +1.
  static constexpr std::int32_t kOutside = -1, kInside = -2;

  std::array<int, 3> first_block{0, 0, 0};  ///< of the material's own box, in blocks of the grid
  std::array<int, 3> blocks{0, 0, 0};
  std::vector<std::int32_t> entry;  ///< x fastest; slot >= 0, kOutside, kInside or a mirrored slot

  /// Where only two materials are near, one is minus the other and one slot serves both.
  static constexpr std::int32_t mirrored(std::int32_t slot) { return -3 - slot; }

  static constexpr bool is_mirrored(std::int32_t entry) { return entry <= -3; }

  /// Place in `entry` of a block given by its place in the grid of blocks; it must be inside.
  [[nodiscard]] std::size_t index(const std::array<int, 3>& block) const {
    return (static_cast<std::size_t>(block[2] - first_block[2]) * blocks[1] + block[1] -
            first_block[1]) *
               blocks[0] +
           block[0] - first_block[0];
  }

  /// Entry of a block given by its place in the grid of blocks; kOutside beyond the own box.
  [[nodiscard]] std::int32_t at(const std::array<int, 3>& block) const {
    for (int axis = 0; axis < 3; ++axis)
      if (block[axis] < first_block[axis] || block[axis] >= first_block[axis] + blocks[axis])
        return kOutside;
    return entry[index(block)];
  }

  /// Place of grid node (i, j, k) inside its block.
  static int offset(int i, int j, int k) {
    return ((k % kBlock) * kBlock + j % kBlock) * kBlock + i % kBlock;
  }
};

/// The level sets of all materials on one grid, in a narrow band only: values are signed distances
/// in units of 3 voxels (steps of the grid), positive inside, clamped to [-1, 1]. Before they are
/// smoothed, and where r is 0, they are blurred indicators instead, with the same signs.
///
/// At every node the own label's value is positive and every other negative, so `argmax` of the
/// values is the label: the topology of any surface extracted from node labels is fixed, whatever
/// the values in between.
///
/// Memory follows the interface area: a block of 8^3 nodes is stored once where two materials are
/// within four nodes of it, once for each material where more are, and not at all elsewhere.
class LevelSets {
 public:
  static constexpr float kVoxelsToOne = 3;

  /// What a slot of `values` holds: the block of nodes `block` (place in the grid of blocks) of
  /// `material`; `mirror` is the other material that it serves, or `material` again.
  struct Slot {
    std::array<std::int32_t, 3> block;
    MaterialId material, mirror;
  };

  std::shared_ptr<const Grid<MaterialId>> labels;  ///< the (tightened) node labels
  std::vector<BlockTable> tables;                  ///< one per material, the exterior included
  std::vector<Slot> slots;
  std::vector<float> values;  ///< kBlockNodes for each slot, x fastest

  [[nodiscard]] std::size_t material_count() const { return tables.size(); }

  [[nodiscard]] const GridFrame& frame() const { return labels->frame; }

  /// Value of material m at node (i, j, k); nodes outside the grid repeat the nearest border node.
  [[nodiscard]] double at(MaterialId m, int i, int j, int k) const;

  /// Trilinear value of `a` minus `b` at a point (grid mm): zero on their interface, positive on
  /// the side of a.
  [[nodiscard]] double difference(MaterialId a, MaterialId b, const Vec3& p) const;

  /// `difference` and its gradient (per mm), from the same eight nodes.
  struct Sample {
    double value = 0;
    Vec3 gradient;
  };

  [[nodiscard]] Sample sample_difference(MaterialId a, MaterialId b, const Vec3& p) const;

  /// Gradient of `a` minus `b` (per mm) by central differences over one grid step to each side:
  /// continuous, and on curved interfaces twice as close to the true normal as that of
  /// `sample_difference`, which jumps from cell to cell.
  [[nodiscard]] Vec3 smooth_gradient(MaterialId a, MaterialId b, const Vec3& p) const;
};

}  // namespace cvmesh
