// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/grid/shear.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cvmesh {

double shear_of(const Affine& index_to_world) {
  std::array<Vec3, 3> axes;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 unit{};
    unit[axis] = 1;
    axes[static_cast<std::size_t>(axis)] = normalized(index_to_world.linear(unit));
  }
  return std::max({std::abs(dot(axes[0], axes[1])), std::abs(dot(axes[0], axes[2])),
                   std::abs(dot(axes[1], axes[2]))});
}

Affine mm_to_world_vector(const GridFrame& frame) {
  Affine map;
  for (std::size_t row = 0; row < 3; ++row)
    map.rows[row] = divided_by(frame.index_to_world.rows[row], frame.spacing_mm);
  return map;
}

}  // namespace cvmesh
