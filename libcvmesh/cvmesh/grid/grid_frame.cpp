// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/grid/grid_frame.h"

#include "cvmesh/core/error.h"

namespace cvmesh {
namespace {

// Signs that turn a space's axes into RAS.
Vec3 signs_to_ras(Space space) {
  switch (space) {
    case Space::Lps:
      return {-1, -1, 1};
    case Space::Las:
      return {-1, 1, 1};
    default:
      return {1, 1, 1};
  }
}

}  // namespace

const char* space_name(Space space) {
  switch (space) {
    case Space::Ras:
      return "RAS";
    case Space::Lps:
      return "LPS";
    case Space::Las:
      return "LAS";
    case Space::Grid:
      return "grid";
    case Space::Unknown:
      break;
  }
  return "unknown";
}

Affine inverse(const Affine& map) {
  // The columns of the inverse are the cross products of the rows over the determinant.
  const std::array<Vec3, 3>& rows = map.rows;
  const std::array<Vec3, 3> columns = {cross(rows[1], rows[2]) / map.determinant(),
                                       cross(rows[2], rows[0]) / map.determinant(),
                                       cross(rows[0], rows[1]) / map.determinant()};
  Affine result;
  for (int axis = 0; axis < 3; ++axis)
    result.rows[static_cast<std::size_t>(axis)] = {columns[0][axis], columns[1][axis],
                                                   columns[2][axis]};
  result.offset = -result.linear(map.offset);
  return result;
}

GridFrame cropped(const GridFrame& frame,
                  const std::array<int, 3>& first,
                  const std::array<int, 3>& dims) {
  GridFrame result = frame;
  result.dims = dims;
  result.index_to_world.offset =
      frame.index_to_world(Vec3{double(first[0]), double(first[1]), double(first[2])});
  return result;
}

Affine mm_to_space(const GridFrame& frame, Space target) {
  if (target == Space::Grid) return {};
  Affine map = frame.index_to_world;
  for (auto& row : map.rows)
    row = divided_by(row, frame.spacing_mm);
  if (target == frame.space || target == Space::Unknown) return map;
  require(frame.space != Space::Unknown, ErrorCode::BadParameter, "output",
          std::string("the input does not say in which space its coordinates are, so they cannot "
                      "be turned into ") +
              space_name(target) + "; use --space input or --space grid");
  const Vec3 signs = scaled_by(signs_to_ras(frame.space), signs_to_ras(target));
  for (int axis = 0; axis < 3; ++axis) {
    map.rows[axis] *= signs[axis];
    map.offset[axis] *= signs[axis];
  }
  return map;
}

}  // namespace cvmesh
