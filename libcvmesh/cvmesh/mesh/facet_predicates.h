// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"
#include "cvmesh/core/vec3.h"

#include <array>
#include <cstdint>
#include <vector>

/// Exact tests on facets given by vertex ids: shared vertices are recognised by id, everything else
/// is decided by CGAL's filtered exact predicates on the coordinates.
namespace cvmesh {

using VertexTriple = std::array<std::int32_t, 3>;

/// True when two facets have more in common than shared vertices or a shared edge.
bool facets_intersect(const std::vector<Vec3>& points,
                      const VertexTriple& s,
                      const VertexTriple& t);

/// True when the facet's vertices are on one line.
bool is_degenerate(const std::vector<Vec3>& points, const VertexTriple& t);

/// True when p is inside tet abcd or on its boundary; false for a flat tet.
bool is_in_tet(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// True only when two facets neither intersect nor are near (see below) at `clearance`: a quick
/// test that finds a separating plane for most neighbours in a surface. In double precision:
/// `clearance` has to be well above the rounding of the coordinates.
bool are_facets_apart(const std::vector<Vec3>& points,
                      const VertexTriple& s,
                      const VertexTriple& t,
                      double clearance);

/// True when two facets that do not intersect come nearer to each other than `clearance`; where
/// they share vertices, when a vertex of one that is not shared does. In double precision.
bool are_facets_near(const std::vector<Vec3>& points,
                     const VertexTriple& s,
                     const VertexTriple& t,
                     double clearance);

inline Box3 box_of(const std::vector<Vec3>& points, const VertexTriple& t) {
  Box3 box;
  for (const auto v : t)
    box.add(points[v]);
  return box;
}

}  // namespace cvmesh
