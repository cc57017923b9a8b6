// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/thinnest_parts.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/voxel_box.h"
#include "cvmesh/levelset/distance_transform.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cvmesh {
namespace {

/// The ridge is where the distance grows by less than this part of the way: it grows with the way
/// on a slope, and by cos of half the angle between the two nearest walls on a ridge.
constexpr double kRidgeSlope = 0.6;
/// Nearer to the boundary than this many voxels, stairs hide the slope: any growth counts.
constexpr double kStairs = 2.5;
/// Share of a boundary that may be thinner than what is called its thinnest part: stairs make
/// single voxels of every boundary look thin.
constexpr double kThinShare = 0.01;

using Voxel = std::array<int, 3>;

/// Bounding boxes of all materials, one voxel wider where the grid has it.
std::vector<VoxelBox> boxes_of(const LabelVolume& labels) {
  const auto& dims = labels.frame().dims;
  std::vector<VoxelBox> boxes(labels.material_count());
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        boxes[labels.ids(i, j, k)].add({{i, j, k}, {i, j, k}});
  for (VoxelBox& box : boxes)
    for (int axis = 0; axis < 3; ++axis) {
      box.lo[axis] = std::max(0, box.lo[axis] - 1);
      box.hi[axis] = std::min(dims[axis] - 1, box.hi[axis] + 1);
    }
  return boxes;
}

/// Distances of one material's voxels to the nearest voxel of another, in its box.
class Distances {
 public:
  Distances(const LabelVolume& labels, const VoxelBox& box, MaterialId material)
      : lo_(box.lo),
        dims_(box.dims()),
        step_(labels.frame().spacing_mm),
        voxel_(labels.frame().voxel_mm()) {
    std::vector<std::uint8_t> sites(static_cast<std::size_t>(dims_[0]) * dims_[1] * dims_[2]);
    parallel_for_each_index(
        0, static_cast<std::size_t>(dims_[2]),
        [&](std::size_t plane) {
          const int k = static_cast<int>(plane);
          for (int j = 0; j < dims_[1]; ++j)
            for (int i = 0; i < dims_[0]; ++i)
              sites[linear({i, j, k})] =
                  labels.ids(lo_[0] + i, lo_[1] + j, lo_[2] + k) != material ? 1 : 0;
        },
        1);
    squared_ = squared_distances(dims_, step_, sites);
  }

  [[nodiscard]] double at(const Voxel& local) const {
    return std::sqrt(static_cast<double>(squared_[linear(local)]));
  }

  /// Distance at the first ridge above a voxel of the grid.
  [[nodiscard]] double ridge_above(const Voxel& voxel) const {
    Voxel at_voxel{voxel[0] - lo_[0], voxel[1] - lo_[1], voxel[2] - lo_[2]};
    double here = at(at_voxel);
    for (;;) {
      Voxel best = at_voxel;
      double best_slope = here < kStairs * voxel_ ? 0 : kRidgeSlope, best_distance = here;
      for (int dk = -1; dk <= 1; ++dk)
        for (int dj = -1; dj <= 1; ++dj)
          for (int di = -1; di <= 1; ++di) {
            const Voxel next{at_voxel[0] + di, at_voxel[1] + dj, at_voxel[2] + dk};
            if (!contains(next) || (di == 0 && dj == 0 && dk == 0)) continue;
            const double there = at(next);
            const double way = norm(scaled_by(
                {static_cast<double>(di), static_cast<double>(dj), static_cast<double>(dk)},
                step_));
            if ((there - here) / way <= best_slope) continue;
            best_slope = (there - here) / way;
            best_distance = there;
            best = next;
          }
      if (best == at_voxel) return here;
      at_voxel = best;
      here = best_distance;
    }
  }

 private:
  [[nodiscard]] bool contains(const Voxel& v) const {
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (v[axis] < 0 || v[axis] >= dims_[axis]) return false;
    return true;
  }

  [[nodiscard]] std::size_t linear(const Voxel& v) const {
    return (static_cast<std::size_t>(v[2]) * dims_[1] + v[1]) * dims_[0] + v[0];
  }

  Voxel lo_, dims_;
  Vec3 step_;
  double voxel_;
  std::vector<float> squared_;
};

/// Calls `use(other voxel, axis)` for the neighbours across faces that differ from the voxel.
template <typename Use>
void for_each_other(const Grid<MaterialId>& ids, const Voxel& v, const Use& use) {
  for (int axis = 0; axis < 3; ++axis)
    for (const int step : {-1, 1}) {
      Voxel w = v;
      w[static_cast<std::size_t>(axis)] += step;
      if (ids.frame.contains(w[0], w[1], w[2]) && ids(w[0], w[1], w[2]) != ids(v[0], v[1], v[2]))
        use(w, axis);
    }
}

/// Feature sizes of the boundary voxels; zero elsewhere.
std::vector<float> feature_sizes(const LabelVolume& labels) {
  const GridFrame& frame = labels.frame();
  const double half_voxel = 0.5 * frame.voxel_mm();
  std::vector<float> feature(frame.size(), 0);
  const std::vector<VoxelBox> boxes = boxes_of(labels);
  for (std::size_t m = 0; m < boxes.size(); ++m) {
    if (boxes[m].is_empty()) continue;
    const VoxelBox& box = boxes[m];
    const Distances distances(labels, box, static_cast<MaterialId>(m));
    parallel_for_each_index(
        0, static_cast<std::size_t>(box.dims()[2]),
        [&](std::size_t plane) {
          const int k = box.lo[2] + static_cast<int>(plane);
          for (int j = box.lo[1]; j <= box.hi[1]; ++j)
            for (int i = box.lo[0]; i <= box.hi[0]; ++i) {
              if (labels.ids(i, j, k) != m) continue;
              bool is_boundary = false;
              for_each_other(labels.ids, {i, j, k}, [&](const Voxel&, int) { is_boundary = true; });
              if (is_boundary)  // the boundary is half a voxel nearer than the next voxel's centre
                feature[frame.linear(i, j, k)] =
                    static_cast<float>(distances.ridge_above({i, j, k}) - half_voxel);
            }
        },
        1);
  }
  return feature;
}

}  // namespace

std::vector<double> thinnest_parts_mm(const LabelVolume& labels) {
  const std::vector<float> feature = feature_sizes(labels);
  std::vector<std::vector<float>> of(labels.material_count());
  for (std::size_t v = 0; v < feature.size(); ++v)
    if (feature[v] > 0 && std::isfinite(feature[v])) of[labels.ids.values[v]].push_back(feature[v]);
  std::vector<double> thinnest(labels.material_count(), 0);
  for (std::size_t m = 1; m < of.size(); ++m) {
    if (of[m].empty()) continue;
    const auto nth =
        of[m].begin() + static_cast<std::ptrdiff_t>(kThinShare * static_cast<double>(of[m].size()));
    std::nth_element(of[m].begin(), nth, of[m].end());
    thinnest[m] = 2.0 * *nth;
  }
  return thinnest;
}

}  // namespace cvmesh
