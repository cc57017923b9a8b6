// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/facet_index.h"

#include <algorithm>

namespace cvmesh {

FacetIndex::FacetIndex(const Box3& bounds, double finest_mm) : finest_(finest_mm), cells_(1) {
  const Vec3 extent = bounds.extent();
  side_ = std::max({extent.x, extent.y, extent.z, finest_mm});
  origin_ = bounds.is_empty() ? Vec3{} : bounds.lo;
}

void FacetIndex::insert(std::int32_t id, const Box3& box) {
  if (static_cast<std::size_t>(id) >= entries_.size()) entries_.resize(id + 1);
  const Vec3 extent = box.extent();
  const double longest = std::max({extent.x, extent.y, extent.z});
  const Vec3 center = 0.5 * (box.lo + box.hi);
  std::int32_t cell = 0;
  Vec3 lo = origin_;
  double side = side_;
  ++cells_[0].count;
  for (int depth = 0; depth + 1 < kMaxDepth && side / 2 >= longest && side / 2 >= finest_;
       ++depth) {
    if (cells_[cell].children < 0) {
      const auto first = static_cast<std::int32_t>(cells_.size());
      cells_.resize(cells_.size() + 8);
      cells_[cell].children = first;
      for (int c = 0; c < 8; ++c)
        cells_[first + c].parent = cell;
    }
    side /= 2;
    const int child = (center.x >= lo.x + side ? 1 : 0) | (center.y >= lo.y + side ? 2 : 0) |
                      (center.z >= lo.z + side ? 4 : 0);
    lo = child_corner(lo, side, child);
    cell = cells_[cell].children + child;
    ++cells_[cell].count;
  }
  Entry& entry = entries_[id];
  entry = {box, cell, cells_[cell].first, -1};
  if (entry.next >= 0) entries_[entry.next].previous = id;
  cells_[cell].first = id;
}

void FacetIndex::remove(std::int32_t id) {
  Entry& entry = entries_[id];
  if (entry.previous >= 0)
    entries_[entry.previous].next = entry.next;
  else
    cells_[entry.cell].first = entry.next;
  if (entry.next >= 0) entries_[entry.next].previous = entry.previous;
  for (auto cell = entry.cell; cell >= 0; cell = cells_[cell].parent)
    --cells_[cell].count;
  entry.cell = -1;
}

}  // namespace cvmesh
