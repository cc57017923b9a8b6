// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace cvmesh {

/// Corners of the face opposite to each corner of a tet of positive volume, counter-clockwise seen
/// from outside.
inline constexpr std::size_t kTetFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

/// The vertices of the face opposite to corner `k` of a positive tet, counter-clockwise seen from
/// outside.
inline std::array<std::int32_t, 3> tet_face(const std::array<std::int32_t, 4>& tet, std::size_t k) {
  const auto& [a, b, c] = kTetFaces[k];
  return {tet[a], tet[b], tet[c]};
}

/// The vertices of a triangle, ascending: the same for both its orientations.
inline std::array<std::int32_t, 3> sorted(std::array<std::int32_t, 3> triangle) {
  std::sort(triangle.begin(), triangle.end());
  return triangle;
}

/// Whether `b` has the vertices of `a`, and its orientation.
inline bool is_rotation(const std::array<std::int32_t, 3>& a,
                        const std::array<std::int32_t, 3>& b) {
  return (a[0] == b[0] && a[1] == b[1]) || (a[0] == b[1] && a[1] == b[2]) ||
         (a[0] == b[2] && a[1] == b[0]);
}

}  // namespace cvmesh
