// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <algorithm>
#include <array>
#include <limits>

namespace cvmesh {

/// A box of voxels, both ends included; empty until something is added.
struct VoxelBox {
  std::array<int, 3> lo{std::numeric_limits<int>::max(), std::numeric_limits<int>::max(),
                        std::numeric_limits<int>::max()};
  std::array<int, 3> hi{-1, -1, -1};

  void add(const VoxelBox& b) {
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = std::min(lo[axis], b.lo[axis]);
      hi[axis] = std::max(hi[axis], b.hi[axis]);
    }
  }

  [[nodiscard]] bool is_empty() const { return lo[0] > hi[0] || lo[1] > hi[1] || lo[2] > hi[2]; }

  [[nodiscard]] std::array<int, 3> dims() const {
    return {hi[0] - lo[0] + 1, hi[1] - lo[1] + 1, hi[2] - lo[2] + 1};
  }

  friend bool operator==(const VoxelBox&, const VoxelBox&) = default;
};

/// The voxels that are in both boxes.
inline VoxelBox common_part(VoxelBox a, const VoxelBox& b) {
  for (int axis = 0; axis < 3; ++axis) {
    a.lo[axis] = std::max(a.lo[axis], b.lo[axis]);
    a.hi[axis] = std::min(a.hi[axis], b.hi[axis]);
  }
  return a;
}

}  // namespace cvmesh
