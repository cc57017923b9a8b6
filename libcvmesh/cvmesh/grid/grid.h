// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"

#include <vector>

namespace cvmesh {

/// Values at the voxel centres of a frame, x fastest; `values.size() == frame.size()`.
template <typename T>
struct Grid {
  GridFrame frame;
  std::vector<T> values;

  Grid() = default;

  explicit Grid(const GridFrame& f, T value = T{}) : frame(f), values(f.size(), value) {}

  T& operator()(int i, int j, int k) { return values[frame.linear(i, j, k)]; }

  const T& operator()(int i, int j, int k) const { return values[frame.linear(i, j, k)]; }
};

}  // namespace cvmesh
