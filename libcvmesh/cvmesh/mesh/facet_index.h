// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A loose octree of boxes that come and go [Ulrich 2000]: finds what overlaps a query box while
/// box sizes differ by orders of magnitude.
///
/// A box lives in one cell: the deepest whose side is at least the box's longest side and that
/// holds the box's centre. A cell is looked at with half a side of margin all round. Insertion and
/// removal cost the depth of the tree; a query costs about the number of boxes it meets.
class FacetIndex {
 public:
  /// @param bounds     holds the centre of every box that will be inserted
  /// @param finest_mm  side of the smallest cells that are worth making
  FacetIndex(const Box3& bounds, double finest_mm);

  void insert(std::int32_t id, const Box3& box);
  void remove(std::int32_t id);

  /// Calls `visit(id)` for every box that overlaps `box`, in an order that depends only on the
  /// history of insertions.
  template <typename Visit>
  void query(const Box3& box, const Visit& visit) const {
    std::array<Step, 8 * kMaxDepth + 1> stack;
    int depth = 0;
    stack[depth++] = {0, origin_, side_};
    while (depth > 0) {
      const Step step = stack[--depth];
      const Cell& cell = cells_[step.cell];
      for (auto e = cell.first; e >= 0; e = entries_[e].next)
        if (entries_[e].box.overlaps(box)) visit(e);
      if (cell.children < 0) continue;
      const double half = step.side / 2, margin = half / 2;
      for (int c = 0; c < 8; ++c) {
        if (cells_[cell.children + c].count == 0) continue;
        const Vec3 lo = child_corner(step.lo, half, c);
        if (lo.x - margin > box.hi.x || lo.x + half + margin < box.lo.x ||
            lo.y - margin > box.hi.y || lo.y + half + margin < box.lo.y ||
            lo.z - margin > box.hi.z || lo.z + half + margin < box.lo.z)
          continue;
        stack[depth++] = {cell.children + c, lo, half};
      }
    }
  }

 private:
  static constexpr int kMaxDepth = 20;

  struct Cell {
    std::int32_t children = -1;  // first of eight
    std::int32_t first = -1;     // entries of this cell
    std::int32_t count = 0;      // entries of this cell and below
    std::int32_t parent = -1;
  };

  struct Entry {
    Box3 box;
    std::int32_t cell = -1, next = -1, previous = -1;
  };

  struct Step {
    std::int32_t cell;
    Vec3 lo;
    double side;
  };

  static Vec3 child_corner(const Vec3& lo, double half, int child) {
    return {lo.x + ((child & 1) != 0 ? half : 0), lo.y + ((child & 2) != 0 ? half : 0),
            lo.z + ((child & 4) != 0 ? half : 0)};
  }

  Vec3 origin_;
  double side_ = 1;
  double finest_ = 1;
  std::vector<Cell> cells_;
  std::vector<Entry> entries_;
};

}  // namespace cvmesh
