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

/// One material's level set in a narrow band, in blocks of 8^3 nodes.
///
/// Values are positive inside, negative outside, clamped to [-1, 1]; 1 is two and a half
/// voxels from the zero set. Nodes whose block is not stored are +1 or -1 by their label.
struct SparseLevelSet {
  static constexpr int kBlock = 8;
  std::array<int, 3> first_block{0, 0, 0};  ///< of the material's own box, in blocks of the grid
  std::array<int, 3> blocks{0, 0, 0};
  std::vector<std::int32_t> block_at;  ///< x fastest; -1 where none is stored
  std::vector<float> values;           ///< block after block, x fastest inside each

  static constexpr int kBlockNodes = kBlock * kBlock * kBlock;

  /// Index of the stored block that holds grid node (i, j, k), or -1.
  [[nodiscard]] int block_of(int i, int j, int k) const {
    const int bi = i / kBlock - first_block[0], bj = j / kBlock - first_block[1],
              bk = k / kBlock - first_block[2];
    if (bi < 0 || bj < 0 || bk < 0 || bi >= blocks[0] || bj >= blocks[1] || bk >= blocks[2])
      return -1;
    return block_at[(static_cast<std::size_t>(bk) * blocks[1] + bj) * blocks[0] + bi];
  }

  /// Place in `block_at` of a block given by its place in the grid of blocks; it must be inside.
  [[nodiscard]] std::size_t table_index(const std::array<int, 3>& block) const {
    return (static_cast<std::size_t>(block[2] - first_block[2]) * blocks[1] + block[1] -
            first_block[1]) *
               blocks[0] +
           block[0] - first_block[0];
  }

  /// Place of grid node (i, j, k) inside its block.
  static int offset_in_block(int i, int j, int k) {
    return ((k % kBlock) * kBlock + j % kBlock) * kBlock + i % kBlock;
  }
};

/// The level sets of all materials on one grid. At every node the own label's value is positive
/// and every other negative, so `argmax` of the values is the label: the topology of any surface
/// extracted from node labels is fixed, whatever the values in between.
class LevelSets {
 public:
  std::shared_ptr<const Grid<MaterialId>> labels;  ///< the (tightened) node labels
  std::vector<SparseLevelSet> fields;              ///< one per material, the exterior included

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
};

}  // namespace cvmesh
