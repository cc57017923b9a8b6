// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/facet_predicates.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/intersections.h>

namespace cvmesh {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;

Point to_point(const Vec3& p) {
  return {p.x, p.y, p.z};
}

// The corners of t on one strict side of the plane of s: +1, -1, or 0 when neither holds.
// `shared` corners of t are on the plane by construction and do not count.
int side_of_plane(const std::array<Point, 3>& s,
                  const std::array<Point, 3>& t,
                  const std::array<bool, 3>& is_shared) {
  int side = 0;
  for (int c = 0; c < 3; ++c) {
    if (is_shared[c]) continue;
    const int o = CGAL::orientation(s[0], s[1], s[2], t[c]);
    if (o == 0 || (side != 0 && o != side)) return 0;
    side = o;
  }
  return side;
}

}  // namespace

bool facets_intersect(const std::vector<Vec3>& points,
                      const VertexTriple& s,
                      const VertexTriple& t) {
  std::array<bool, 3> in_s{}, in_t{};  // is corner of s also in t, and the other way round
  int shared = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (s[i] == t[j]) {
        in_s[i] = in_t[j] = true;
        ++shared;
      }
  if (shared == 3) return true;
  std::array<Point, 3> ps, pt;
  for (int c = 0; c < 3; ++c) {
    ps[c] = to_point(points[s[c]]);
    pt[c] = to_point(points[t[c]]);
  }
  if (side_of_plane(ps, pt, in_t) != 0 || side_of_plane(pt, ps, in_s) != 0) return false;
  if (shared == 2) {
    // coplanar, or else the plane test had decided: they overlap when on one side of the edge
    const int apex_s = !in_s[0] ? 0 : !in_s[1] ? 1 : 2, apex_t = !in_t[0] ? 0 : !in_t[1] ? 1 : 2;
    return CGAL::coplanar_orientation(ps[(apex_s + 1) % 3], ps[(apex_s + 2) % 3], ps[apex_s],
                                      pt[apex_t]) == CGAL::POSITIVE;
  }
  const Kernel::Triangle_3 triangle_s(ps[0], ps[1], ps[2]), triangle_t(pt[0], pt[1], pt[2]);
  if (triangle_s.is_degenerate() || triangle_t.is_degenerate()) return true;
  if (shared == 1) {
    const int apex_s = in_s[0] ? 0 : in_s[1] ? 1 : 2, apex_t = in_t[0] ? 0 : in_t[1] ? 1 : 2;
    const Kernel::Segment_3 across_s(ps[(apex_s + 1) % 3], ps[(apex_s + 2) % 3]);
    const Kernel::Segment_3 across_t(pt[(apex_t + 1) % 3], pt[(apex_t + 2) % 3]);
    return CGAL::do_intersect(triangle_s, across_t) || CGAL::do_intersect(triangle_t, across_s);
  }
  return CGAL::do_intersect(triangle_s, triangle_t);
}

bool is_degenerate(const std::vector<Vec3>& points, const VertexTriple& t) {
  return CGAL::collinear(to_point(points[t[0]]), to_point(points[t[1]]), to_point(points[t[2]]));
}

bool is_in_tet(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const Point q = to_point(p), corner[4] = {to_point(a), to_point(b), to_point(c), to_point(d)};
  const int o = CGAL::orientation(corner[0], corner[1], corner[2], corner[3]);
  if (o == 0) return false;
  return CGAL::orientation(q, corner[1], corner[2], corner[3]) * o >= 0 &&
         CGAL::orientation(corner[0], q, corner[2], corner[3]) * o >= 0 &&
         CGAL::orientation(corner[0], corner[1], q, corner[3]) * o >= 0 &&
         CGAL::orientation(corner[0], corner[1], corner[2], q) * o >= 0;
}

}  // namespace cvmesh
