// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid.h"

#include <array>
#include <cmath>

namespace cvmesh::examples {

/// `size` times `full_dims` voxels with the full spacing; RAS, the world origin in the middle.
inline GridFrame miniature_frame(const std::array<int, 3>& full_dims,
                                 const Vec3& spacing_mm,
                                 double size) {
  GridFrame frame;
  frame.spacing_mm = spacing_mm;
  frame.space = Space::Ras;
  for (int axis = 0; axis < 3; ++axis) {
    frame.dims[axis] = static_cast<int>(std::lround(full_dims[axis] * size));
    frame.index_to_world.rows[axis] = Vec3{};
    frame.index_to_world.rows[axis][axis] = spacing_mm[axis];
    frame.index_to_world.offset[axis] = -0.5 * (frame.dims[axis] - 1) * spacing_mm[axis];
  }
  return frame;
}

}  // namespace cvmesh::examples
