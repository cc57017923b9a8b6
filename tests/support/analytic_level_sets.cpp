// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/analytic_level_sets.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

namespace cvmesh::test_support {
namespace {

constexpr double kVoxelsToOne = 1.5;
constexpr double kMargin = 0.05;

// Distance in index space: the distance in mm over the length of its gradient per index step.
double in_voxels(const GridFrame& frame,
                 const Vec3& p,
                 const std::function<double(const Vec3&)>& distance_mm) {
  const double d = distance_mm(p);
  double slope2 = 0;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 step;
    step[axis] = 0.5 * frame.spacing_mm[axis];
    const double slope = distance_mm(p + step) - distance_mm(p - step);
    slope2 += slope * slope;
  }
  // At a medial point the differences cancel; the smallest spacing is the least the slope can be.
  return d / std::max(std::sqrt(slope2), frame.voxel_mm());
}

}  // namespace

GridFrame plain_frame(const std::array<int, 3>& dims, const Vec3& spacing_mm) {
  GridFrame frame;
  frame.dims = dims;
  frame.spacing_mm = spacing_mm;
  frame.index_to_world.rows = {Vec3{spacing_mm.x, 0, 0}, Vec3{0, spacing_mm.y, 0},
                               Vec3{0, 0, spacing_mm.z}};
  return frame;
}

Vec3 middle_of(const GridFrame& frame) {
  return frame.index_to_mm(
      {0.5 * (frame.dims[0] - 1), 0.5 * (frame.dims[1] - 1), 0.5 * (frame.dims[2] - 1)});
}

LevelSets store_everywhere(std::shared_ptr<const Grid<MaterialId>> labels,
                           std::size_t material_count,
                           const std::function<double(MaterialId m, int i, int j, int k)>& value) {
  constexpr int kBlock = BlockTable::kBlock;
  LevelSets result;
  const auto& dims = labels->frame.dims;
  for (std::size_t m = 0; m < material_count; ++m) {
    BlockTable table;
    for (int axis = 0; axis < 3; ++axis)
      table.blocks[axis] = (dims[axis] + kBlock - 1) / kBlock;
    for (int bk = 0; bk < table.blocks[2]; ++bk)
      for (int bj = 0; bj < table.blocks[1]; ++bj)
        for (int bi = 0; bi < table.blocks[0]; ++bi) {
          const auto material = static_cast<MaterialId>(m);
          table.entry.push_back(static_cast<std::int32_t>(result.slots.size()));
          result.slots.push_back({{bi, bj, bk}, material, material});
          for (int n = 0; n < BlockTable::kBlockNodes; ++n)
            result.values.push_back(static_cast<float>(
                value(material, std::min(bi * kBlock + n % kBlock, dims[0] - 1),
                      std::min(bj * kBlock + n / kBlock % kBlock, dims[1] - 1),
                      std::min(bk * kBlock + n / kBlock / kBlock, dims[2] - 1))));
        }
    result.tables.push_back(std::move(table));
  }
  result.labels = std::move(labels);
  return result;
}

LevelSets analytic_level_sets(const GridFrame& frame,
                              std::size_t material_count,
                              const SignedDistance& signed_distance_mm) {
  auto labels = std::make_shared<Grid<MaterialId>>(frame);
  for (int k = 0; k < frame.dims[2]; ++k)
    for (int j = 0; j < frame.dims[1]; ++j)
      for (int i = 0; i < frame.dims[0]; ++i) {
        const Vec3 p = frame.index_to_mm({double(i), double(j), double(k)});
        double best = -std::numeric_limits<double>::infinity();
        for (std::size_t m = 0; m < material_count; ++m) {
          const double d = signed_distance_mm(static_cast<MaterialId>(m), p);
          if (d > best) {
            best = d;
            (*labels)(i, j, k) = static_cast<MaterialId>(m);
          }
        }
      }

  return store_everywhere(labels, material_count, [&](MaterialId m, int i, int j, int k) {
    const Vec3 p = frame.index_to_mm({double(i), double(j), double(k)});
    const double d =
        in_voxels(frame, p, [&](const Vec3& q) { return signed_distance_mm(m, q); }) / kVoxelsToOne;
    return (*labels)(i, j, k) == m ? std::clamp(d, kMargin, 1.0) : std::clamp(d, -1.0, -kMargin);
  });
}

LevelSets analytic_level_sets(const GridFrame& frame,
                              const std::function<double(const Vec3&)>& signed_distance_mm) {
  return analytic_level_sets(frame, 2, [&](MaterialId m, const Vec3& p) {
    return m == 1 ? signed_distance_mm(p) : -signed_distance_mm(p);
  });
}

}  // namespace cvmesh::test_support
