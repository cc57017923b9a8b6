// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace cvmesh {

/// The facets of a mesh, which must outlive this, as a `ShapeTree` wants them.
struct FacetShapes {
  const InterfaceMesh& mesh;

  [[nodiscard]] std::size_t size() const { return mesh.facets.size(); }

  [[nodiscard]] std::array<Vec3, 3> corners(std::size_t f) const {
    const auto& [a, b, c] = mesh.facets[f];
    return {mesh.points[a], mesh.points[b], mesh.points[c]};
  }

  [[nodiscard]] Box3 box(std::size_t f) const {
    Box3 box;
    for (const Vec3& corner : corners(f))
      box.add(corner);
    return box;
  }

  /// The point of facet f nearest to p.
  [[nodiscard]] Vec3 nearest(std::size_t f, const Vec3& p) const {
    const auto [a, b, c] = corners(f);
    return nearest_on_triangle(p, a, b, c);
  }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    return squared_norm(p - nearest(f, p));
  }
};

/// Into how many parts a facet's sides are to be divided for parts of at most `spacing_mm`; 1 or
/// more.
inline int divisions(const std::array<Vec3, 3>& corners, double spacing_mm) {
  const auto& [a, b, c] = corners;
  const double longest = std::max({distance(a, b), distance(b, c), distance(c, a)});
  return std::max(1, static_cast<int>(std::ceil(longest / spacing_mm)));
}

/// Calls visit(p) for the centres of the n x n equal triangles that make up a facet.
template <typename Visit>
void for_each_centre(const std::array<Vec3, 3>& corners, int n, const Visit& visit) {
  const auto& [a, b, c] = corners;
  const auto at = [&](double i, double j) { return a + (i / n) * (b - a) + (j / n) * (c - a); };
  constexpr double kThird = 1.0 / 3;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; i + j < n; ++j) {
      visit(at(i + kThird, j + kThird));
      if (i + j + 1 < n) visit(at(i + 2 * kThird, j + 2 * kThird));
    }
  }
}

}  // namespace cvmesh
