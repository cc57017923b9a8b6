// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/flip_edges.h"

#include "cvmesh/surface/embedding_guard.h"
#include "cvmesh/surface/surface_objective.h"

#include <algorithm>
#include <array>
#include <utility>

namespace cvmesh {
namespace {

// A flip has to gain this much, so that the descent ends.
constexpr double kLeastGain = 1e-9;
// Flips never make a fold sharper than this between two facets of a patch (20 degrees).
constexpr double kMinFoldCosine = -0.94;
constexpr double kMinQuality = 1e-3;

class Flipper {
 public:
  Flipper(MaterialSurfaces& surfaces, double voxel_mm, double deviation_mm)
      : surfaces_(surfaces),
        index_(index_facets(surfaces, voxel_mm)),
        guard_(surfaces, index_),
        objective_{deviation_mm} {}

  enum class Outcome { Flipped, NoGain, Refused };

  Outcome try_flip(std::int32_t a, std::int32_t b) {
    std::int32_t first = -1, second = -1;
    if (!surfaces_.facets_of_edge(a, b, first, second)) return Outcome::NoGain;
    const std::int32_t c = across(first, a, b), d = across(second, a, b);
    const std::array<VertexTriple, 2> before{{{a, b, c}, {b, a, d}}};
    const std::array<VertexTriple, 2> after{{{a, d, c}, {d, b, c}}};
    // before: as the facets carry their samples; after: as `MaterialSurfaces` will hand them out
    samples_.clear();
    std::array<double, 2> farthest_before{}, farthest_after{};
    for (int f = 0; f < 2; ++f)
      surfaces_.for_each_sample(f == 0 ? first : second, [&](const Vec3& s) {
        samples_.push_back(s);
        farthest_before[f] = std::max(farthest_before[f], distance_to(s, before[f]));
      });
    for (const Vec3& s : samples_) {
      const double to_first = distance_to(s, after[0]), to_second = distance_to(s, after[1]);
      const int nearest = to_first <= to_second ? 0 : 1;
      farthest_after[nearest] = std::max(farthest_after[nearest], std::min(to_first, to_second));
    }
    // outer sides: (b, c) and (c, a) of the first facet, (a, d) and (d, b) of the second
    const std::array<Vec3, 4> outer{normal_across(b, c, first), normal_across(c, a, first),
                                    normal_across(a, d, second), normal_across(d, b, second)};
    const double cost_before = cost(before, farthest_before, {0, 1, 2, 3}, outer);
    const double cost_after = cost(after, farthest_after, {2, 1, 3, 0}, outer);
    if (!(cost_after < cost_before - kLeastGain)) return Outcome::NoGain;
    if (!is_allowed(a, b, c, d, first, second, after, outer)) return Outcome::Refused;
    for (const auto f : {first, second})
      index_.remove(f);
    surfaces_.flip_edge(a, b);
    for (const auto f : {first, second})
      insert_facet(surfaces_, f, index_);
    return Outcome::Flipped;
  }

 private:
  [[nodiscard]] std::int32_t across(std::int32_t facet, std::int32_t a, std::int32_t b) const {
    for (const auto v : surfaces_.facets()[facet].vertices)
      if (v != a && v != b) return v;
    return -1;
  }

  [[nodiscard]] Vec3 unit_normal(const VertexTriple& t) const {
    const auto& p = surfaces_.points();
    return normalized(area_vector2(p[t[0]], p[t[1]], p[t[2]]));
  }

  [[nodiscard]] double distance_to(const Vec3& s, const VertexTriple& t) const {
    const auto& p = surfaces_.points();
    return distance(nearest_on_triangle(s, p[t[0]], p[t[1]], p[t[2]]), s);
  }

  // Unit normal of the facet on the other side of edge (u, v) of `facet`; zero on a curve.
  [[nodiscard]] Vec3 normal_across(std::int32_t u, std::int32_t v, std::int32_t facet) const {
    std::int32_t left = -1, right = -1;
    if (!surfaces_.facets_of_edge(u, v, left, right)) return {};
    return unit_normal(surfaces_.facets()[left == facet ? right : left].vertices);
  }

  // Objective of a pair of facets: facet 0 has the outer sides side[0], side[1], facet 1 the
  // others.
  [[nodiscard]] double cost(const std::array<VertexTriple, 2>& pair,
                            const std::array<double, 2>& farthest,
                            const std::array<int, 4>& side,
                            const std::array<Vec3, 4>& outer) const {
    const auto& p = surfaces_.points();
    std::array<Vec3, 2> normal;
    double sum = 0;
    for (int f = 0; f < 2; ++f) {
      normal[f] = unit_normal(pair[f]);
    }
    for (int f = 0; f < 2; ++f) {
      sum += objective_.facet_term(p[pair[f][0]], p[pair[f][1]], p[pair[f][2]], farthest[f]);
      for (int s = 0; s < 2; ++s)
        if (const Vec3& n = outer[side[2 * f + s]]; n != Vec3{})
          sum += SurfaceObjective::fold_term(normal[f], n);
    }
    return sum + SurfaceObjective::fold_term(normal[0], normal[1]);
  }

  bool is_allowed(std::int32_t a,
                  std::int32_t b,
                  std::int32_t c,
                  std::int32_t d,
                  std::int32_t first,
                  std::int32_t second,
                  const std::array<VertexTriple, 2>& after,
                  const std::array<Vec3, 4>& outer) {
    const auto& p = surfaces_.points();
    for (const auto& t : after)
      if (triangle_quality(p[t[0]], p[t[1]], p[t[2]]) < kMinQuality) return false;
    const std::array<Vec3, 2> normal{unit_normal(after[0]), unit_normal(after[1])};
    if (dot(normal[0], normal[1]) < kMinFoldCosine) return false;
    const std::array<std::pair<int, int>, 4> sides{{{0, 2}, {0, 1}, {1, 3}, {1, 0}}};
    for (const auto& [f, s] : sides)
      if (outer[s] != Vec3{} && dot(normal[f], outer[s]) < kMinFoldCosine) return false;
    Box3 box;
    for (const auto v : {a, b, c, d})
      box.add(p[v]);
    const std::array<std::int32_t, 2> replaced{first, second};
    const std::array<std::int32_t, 4> ring{a, b, c, d};
    guard_.begin(box, replaced, ring);
    for (const auto& entry : guard_.nearby()) {
      const auto& v = surfaces_.facets()[entry.id].vertices;
      const auto has = [&](std::int32_t w) { return std::find(v.begin(), v.end(), w) != v.end(); };
      if (has(c) && has(d)) return false;  // the new edge exists
    }
    for (const auto& t : after)
      if (guard_.intersects_nearby(t)) return false;
    if (facets_intersect(p, after[0], after[1])) return false;
    return !guard_.sweeps_over_vertex(p[b], after[0]);  // the tet of all four
  }

  MaterialSurfaces& surfaces_;
  FacetIndex index_;
  EmbeddingGuard guard_;
  SurfaceObjective objective_;
  std::vector<Vec3> samples_;
};

using Edge = std::pair<std::int32_t, std::int32_t>;

// All edges, ascending.
std::vector<Edge> list_edges(const MaterialSurfaces& surfaces) {
  std::vector<Edge> edges;
  for (const auto& facet : surfaces.facets()) {
    if (!facet.is_alive) continue;
    for (int c = 0; c < 3; ++c)
      edges.push_back(std::minmax(facet.vertices[c], facet.vertices[(c + 1) % 3]));
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

}  // namespace

FlipEdgesResult flip_edges(MaterialSurfaces surfaces,
                           double voxel_mm,
                           const FlipEdgesOptions& options,
                           const StageContext& context) {
  FlipEdgesResult result;
  {
    Flipper flipper(surfaces, voxel_mm, options.deviation_vox * voxel_mm);
    for (std::size_t flips = 1; flips > 0 && result.stats.passes < options.max_passes;) {
      flips = 0;
      result.stats.refused = 0;
      for (const auto& [a, b] : list_edges(surfaces)) {
        const auto outcome = flipper.try_flip(a, b);
        if (outcome == Flipper::Outcome::Flipped) ++flips;
        if (outcome == Flipper::Outcome::Refused) ++result.stats.refused;
      }
      result.stats.flips += flips;
      ++result.stats.passes;
      report_progress(context, "edge flipping",
                      static_cast<double>(result.stats.passes) / options.max_passes);
    }
  }
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
