// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/float_box.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

namespace cvmesh {

/// Boxes that come and go, found by where they are: a loose grid for every power of two of sizes
/// [Ulrich 2000], so that a query stays fast while box sizes differ by orders of magnitude.
///
/// A box lives on the finest level whose cells are at least as long as the box, in the cell of its
/// centre; a cell is looked at with half a side of margin all round. Cells hold their boxes side by
/// side, and bricks of cells exist only where boxes are. Insertion and removal take constant time;
/// a query looks at the cells it meets on the levels that are in use.
///
/// A query finds every box that overlaps, and may find one that misses by a rounding error.
/// Queries may run at the same time.
class FacetIndex {
 public:
  struct Entry {
    FloatBox box;
    std::int32_t id;
  };

  /// @param bounds     holds the centre of every box that will be inserted
  /// @param finest_mm  side of the smallest cells
  FacetIndex(const Box3& bounds, double finest_mm);

  void insert(std::int32_t id, const Box3& box);
  void remove(std::int32_t id);

  /// Calls `visit(entry)` for every box that overlaps `box`, in an order that depends only on the
  /// history of insertions and removals.
  template <typename Visit>
  void query(const Box3& box, const Visit& visit) const {
    const Overlap overlap{FloatBox(box)};
    for (const Level& level : levels_) {
      if (level.count == 0) continue;
      const Cell lo = cell_at(level, box.lo - 0.5 * level.side * Vec3{1, 1, 1});
      const Cell hi = cell_at(level, box.hi + 0.5 * level.side * Vec3{1, 1, 1});
      for (int bk = lo[2] / kBrick; bk <= hi[2] / kBrick; ++bk)
        for (int bj = lo[1] / kBrick; bj <= hi[1] / kBrick; ++bj)
          for (int bi = lo[0] / kBrick; bi <= hi[0] / kBrick; ++bi) {
            const std::int32_t brick = level.brick_at[brick_index(level, bi, bj, bk)];
            if (brick < 0 || boxes_in_brick_[brick] == 0) continue;
            const auto for_each_cell = [&](const auto& look_into) {
              for (int k = std::max(lo[2], bk * kBrick); k <= std::min(hi[2], bk * kBrick + kLast);
                   ++k)
                for (int j = std::max(lo[1], bj * kBrick);
                     j <= std::min(hi[1], bj * kBrick + kLast); ++j)
                  for (int i = std::max(lo[0], bi * kBrick);
                       i <= std::min(hi[0], bi * kBrick + kLast); ++i)
                    look_into(cells_[cell_index(brick, {i, j, k})]);
            };
            // all are asked for before the first is waited for
            for_each_cell([](const std::vector<Entry>& cell) { __builtin_prefetch(cell.data()); });
            for_each_cell([&](const std::vector<Entry>& cell) {
              for (const Entry& entry : cell)
                if (overlap.with(entry)) visit(entry);
            });
          }
    }
  }

 private:
  static constexpr int kBrick = 4;  // cells along a side
  static constexpr int kLast = kBrick - 1;
  static constexpr std::size_t kCellsOfBrick = std::size_t{kBrick} * kBrick * kBrick;
  using Cell = std::array<int, 3>;
  // A vector extension that GCC and Clang share.
  using Lanes [[gnu::vector_size(16)]] = float;

  // Tests entries against one box, all axes at once: a query looks at hundreds.
  class Overlap {
   public:
    explicit Overlap(const FloatBox& box)
        : lo_{box.lo[0], box.lo[1], box.lo[2], 0}, hi_{box.hi[0], box.hi[1], box.hi[2], 0} {}

    [[nodiscard]] bool with(const Entry& entry) const {
      // each with what comes next in the entry, which does not count
      static_assert(offsetof(Entry, id) == 24 && sizeof(Entry) == 28);
      Lanes lo, hi;
      const auto* const bytes = reinterpret_cast<const unsigned char*>(&entry);
      std::memcpy(&lo, bytes, sizeof lo);
      std::memcpy(&hi, bytes + 12, sizeof hi);
      const auto is_within = (lo <= hi_) & (lo_ <= hi);
#ifdef __SSE__
      return (__builtin_ia32_movmskps(reinterpret_cast<Lanes>(is_within)) & 7) == 7;
#else
      return is_within[0] != 0 && is_within[1] != 0 && is_within[2] != 0;
#endif
    }

   private:
    Lanes lo_, hi_;
  };

  struct Level {
    double side = 1;
    std::array<int, 3> cells{1, 1, 1}, bricks{1, 1, 1};
    std::vector<std::int32_t> brick_at;  // -1: none yet
    std::size_t count = 0;               // boxes on this level
  };

  static std::size_t brick_index(const Level& level, int i, int j, int k) {
    return (static_cast<std::size_t>(k) * level.bricks[1] + j) * level.bricks[0] + i;
  }

  static std::size_t cell_index(std::int32_t brick, const Cell& cell) {
    const int local = ((cell[2] % kBrick) * kBrick + cell[1] % kBrick) * kBrick + cell[0] % kBrick;
    return static_cast<std::size_t>(brick) * kCellsOfBrick + static_cast<std::size_t>(local);
  }

  [[nodiscard]] Cell cell_at(const Level& level, const Vec3& p) const {
    Cell cell;
    for (int axis = 0; axis < 3; ++axis)
      cell[axis] = static_cast<int>(
          std::clamp((p[axis] - origin_[axis]) / level.side, 0.0, level.cells[axis] - 1.0));
    return cell;
  }

  struct Place {
    std::int32_t cell = -1;
    std::int32_t level = -1;
  };

  Vec3 origin_;
  std::vector<Level> levels_;
  std::vector<std::vector<Entry>> cells_;      // of all bricks
  std::vector<std::uint32_t> boxes_in_brick_;  // where surfaces thin out, most have none left
  std::vector<Place> place_of_;                // by id
};

}  // namespace cvmesh
