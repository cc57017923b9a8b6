// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/sizing_field.h"

#include "cvmesh/core/median.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace cvmesh {

double SizingField::at(const Vec3& p) const {
  const auto& frame = volume_h_mm.frame;
  const Vec3 index = frame.mm_to_index(p);
  std::array<int, 3> lo, hi;
  Vec3 f;
  for (int axis = 0; axis < 3; ++axis) {
    const double clamped = std::clamp(index[axis], 0.0, double(frame.dims[axis] - 1));
    lo[axis] = static_cast<int>(clamped);
    hi[axis] = std::min(lo[axis] + 1, frame.dims[axis] - 1);
    f[axis] = clamped - lo[axis];
  }
  const auto along_x = [&](int j, int k) {
    const double a = volume_h_mm(lo[0], j, k), b = volume_h_mm(hi[0], j, k);
    return a + f.x * (b - a);
  };
  const auto along_y = [&](int k) {
    const double a = along_x(lo[1], k), b = along_x(hi[1], k);
    return a + f.y * (b - a);
  };
  const double a = along_y(lo[2]), b = along_y(hi[2]);
  return a + f.z * (b - a);
}

double SizingField::median_epsilon() const {
  std::vector<double> epsilon(h_mm.size());
  for (std::size_t v = 0; v < epsilon.size(); ++v)
    epsilon[v] = h_mm[v] / lfs_mm[v];
  return median(std::move(epsilon));
}

}  // namespace cvmesh
