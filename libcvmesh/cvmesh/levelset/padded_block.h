// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/levelset/level_sets.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

namespace cvmesh {

/// A row of a block at once; the compiler makes of it what the machine has.
using BlockRow = float __attribute__((vector_size(4 * BlockTable::kBlock)));

inline void load(const float* from, BlockRow& row) {
  std::memcpy(&row, from, sizeof row);
}

inline void store(const BlockRow& row, float* to) {
  std::memcpy(to, &row, sizeof row);
}

/// A block of nodes with `Halo` nodes around it, x fastest.
template <int Halo>
struct PaddedBlock {
  static constexpr int kSpan = BlockTable::kBlock + 2 * Halo;
  static constexpr int kSpan2 = kSpan * kSpan;
  alignas(64) std::array<float, kSpan * kSpan2> values;

  /// Place of node (i, j, k) of the block, each from -Halo to kBlock + Halo - 1.
  static constexpr int at(int i, int j, int k) {
    return ((k + Halo) * kSpan + j + Halo) * kSpan + Halo + i;
  }

  /// The 7-point Laplacian at a place, for the values in `f`.
  static float laplacian(const float* f, int at) {
    return f[at - 1] + f[at + 1] + f[at - kSpan] + f[at + kSpan] + f[at - kSpan2] + f[at + kSpan2] -
           6 * f[at];
  }
};

/// Reads arrays that are laid out as `LevelSets::values`, each slot with what lies around it.
///
/// Where nothing is stored, far from the boundary, there is +-`far`; beyond the grid its border is
/// repeated. Holds 27 neighbours for each slot, and a reference to the level sets.
class SlotReader {
 public:
  SlotReader(const LevelSets& level_sets, float far);

  [[nodiscard]] std::size_t size() const { return level_sets_.slots.size(); }

  [[nodiscard]] const LevelSets& level_sets() const { return level_sets_; }

  /// Entries (as in `BlockTable`) of the 27 blocks around a slot, x fastest; [13] is its own.
  [[nodiscard]] const std::array<std::int32_t, 27>& neighbours(std::size_t slot) const {
    return neighbours_[slot];
  }

  /// The slot's block of `values` with its halo.
  template <int Halo>
  void gather(std::size_t slot, const std::vector<float>& values, PaddedBlock<Halo>& out) const {
    Blocks blocks;
    for (std::size_t n = 0; n < 27; ++n) {
      std::int32_t entry = neighbours_[slot][n];
      blocks.sign[n] = BlockTable::is_mirrored(entry) ? -1.0F : 1.0F;
      if (BlockTable::is_mirrored(entry)) entry = BlockTable::mirrored(entry);
      blocks.values[n] = entry >= 0
                             ? &values[static_cast<std::size_t>(entry) * BlockTable::kBlockNodes]
                             : (entry == BlockTable::kInside ? inside_ : outside_).data();
    }
    if (is_inner<Halo>(slot))
      gather_inner(blocks, out);
    else
      gather_at_border(slot, blocks, out);
  }

 private:
  static constexpr int kBlock = BlockTable::kBlock;

  // The 27 blocks around a slot, and the signs with which they count.
  struct Blocks {
    std::array<const float*, 27> values;
    std::array<float, 27> sign;
  };

  template <int Halo>
  [[nodiscard]] bool is_inner(std::size_t slot) const {
    const auto& dims = level_sets_.frame().dims;
    for (int axis = 0; axis < 3; ++axis) {
      const int first = level_sets_.slots[slot].block[axis] * kBlock;
      if (first < Halo || first + kBlock + Halo > dims[axis]) return false;
    }
    return true;
  }

  template <int Halo>
  static void gather_inner(const Blocks& blocks, PaddedBlock<Halo>& padded) {
    const auto which = [](int i) { return i < 0 ? 0 : i < kBlock ? 1 : 2; };
    float* out = padded.values.data();
    for (int k = -Halo; k < kBlock + Halo; ++k)
      for (int j = -Halo; j < kBlock + Halo; ++j, out += PaddedBlock<Halo>::kSpan) {
        const int n = (which(k) * 3 + which(j)) * 3;
        const int row = ((k & (kBlock - 1)) * kBlock + (j & (kBlock - 1))) * kBlock;
        const float* left = blocks.values[n] + row + kBlock - Halo;
        const float* right = blocks.values[n + 2] + row;
        BlockRow middle;
        load(blocks.values[n + 1] + row, middle);
        for (int i = 0; i < Halo; ++i)
          out[i] = blocks.sign[n] * left[i];
        store(blocks.sign[n + 1] * middle, out + Halo);
        for (int i = 0; i < Halo; ++i)
          out[Halo + kBlock + i] = blocks.sign[n + 2] * right[i];
      }
  }

  template <int Halo>
  void gather_at_border(std::size_t slot, const Blocks& blocks, PaddedBlock<Halo>& padded) const {
    constexpr int kSpan = PaddedBlock<Halo>::kSpan;
    // Along each axis: which of the three blocks, and where in it.
    std::array<std::array<int, kSpan>, 3> which, place;
    for (int axis = 0; axis < 3; ++axis) {
      const int first = level_sets_.slots[slot].block[axis] * kBlock;
      for (int i = 0; i < kSpan; ++i) {
        const int node = std::clamp(first - Halo + i, 0, level_sets_.frame().dims[axis] - 1);
        which[axis][i] = node / kBlock - first / kBlock + 1;
        place[axis][i] = node % kBlock;
      }
    }
    float* out = padded.values.data();
    for (int k = 0; k < kSpan; ++k)
      for (int j = 0; j < kSpan; ++j)
        for (int i = 0; i < kSpan; ++i) {
          const int n = (which[2][k] * 3 + which[1][j]) * 3 + which[0][i];
          const int node = (place[2][k] * kBlock + place[1][j]) * kBlock + place[0][i];
          *out++ = blocks.sign[n] * blocks.values[n][node];
        }
  }

  const LevelSets& level_sets_;
  std::vector<std::array<std::int32_t, 27>> neighbours_;
  std::array<float, BlockTable::kBlockNodes> outside_, inside_;
};

}  // namespace cvmesh
