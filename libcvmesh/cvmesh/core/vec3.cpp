// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/vec3.h"

#include <algorithm>

namespace cvmesh {

Vec3 nearest_on_segment(const Vec3& p, const Vec3& a, const Vec3& b) {
  const Vec3 d = b - a;
  const double length2 = squared_norm(d);
  if (length2 == 0) return a;
  return a + std::clamp(dot(p - a, d) / length2, 0.0, 1.0) * d;
}

Vec3 nearest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vec3 bp = p - b;
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0 && d1 > d3) return a + (d1 / (d1 - d3)) * ab;
  const Vec3 cp = p - c;
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0 && d2 > d6) return a + (d2 / (d2 - d6)) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0 && (d4 - d3) + (d5 - d6) > 0)
    return b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b);
  const double sum = va + vb + vc;
  if (!(sum > 0)) {  // a degenerate triangle: the nearest of its sides
    const Vec3 s[3] = {nearest_on_segment(p, a, b), nearest_on_segment(p, b, c),
                       nearest_on_segment(p, c, a)};
    return *std::min_element(s, s + 3, [&](const Vec3& u, const Vec3& v) {
      return squared_norm(u - p) < squared_norm(v - p);
    });
  }
  return a + (vb / sum) * ab + (vc / sum) * ac;
}

}  // namespace cvmesh
