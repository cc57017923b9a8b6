// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/level_sets.h"

#include <algorithm>
#include <cmath>

namespace cvmesh {
namespace {

// The eight nodes around a point: lower corner and fractions, clamped to the grid.
struct CellAt {
  std::array<int, 3> lo;
  Vec3 fraction;
};

CellAt cell_at(const GridFrame& frame, const Vec3& p) {
  CellAt cell;
  const Vec3 index = frame.mm_to_index(p);
  for (int axis = 0; axis < 3; ++axis) {
    const double clamped = std::clamp(index[axis], 0.0, double(frame.dims[axis] - 1));
    const int lo = std::min(static_cast<int>(clamped), std::max(frame.dims[axis] - 2, 0));
    cell.lo[axis] = lo;
    cell.fraction[axis] = clamped - lo;
  }
  return cell;
}

}  // namespace

double LevelSets::at(MaterialId m, int i, int j, int k) const {
  const auto& dims = frame().dims;
  i = std::clamp(i, 0, dims[0] - 1);
  j = std::clamp(j, 0, dims[1] - 1);
  k = std::clamp(k, 0, dims[2] - 1);
  constexpr int kBlock = BlockTable::kBlock;
  const std::int32_t entry = tables[m].at({i / kBlock, j / kBlock, k / kBlock});
  if (entry == BlockTable::kOutside) return -1;
  if (entry == BlockTable::kInside) return 1;
  const bool is_mirrored = BlockTable::is_mirrored(entry);
  const auto slot = static_cast<std::size_t>(is_mirrored ? BlockTable::mirrored(entry) : entry);
  const float value = values[slot * BlockTable::kBlockNodes + BlockTable::offset(i, j, k)];
  return is_mirrored ? -value : value;
}

double LevelSets::difference(MaterialId a, MaterialId b, const Vec3& p) const {
  return sample_difference(a, b, p).value;
}

LevelSets::Sample LevelSets::sample_difference(MaterialId a, MaterialId b, const Vec3& p) const {
  const CellAt cell = cell_at(frame(), p);
  double v[2][2][2];
  for (int dk = 0; dk < 2; ++dk)
    for (int dj = 0; dj < 2; ++dj)
      for (int di = 0; di < 2; ++di) {
        const int i = cell.lo[0] + di, j = cell.lo[1] + dj, k = cell.lo[2] + dk;
        v[dk][dj][di] = at(a, i, j, k) - at(b, i, j, k);
      }
  const double x = cell.fraction.x, y = cell.fraction.y, z = cell.fraction.z;
  const auto mix = [](double s, double t, double w) { return s + w * (t - s); };
  double along_x[2][2];  // [dk][dj]
  double slope_x[2][2];
  for (int dk = 0; dk < 2; ++dk)
    for (int dj = 0; dj < 2; ++dj) {
      along_x[dk][dj] = mix(v[dk][dj][0], v[dk][dj][1], x);
      slope_x[dk][dj] = v[dk][dj][1] - v[dk][dj][0];
    }
  const double near_z = mix(along_x[0][0], along_x[0][1], y);
  const double far_z = mix(along_x[1][0], along_x[1][1], y);
  Sample sample;
  sample.value = mix(near_z, far_z, z);
  const Vec3 per_index{
      mix(mix(slope_x[0][0], slope_x[0][1], y), mix(slope_x[1][0], slope_x[1][1], y), z),
      mix(along_x[0][1] - along_x[0][0], along_x[1][1] - along_x[1][0], z), far_z - near_z};
  sample.gradient = divided_by(per_index, frame().spacing_mm);
  return sample;
}

Vec3 LevelSets::smooth_gradient(MaterialId a, MaterialId b, const Vec3& p) const {
  Vec3 gradient;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 step;
    step[axis] = frame().spacing_mm[axis];
    gradient[axis] = (difference(a, b, p + step) - difference(a, b, p - step)) / (2 * step[axis]);
  }
  return gradient;
}

}  // namespace cvmesh
