// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/triangulate_ring.h"

#include <boost/container/small_vector.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {
namespace {

constexpr double kImpossible = std::numeric_limits<double>::infinity();

struct Flat {
  double x, y;
};

double cross2(const Flat& a, const Flat& b, const Flat& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// The dynamic programme: best[i][j] fills the polygon i..j above base i-j, apex[i][j] is the third
// corner of the triangle at the base.
class RingSolver {
 public:
  RingSolver(const RingProblem& problem,
             const RingLimits& limits,
             const SurfaceObjective& objective)
      : problem_(problem),
        limits_(limits),
        objective_(objective),
        n_(static_cast<int>(problem.ring.size())),
        entries_(static_cast<std::size_t>(n_) * n_) {
    const Vec3 axis = std::abs(problem.normal.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
    u_ = normalized(cross(problem.normal, axis));
    v_ = cross(problem.normal, u_);
    for (const auto& p : problem.ring)
      flat_ring_.push_back(flatten(p));
    for (const auto& p : problem.samples)
      flat_samples_.push_back(flatten(p));
  }

  std::optional<MaterialSurfaces::Triangulation> solve() {
    for (int span = 1; span < n_; ++span)
      for (int i = 0; i + span < n_; ++i)
        solve_span(i, i + span);
    if (at(0, n_ - 1).cost == kImpossible) return std::nullopt;
    MaterialSurfaces::Triangulation triangles;
    collect(0, n_ - 1, triangles);
    return triangles;
  }

 private:
  struct Entry {
    double cost = kImpossible;
    int apex = -1;
    Vec3 normal;  // of the triangle at the base; across a side of the ring: of the outer facet
  };

  [[nodiscard]] Flat flatten(const Vec3& p) const { return {dot(p, u_), dot(p, v_)}; }

  Entry& at(int i, int j) { return entries_[static_cast<std::size_t>(i) * n_ + j]; }

  void solve_span(int i, int j) {
    Entry& entry = at(i, j);
    if (j == i + 1) {
      entry.cost = 0;
      entry.normal = problem_.outer_normals[i];
      return;
    }
    const bool is_base = i == 0 && j == n_ - 1;
    const bool is_forbidden = (problem_.forbidden_edges[i] >> j & 1) != 0;
    if (!is_base && is_forbidden) return;
    for (int k = i + 1; k < j; ++k) {
      const Entry &left = at(i, k), &right = at(k, j);
      if (left.cost == kImpossible || right.cost == kImpossible) continue;
      Vec3 normal;
      double cost = left.cost + right.cost;
      if (cost >= entry.cost) continue;
      if (!add_triangle(i, k, j, normal, cost) || cost >= entry.cost) continue;
      if (!add_fold(normal, left.normal, cost) || !add_fold(normal, right.normal, cost)) continue;
      if (is_base && problem_.is_disk && !add_fold(normal, problem_.outer_normals[n_ - 1], cost))
        continue;
      if (cost < entry.cost) entry = {cost, k, normal};
    }
  }

  bool add_triangle(int i, int k, int j, Vec3& normal, double& cost) const {
    const auto &a = problem_.ring[i], &b = problem_.ring[k], &c = problem_.ring[j];
    for (const auto& t : problem_.forbidden_triangles)
      if (t[0] == i && t[1] == k && t[2] == j) return false;
    const double quality = triangle_quality(a, b, c);
    if (!(quality >= limits_.min_quality)) return false;
    normal = normalized(area_vector2(a, b, c));
    if (dot(normal, problem_.normal) < limits_.min_normal_cosine) return false;
    const Flat &fa = flat_ring_[i], &fb = flat_ring_[k], &fc = flat_ring_[j];
    double farthest = 0;
    for (std::size_t s = 0; s < flat_samples_.size(); ++s) {
      const Flat& f = flat_samples_[s];
      if (cross2(fa, fb, f) < 0 || cross2(fb, fc, f) < 0 || cross2(fc, fa, f) < 0) continue;
      farthest = std::max(farthest, std::abs(dot(normal, problem_.samples[s] - a)));
    }
    const auto nearest_mm2 = [&](const Vec3& p) {
      double nearest = kImpossible;
      for (const Vec3& sample : problem_.samples)
        nearest = std::min(nearest, squared_norm(sample - p));
      return problem_.samples.empty() ? 0 : nearest;
    };
    farthest = std::max(farthest, objective_.bridge_mm(a, b, c, nearest_mm2, problem_.spacing_mm));
    cost += objective_.facet_term(quality, farthest);
    return true;
  }

  bool add_fold(const Vec3& normal, const Vec3& neighbour, double& cost) const {
    if (neighbour == Vec3{}) return true;
    if (dot(normal, neighbour) < limits_.min_fold_cosine) return false;
    cost += SurfaceObjective::fold_term(normal, neighbour);
    return true;
  }

  void collect(int i, int j, MaterialSurfaces::Triangulation& triangles) {
    if (j == i + 1) return;
    const int k = at(i, j).apex;
    triangles.push_back(
        {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(k), static_cast<std::uint8_t>(j)});
    collect(i, k, triangles);
    collect(k, j, triangles);
  }

  const RingProblem& problem_;
  const RingLimits& limits_;
  const SurfaceObjective& objective_;
  int n_;
  Vec3 u_, v_;
  // on the stack for all but the longest rings
  boost::container::small_vector<Flat, 16> flat_ring_;
  boost::container::small_vector<Flat, 128> flat_samples_;
  boost::container::small_vector<Entry, 100> entries_;
};

}  // namespace

std::optional<MaterialSurfaces::Triangulation> triangulate_ring(const RingProblem& problem,
                                                                const RingLimits& limits,
                                                                const SurfaceObjective& objective) {
  const auto n = static_cast<int>(problem.ring.size());
  if (n == 2) return MaterialSurfaces::Triangulation{};  // a half-disk of one facet vanishes
  if (n < 2 || n > RingProblem::kMaxRing) return std::nullopt;
  return RingSolver(problem, limits, objective).solve();
}

}  // namespace cvmesh
