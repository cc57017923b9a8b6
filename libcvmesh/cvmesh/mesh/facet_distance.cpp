// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/facet_predicates.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

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

/// True when a plane across the line of their centres has p and q on its sides, `clearance` apart.
bool are_apart_by_centres(const Corners& p, const Corners& q, double clearance) {
  const Vec3 up = q[0] + q[1] + q[2] - p[0] - p[1] - p[2];
  const double below = std::max({dot(up, p[0]), dot(up, p[1]), dot(up, p[2])});
  const double above = std::min({dot(up, q[0]), dot(up, q[1]), dot(up, q[2])});
  return above - below > clearance * norm(up);
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

/// Corners of two facets: first those that they share, in the same order on both sides.
struct SharedFirst {
  int shared = 0;
  Corners p, q;
};

/// Which of the corners of s are corners of t, a bit each. Without branches: on two neighbours in a
/// surface they would be guesses.
unsigned corners_in(const VertexTriple& s, const VertexTriple& t) {
  const auto is_corner = [&t](std::int32_t v) {
    return static_cast<unsigned>(v == t[0]) | static_cast<unsigned>(v == t[1]) |
           static_cast<unsigned>(v == t[2]);
  };
  return is_corner(s[0]) | is_corner(s[1]) << 1U | is_corner(s[2]) << 2U;
}

SharedFirst shared_first(const std::vector<Vec3>& points,
                         const VertexTriple& s,
                         const VertexTriple& t) {
  // By the bits of `corners_in`: the shared corners first; of the others the last one first, or
  // the first one.
  using Order = std::array<std::uint8_t, 3>;
  static constexpr std::array<Order, 8> kOthersBackwards{
      {{2, 1, 0}, {0, 2, 1}, {1, 2, 0}, {0, 1, 2}, {2, 1, 0}, {0, 2, 1}, {1, 2, 0}, {0, 1, 2}}};
  static constexpr std::array<Order, 8> kOthersForwards{
      {{0, 1, 2}, {0, 1, 2}, {1, 0, 2}, {0, 1, 2}, {2, 0, 1}, {0, 2, 1}, {1, 2, 0}, {0, 1, 2}}};
  static constexpr std::array<std::uint8_t, 8> kCount{0, 1, 1, 2, 1, 2, 2, 3};
  const unsigned in_t = corners_in(s, t);
  const Order &order_s = kOthersBackwards[in_t], &order_t = kOthersForwards[corners_in(t, s)];
  SharedFirst both;
  both.shared = kCount[in_t];
  for (std::size_t k = 0; k < 3; ++k) {
    both.p[k] = points[static_cast<std::size_t>(s[order_s[k]])];
    both.q[k] = points[static_cast<std::size_t>(t[order_t[k]])];
  }
  // The shared ones of t are those of s, in their order.
  if (both.shared == 2) {
    both.q[0] = both.p[0];
    both.q[1] = both.p[1];
  }
  return both;
}

/// Facets with corner p[0] in common: true when a plane through it has the other corners of p above
/// and those of q below, none nearer than `clearance`.
bool are_apart_at_vertex(const Corners& p, const Corners& q, double clearance) {
  const Vec3 a = p[1] - p[0], b = p[2] - p[0], c = q[1] - p[0], d = q[2] - p[0];
  const auto is_separated_along = [&](const Vec3& up) {
    const double least = std::min({dot(up, a), dot(up, b), -dot(up, c), -dot(up, d)});
    return least > 0 && least * least > clearance * clearance * squared_norm(up);
  };
  // Mostly the plane across the line of their centres will do; where edges are of unlike length,
  // rather the one halfway between their directions.
  return is_separated_along(a + b - c - d) ||
         is_separated_along(normalized(a) + normalized(b) - normalized(c) - normalized(d));
}

/// Facets with edge p[0]-p[1] in common: true when the plane through it halfway between the facets
/// has p[2] above and q[2] below, no nearer than `clearance`, and sides that start at unlike ends
/// of the edge leave that distance of the plane before they come near to each other.
bool are_apart_at_edge(const Corners& p, const Corners& q, double clearance) {
  const Vec3 edge = p[1] - p[0], c = p[2] - p[0], d = q[2] - p[0];
  const double ee = dot(edge, edge);
  const Vec3 up =
      normalized(ee * c - dot(c, edge) * edge) - normalized(ee * d - dot(d, edge) * edge);
  const double length = norm(up);
  const double above = dot(up, c), below = -dot(up, d);
  if (!(std::min(above, below) > clearance * length)) return false;
  // A point of side p[1]-p[2] at height h is within h / above of the side's length from p[1].
  const auto reach = [&](const Vec3& from_p, const Vec3& from_q) {
    return clearance *
           (1 + length * (distance(from_p, p[2]) / above + distance(from_q, q[2]) / below));
  };
  const double longest = std::max(reach(p[0], p[1]), reach(p[1], p[0]));
  return ee > longest * longest;
}

}  // namespace

bool are_facets_apart(const std::vector<Vec3>& points,
                      const VertexTriple& s,
                      const VertexTriple& t,
                      double clearance) {
  const auto [shared, p, q] = shared_first(points, s, t);
  switch (shared) {
    case 0:
      return are_apart_by_centres(p, q, clearance) || is_beyond_plane(p, q, clearance) ||
             is_beyond_plane(q, p, clearance);
    case 1:
      return are_apart_at_vertex(p, q, clearance);
    case 2:
      return are_apart_at_edge(p, q, clearance);
    default:
      return false;
  }
}

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
  for (std::size_t k = 0; k < 3; ++k)
    if ((!holds(t, s[k]) && is_near(p[k], q)) || (!holds(s, t[k]) && is_near(q[k], p))) return true;
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
