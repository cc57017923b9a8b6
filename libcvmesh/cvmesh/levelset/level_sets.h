// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"

namespace cvmesh {

/// One material's level set in a narrow band, in blocks of 8^3 nodes.
///
/// Values are positive inside, negative outside, clamped to [-1, 1]; 1 is about one and a half
/// voxels from the zero set. Nodes whose block is not stored are +1 or -1 by their label.
struct SparseLevelSet {
  static constexpr int kBlock = 8;
  std::array<int, 3> first_block{0, 0, 0};  ///< of the material's own box, in blocks of the grid
  std::array<int, 3> blocks{0, 0, 0};
  std::vector<std::int32_t> block_at;       ///< x fastest; -1 where none is stored
  std::vector<float> values;                ///< block after block, x fastest inside each
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
