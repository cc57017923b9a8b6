// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/facet_index.h"

#include "cvmesh/core/assert.h"

namespace cvmesh {

FacetIndex::FacetIndex(const Box3& bounds, double finest_mm)
    : origin_(bounds.is_empty() ? Vec3{} : bounds.lo) {
  const Vec3 extent = bounds.extent();
  const double longest = std::max({extent.x, extent.y, extent.z, finest_mm});
  for (double side = finest_mm;; side *= 2) {
    Level& level = levels_.emplace_back();
    level.side = side;
    for (int axis = 0; axis < 3; ++axis) {
      level.cells[axis] = static_cast<int>(extent[axis] / side) + 1;
      level.bricks[axis] = (level.cells[axis] + kLast) / kBrick;
    }
    level.brick_at.assign(
        static_cast<std::size_t>(level.bricks[0]) * level.bricks[1] * level.bricks[2], -1);
    // the last level holds the largest boxes there can be, as long as their centres are in bounds
    if (side >= 2 * longest) break;
  }
}

void FacetIndex::insert(std::int32_t id, const Box3& box) {
  if (static_cast<std::size_t>(id) >= place_of_.size()) place_of_.resize(id + 1);
  CVMESH_ASSERT(place_of_[id].cell < 0);
  const Vec3 extent = box.extent();
  const double longest = std::max({extent.x, extent.y, extent.z});
  std::size_t l = 0;
  while (l + 1 < levels_.size() && levels_[l].side < longest)
    ++l;
  Level& level = levels_[l];
  const Cell cell = cell_at(level, 0.5 * (box.lo + box.hi));
  std::int32_t& brick =
      level.brick_at[brick_index(level, cell[0] / kBrick, cell[1] / kBrick, cell[2] / kBrick)];
  if (brick < 0) {
    brick = static_cast<std::int32_t>(boxes_in_brick_.size());
    cells_.resize(cells_.size() + kCellsOfBrick);
    boxes_in_brick_.push_back(0);
  }
  const std::size_t place = cell_index(brick, cell);
  cells_[place].push_back({FloatBox(box), id});
  place_of_[id] = {static_cast<std::int32_t>(place), static_cast<std::int32_t>(l)};
  ++boxes_in_brick_[brick];
  ++level.count;
}

void FacetIndex::remove(std::int32_t id) {
  Place& place = place_of_[id];
  CVMESH_ASSERT(place.cell >= 0);
  std::vector<Entry>& cell = cells_[place.cell];
  const auto entry =
      std::find_if(cell.begin(), cell.end(), [&](const Entry& e) { return e.id == id; });
  CVMESH_ASSERT(entry != cell.end());
  *entry = cell.back();
  cell.pop_back();
  --boxes_in_brick_[static_cast<std::size_t>(place.cell) / kCellsOfBrick];
  --levels_[place.level].count;
  place = {};
}

}  // namespace cvmesh
