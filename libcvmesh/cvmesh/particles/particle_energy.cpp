// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/particle_energy.h"

#include <cmath>

namespace cvmesh::particle_energy {
namespace {

struct Planar {
  double x = 0, y = 0;
  std::int32_t index = -1;
};

double turn(const Planar& o, const Planar& a, const Planar& b) {
  return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x);
}

// Counter-clockwise, by Andrew's monotone chain; collinear points are left out.
std::vector<Planar> convex_hull(std::vector<Planar> points) {
  std::sort(points.begin(), points.end(), [](const Planar& a, const Planar& b) {
    return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.index < b.index;
  });
  if (points.size() < 3) return points;
  std::vector<Planar> hull(2 * points.size());
  std::size_t size = 0;
  for (const Planar& p : points) {
    while (size >= 2 && turn(hull[size - 2], hull[size - 1], p) <= 0)
      --size;
    hull[size++] = p;
  }
  const std::size_t lower = size + 1;
  for (std::size_t i = points.size() - 1; i-- > 0;) {
    while (size >= lower && turn(hull[size - 2], hull[size - 1], points[i]) <= 0)
      --size;
    hull[size++] = points[i];
  }
  hull.resize(size - 1);
  return hull;
}

}  // namespace

Star find_star(std::span<const Vec3> offsets, const Vec3& normal) {
  const Vec3 helper = std::abs(normal.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 u = normalized(cross(helper, normal)), v = cross(normal, u);
  std::vector<Planar> flat(offsets.size()), inverted;
  for (std::size_t i = 0; i < offsets.size(); ++i) {
    const double length = norm(offsets[i]);
    double x = dot(offsets[i], u), y = dot(offsets[i], v);
    const double in_plane = std::hypot(x, y);
    if (!(in_plane > 1e-6 * length)) continue;
    x *= length / in_plane;
    y *= length / in_plane;
    flat[i] = {x, y, static_cast<std::int32_t>(i)};
    inverted.push_back({x / (length * length), y / (length * length), flat[i].index});
  }
  Star star;
  const std::vector<Planar> hull = convex_hull(std::move(inverted));
  star.is_closed = hull.size() >= 3;
  for (std::size_t k = 0; k < hull.size(); ++k) {
    star.ring.push_back(hull[k].index);
    const Planar& a = hull[k];
    const Planar& b = hull[(k + 1) % hull.size()];
    if (!(a.x * b.y - a.y * b.x > 0)) {
      star.is_closed = false;
      continue;
    }
    const Planar& p = flat[a.index];
    const Planar& q = flat[b.index];
    const double area2 = p.x * q.y - p.y * q.x;
    if (!(area2 > 0)) continue;
    const double p2 = p.x * p.x + p.y * p.y, q2 = q.x * q.x + q.y * q.y;
    const double cx = (q.y * p2 - p.y * q2) / (2 * area2);
    const double cy = (p.x * q2 - q.x * p2) / (2 * area2);
    if (std::hypot(cx, cy) > star.hole_radius) {
      star.hole_radius = std::hypot(cx, cy);
      star.hole_centre = cx * u + cy * v;
    }
  }
  return star;
}

}  // namespace cvmesh::particle_energy
