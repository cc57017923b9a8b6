// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/tet_predicates.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

namespace cvmesh {

int tet_orientation(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;
  return CGAL::orientation(Point(a.x, a.y, a.z), Point(b.x, b.y, b.z), Point(c.x, c.y, c.z),
                           Point(d.x, d.y, d.z));
}

}  // namespace cvmesh
