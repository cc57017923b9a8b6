// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/facet_predicates.h"

#include <algorithm>
#include <cmath>

namespace cvmesh {
namespace {

using Corners = std::array<Vec3, 3>;

Corners corners_of(const std::vector<Vec3>& points, const VertexTriple& t) {
  return {points[static_cast<std::size_t>(t[0])], points[static_cast<std::size_t>(t[1])],
          points[static_cast<std::size_t>(t[2])]};
}

/// True when all of q lies on one side of the plane of p, and no nearer than `clearance`.
bool is_beyond_plane(const Corners& p, const Corners& q, double clearance) {
  const Vec3 normal = area_vector2(p[0], p[1], p[2]);
  const double margin = clearance * norm(normal);
  const double a = dot(normal, q[0] - p[0]), b = dot(normal, q[1] - p[0]),
               c = dot(normal, q[2] - p[0]);
  return std::min({a, b, c}) > margin || std::max({a, b, c}) < -margin;
}

/// Squared distance of segments ab and cd.
double squared_segment_distance(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const Vec3 u = b - a, v = d - c, w = a - c;
  const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
  const double det = uu * vv - uv * uv;
  // The nearest point on ab to the line cd, kept on the segment; then the other way round, and once
  // more, which is exact for two segments.
  double s = det > 0 ? std::clamp((uv * vw - vv * uw) / det, 0.0, 1.0) : 0.0;
  double t = vv > 0 ? std::clamp((uv * s + vw) / vv, 0.0, 1.0) : 0.0;
  s = uu > 0 ? std::clamp((uv * t - uw) / uu, 0.0, 1.0) : 0.0;
  t = vv > 0 ? std::clamp((uv * s + vw) / vv, 0.0, 1.0) : 0.0;
  return squared_norm(w + s * u - t * v);
}

}  // namespace

bool are_facets_near(const std::vector<Vec3>& points,
                     const VertexTriple& s,
                     const VertexTriple& t,
                     double clearance) {
  const Corners p = corners_of(points, s), q = corners_of(points, t);
  const double least = clearance * clearance;
  // Boxes first: of two neighbours in a surface neither holds a vertex of the other.
  const auto is_near = [&](const Vec3& v, const Corners& corners) {
    for (int axis = 0; axis < 3; ++axis) {
      const double a = corners[0][axis], b = corners[1][axis], c = corners[2][axis];
      if (v[axis] < std::min({a, b, c}) - clearance || v[axis] > std::max({a, b, c}) + clearance)
        return false;
    }
    return squared_norm(v - nearest_on_triangle(v, corners[0], corners[1], corners[2])) < least;
  };
  const auto holds = [](const VertexTriple& triple, std::int32_t v) {
    return std::find(triple.begin(), triple.end(), v) != triple.end();
  };
  bool is_apart = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const bool is_s_shared = holds(t, s[k]);
    if ((!is_s_shared && is_near(p[k], q)) || (!holds(s, t[k]) && is_near(q[k], p))) return true;
    is_apart = is_apart && !is_s_shared;
  }
  if (is_apart && (is_beyond_plane(p, q, clearance) || is_beyond_plane(q, p, clearance)))
    return false;
  // Facets folded onto each other over a shared edge may have only their other edges cross.
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const std::int32_t a = s[i], b = s[(i + 1) % 3], c = t[j], d = t[(j + 1) % 3];
      if (a == c || a == d || b == c || b == d) continue;
      if (squared_segment_distance(p[i], p[(i + 1) % 3], q[j], q[(j + 1) % 3]) < least) return true;
    }
  return false;
}

}  // namespace cvmesh
