// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/particles/distribute_particles.h"

#include "support/analytic_level_sets.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

namespace cvmesh::test_particles {

/// A dense surface, level sets and sizes made from formulas.
struct AnalyticDomain {
  InterfaceMesh dense;
  Strata strata;
  LevelSets level_sets;
  SizingField sizing_field;

  [[nodiscard]] ParticleDomain view() const { return {dense, strata, level_sets, sizing_field}; }
};

/// Level sets that store every block, one per function; labels by the largest value.
inline LevelSets make_level_sets(const GridFrame& frame,
                                 const std::vector<std::function<double(const Vec3&)>>& phi_mm) {
  const auto value = [&](MaterialId m, int i, int j, int k) {
    const Vec3 p = frame.index_to_mm({double(i), double(j), double(k)});
    return std::clamp(phi_mm[m](p) / (1.5 * frame.voxel_mm()), -1.0, 1.0);
  };
  auto labels = std::make_shared<Grid<MaterialId>>(frame);
  for (int k = 0; k < frame.dims[2]; ++k)
    for (int j = 0; j < frame.dims[1]; ++j)
      for (int i = 0; i < frame.dims[0]; ++i)
        for (MaterialId m = 1; m < phi_mm.size(); ++m)
          if (MaterialId& best = (*labels)(i, j, k); value(m, i, j, k) > value(best, i, j, k))
            best = m;
  return test_support::store_everywhere(std::move(labels), phi_mm.size(), value);
}

inline GridFrame cubic_frame(int n) {
  GridFrame frame;
  frame.dims = {n, n, n};
  return frame;
}

/// A unit sphere: the octahedron, each side in `n` parts; its equator z = 0 consists of edges.
struct UnitSphere {
  std::vector<Vec3> points;
  std::vector<std::array<std::int32_t, 3>> facets;  ///< normals to the outside
};

inline UnitSphere octasphere(int n) {
  UnitSphere sphere;
  std::map<std::array<int, 3>, std::int32_t> id;
  const auto point = [&](std::array<int, 3> at) {
    const auto [it, is_new] = id.try_emplace(at, static_cast<std::int32_t>(sphere.points.size()));
    if (is_new) {
      // Equal steps of angle, not of the octahedron: facets of nearly equal size.
      Vec3 p;
      for (int a = 0; a < 3; ++a)
        p[a] = std::sin(std::numbers::pi / 2 * at[a] / n);
      sphere.points.push_back(normalized(p));
    }
    return it->second;
  };
  for (const int sx : {-1, 1})
    for (const int sy : {-1, 1})
      for (const int sz : {-1, 1})
        for (int i = 0; i < n; ++i)
          for (int j = 0; j + i < n; ++j) {
            const auto at = [&](int a, int b) { return point({sx * a, sy * b, sz * (n - a - b)}); };
            const auto add = [&](std::int32_t a, std::int32_t b, std::int32_t c) {
              if (sx * sy * sz < 0) std::swap(b, c);
              sphere.facets.push_back({a, b, c});
            };
            add(at(i, j), at(i + 1, j), at(i, j + 1));
            if (i + j + 2 <= n) add(at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
          }
  return sphere;
}

inline void finish(AnalyticDomain& domain, const std::function<double(const Vec3&)>& h) {
  domain.strata = find_strata(domain.dense);
  domain.sizing_field.delta = 0.4;
  for (const Vec3& p : domain.dense.points)
    domain.sizing_field.h_mm.push_back(h(p));
  domain.sizing_field.lfs_mm = domain.sizing_field.h_mm;
}

/// Ellipsoids around their centres, all of material 1, in one grid of n^3 voxels of 1 mm.
struct Ellipsoid {
  Vec3 centre, radii;
  int parts = 32;  ///< per side of the octahedron
};

inline AnalyticDomain ellipsoids(int n,
                                 const std::vector<Ellipsoid>& shapes,
                                 const std::function<double(const Vec3&)>& h) {
  AnalyticDomain domain;
  for (const Ellipsoid& e : shapes) {
    const UnitSphere sphere = octasphere(e.parts);
    const auto first = static_cast<std::int32_t>(domain.dense.points.size());
    for (const Vec3& p : sphere.points)
      domain.dense.points.push_back(e.centre + scaled_by(p, e.radii));
    for (const auto& f : sphere.facets) {
      domain.dense.facets.push_back({f[0] + first, f[1] + first, f[2] + first});
      domain.dense.patch_of.push_back({{1, 0}, 0});
    }
  }
  // First-order distance: exact for a ball.
  const auto inside = [shapes](const Vec3& p) {
    double best = -std::numeric_limits<double>::infinity();
    for (const Ellipsoid& e : shapes) {
      const Vec3 q = divided_by(p - e.centre, e.radii);
      const double k0 = norm(q), k1 = norm(divided_by(q, e.radii));
      best = std::max(best, k1 > 0 ? (1 - k0) * k0 / k1 : e.radii.x);
    }
    return best;
  };
  domain.level_sets =
      make_level_sets(cubic_frame(n), {[inside](const Vec3& p) { return -inside(p); }, inside});
  finish(domain, h);
  return domain;
}

inline AnalyticDomain ball(double radius, int parts, const std::function<double(const Vec3&)>& h) {
  const int n = static_cast<int>(2 * radius) + 9;
  const Vec3 centre{0.5 * (n - 1), 0.5 * (n - 1), 0.5 * (n - 1)};
  return ellipsoids(n, {{centre, {radius, radius, radius}, parts}}, h);
}

/// A torus around z; with `open_parts` > 0 that many of its sectors are missing and a tube remains
/// (which is not a closed surface: for functions that look at one sheet only).
inline AnalyticDomain torus(double major,
                            double minor,
                            int sectors,
                            int ring,
                            const std::function<double(const Vec3&)>& h,
                            int open_parts = 0) {
  AnalyticDomain domain;
  const int n = static_cast<int>(2 * (major + minor)) + 9;
  const double middle = 0.5 * (n - 1);
  const Vec3 centre{middle, middle, middle};
  const int last = sectors - open_parts;
  const int columns = open_parts > 0 ? last + 1 : sectors;
  for (int i = 0; i < columns; ++i)
    for (int j = 0; j < ring; ++j) {
      const double u = 2 * std::numbers::pi * i / sectors, v = 2 * std::numbers::pi * j / ring;
      const double r = major + minor * std::cos(v);
      domain.dense.points.push_back(centre +
                                    Vec3{r * std::cos(u), r * std::sin(u), minor * std::sin(v)});
    }
  for (int i = 0; i < last; ++i)
    for (int j = 0; j < ring; ++j) {
      const auto at = [&](int a, int b) { return (a % columns) * ring + b % ring; };
      domain.dense.facets.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      domain.dense.facets.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
      domain.dense.patch_of.push_back({{1, 0}, 0});
      domain.dense.patch_of.push_back({{1, 0}, 0});
    }
  const auto inside = [=](const Vec3& p) {
    const Vec3 q = p - centre;
    return minor - std::hypot(std::hypot(q.x, q.y) - major, q.z);
  };
  domain.level_sets =
      make_level_sets(cubic_frame(n), {[inside](const Vec3& p) { return -inside(p); }, inside});
  finish(domain, h);
  return domain;
}

/// A ball of materials 1 (above) and 2 (below), a junction curve around its middle.
inline AnalyticDomain halved_ball(double radius,
                                  int parts,
                                  const std::function<double(const Vec3&)>& h) {
  AnalyticDomain domain;
  const int n = static_cast<int>(2 * radius) + 9;
  const double middle = 0.5 * (n - 1);
  const Vec3 centre{middle, middle, middle};
  const UnitSphere sphere = octasphere(parts);
  for (const Vec3& p : sphere.points)
    domain.dense.points.push_back(centre + radius * p);
  std::vector<std::int32_t> in_disc(sphere.points.size(), -1);
  for (std::size_t v = 0; v < sphere.points.size(); ++v) {
    const Vec3& p = sphere.points[v];
    if (p.z < 0) continue;
    in_disc[v] = static_cast<std::int32_t>(v);
    if (p.z == 0) continue;
    const double angle = std::acos(std::min(p.z, 1.0)), r = std::hypot(p.x, p.y);
    const double scale = r > 0 ? radius * angle / (std::numbers::pi / 2) / r : 0;
    in_disc[v] = static_cast<std::int32_t>(domain.dense.points.size());
    domain.dense.points.push_back(centre + Vec3{scale * p.x, scale * p.y, 0});
  }
  for (const auto& f : sphere.facets) {
    const bool is_upper = sphere.points[f[0]].z + sphere.points[f[1]].z + sphere.points[f[2]].z > 0;
    domain.dense.facets.push_back(f);
    domain.dense.patch_of.push_back({{static_cast<MaterialId>(is_upper ? 1 : 2), 0}, 0});
    if (!is_upper) continue;
    domain.dense.facets.push_back({in_disc[f[0]], in_disc[f[1]], in_disc[f[2]]});
    domain.dense.patch_of.push_back({{2, 1}, 0});
  }
  domain.level_sets = make_level_sets(
      cubic_frame(n),
      {[=](const Vec3& p) { return distance(p, centre) - radius; },
       [=](const Vec3& p) { return std::min(radius - distance(p, centre), p.z - middle); },
       [=](const Vec3& p) { return std::min(radius - distance(p, centre), middle - p.z); }});
  finish(domain, h);
  return domain;
}

/// The border of a grid of n^3 voxels that material 1 fills: six walls, twelve curves, eight
/// corners. `parts` per edge.
inline AnalyticDomain full_box(int n, int parts, const std::function<double(const Vec3&)>& h) {
  AnalyticDomain domain;
  std::map<std::array<int, 3>, std::int32_t> id;
  const double lo = -0.5, hi = n - 0.5;
  const auto point = [&](const std::array<int, 3>& at) {
    const auto [it, is_new] =
        id.try_emplace(at, static_cast<std::int32_t>(domain.dense.points.size()));
    if (is_new) {
      Vec3 p;
      for (int a = 0; a < 3; ++a)
        p[a] = at[a] == 0 ? lo : at[a] == parts ? hi : lo + (hi - lo) * at[a] / parts;
      domain.dense.points.push_back(p);
    }
    return it->second;
  };
  for (int wall = 1; wall <= 6; ++wall) {
    const int axis = (wall - 1) / 2;
    const bool is_high = wall % 2 == 0;
    for (int i = 0; i < parts; ++i)
      for (int j = 0; j < parts; ++j) {
        const auto at = [&](int a, int b) {
          std::array<int, 3> index{};
          index[axis] = is_high ? parts : 0;
          index[(axis + 1) % 3] = a;
          index[(axis + 2) % 3] = b;
          return point(index);
        };
        const std::int32_t q[4] = {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
        for (const auto& t : {std::array<int, 3>{0, 1, 2}, std::array<int, 3>{0, 2, 3}}) {
          std::array<std::int32_t, 3> facet{q[t[0]], q[t[1]], q[t[2]]};
          if (!is_high) std::swap(facet[1], facet[2]);
          domain.dense.facets.push_back(facet);
          domain.dense.patch_of.push_back({{1, 0}, static_cast<std::uint8_t>(wall)});
        }
      }
  }
  domain.level_sets = make_level_sets(
      cubic_frame(n), {[](const Vec3&) { return -9.0; }, [](const Vec3&) { return 9.0; }});
  finish(domain, h);
  return domain;
}

}  // namespace cvmesh::test_particles
