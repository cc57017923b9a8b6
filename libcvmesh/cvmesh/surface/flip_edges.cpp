// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/flip_edges.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/surface/embedding_guard.h"
#include "cvmesh/surface/surface_objective.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

// A flip has to gain this much, so that the descent ends.
constexpr double kLeastGain = 1e-9;
// Flips never make a fold sharper than this between two facets of a patch (20 degrees).
constexpr double kMinFoldCosine = -0.94;
constexpr double kMinQuality = 1e-3;

using Edge = std::pair<std::int32_t, std::int32_t>;

// An edge with one of its facets. Flips may take the edge from that facet, or away altogether.
struct FacetEdge {
  Edge edge;
  std::int32_t facet;

  auto operator<=>(const FacetEdge&) const = default;
};

// A flip as it would be: edge a-b of facets (a, b, c) and (b, a, d) becomes c-d.
struct Flip {
  std::int32_t first, second, a, b, c, d;
  std::array<VertexTriple, 2> after;
  std::array<double, 2> farthest_after;
  std::array<Vec3, 4> outer;  // normals across (b, c), (c, a), (a, d), (d, b)
  double cost_before, cost_after;

  [[nodiscard]] double gain() const { return cost_before - cost_after; }
};

// What makes a flip worth a look, by its costs before and after. A lower cost after is never worse.
bool gains(double before, double after) {
  return before - after > kLeastGain;
}

// The first of a pair, which may cost: where there is something to gain, and one flip beside it may
// make good for it.
bool may_begin_pair(double before, double after) {
  constexpr double kWorthTrying = 1;  // two facets of quality 0.5, or one at twice tau
  constexpr double kMostRise = 1.5;
  return before >= kWorthTrying && after <= kMostRise * before;
}

class Flipper {
 public:
  Flipper(MaterialSurfaces& surfaces, double voxel_mm, double deviation_mm)
      : surfaces_(surfaces),
        index_(index_facets(surfaces, voxel_mm)),
        guard_(surfaces, index_, kClearanceVox * voxel_mm),
        objective_{deviation_mm},
        spacing_mm_(voxel_mm),
        samples_(surfaces.samples()),
        farthest_of_(surfaces.facets().size(), 0) {
    parallel_for_each_index(0, farthest_of_.size(), [&](std::size_t f) {
      if (surfaces_.facets()[f].is_alive) farthest_of_[f] = farthest(static_cast<std::int32_t>(f));
    });
  }

  enum class Outcome { Flipped, NoGain, Refused };

  /// Whether `try_flip`, or `try_pair`, has anything to try. Only looks: threads may ask at the
  /// same time.
  [[nodiscard]] bool is_promising(const FacetEdge& edge, bool by_pairs) const {
    return (by_pairs ? find(edge, may_begin_pair) : find(edge, gains)).has_value();
  }

  Outcome try_flip(const FacetEdge& edge) {
    const auto flip = find(edge, gains);
    if (!flip) return Outcome::NoGain;
    if (!is_allowed(*flip)) return Outcome::Refused;
    touch(*flip);
    carry_out(*flip);
    return Outcome::Flipped;
  }

  // Out of a valley that no single flip leaves: a flip that costs, and one beside it that makes
  // good for both. Only where there is something to gain.
  Outcome try_pair(const FacetEdge& edge) {
    const auto first = find(edge, may_begin_pair);
    if (!first || !is_allowed(*first)) return Outcome::NoGain;
    const auto of_first = surfaces_.samples_of(first->first);
    const auto of_second = surfaces_.samples_of(first->second);
    const std::array<double, 2> farthest{farthest_of_[first->first], farthest_of_[first->second]};
    carry_out(*first);
    std::optional<Flip> best;
    const std::array<FacetEdge, 4> sides{{{{first->b, first->c}, first->second},
                                          {{first->c, first->a}, first->first},
                                          {{first->a, first->d}, first->first},
                                          {{first->d, first->b}, first->second}}};
    for (const FacetEdge& side : sides) {
      const double least = best ? best->gain() : kLeastGain - first->gain();
      const auto second =
          find(side, [&](double before, double after) { return before - after > least; });
      if (second && is_allowed(*second)) best = second;
    }
    if (best) {
      touch(*first);
      touch(*best);
      carry_out(*best);
      return Outcome::Flipped;
    }
    // back to what was there, to the last sample; the facets have changed their numbers
    carry_out(*find({{first->c, first->d}, first->first}, [](double, double) { return true; }));
    surfaces_.set_samples(first->second, of_first);
    surfaces_.set_samples(first->first, of_second);
    farthest_of_[first->second] = farthest[0];
    farthest_of_[first->first] = farthest[1];
    return Outcome::NoGain;
  }

  /// Facets of one of the edge's ends changed in this pass or the one before.
  [[nodiscard]] bool is_touched(const Edge& edge) const {
    return last_touch(edge.first) + 1 >= pass_ || last_touch(edge.second) + 1 >= pass_;
  }

  /// Facets of one of the edge's ends changed in this pass. Every facet that a single flip weighs
  /// has one of these ends.
  [[nodiscard]] bool is_touched_now(const Edge& edge) const {
    return last_touch(edge.first) == pass_ || last_touch(edge.second) == pass_;
  }

  /// All that `try_pair` weighs belongs to facets at the four vertices around the edge; did one of
  /// them change since the last pass of pairs began?
  [[nodiscard]] bool is_pair_touched(const FacetEdge& edge) const {
    const auto [a, b] = edge.edge;
    std::int32_t first = -1, second = -1;
    if (!find_facets(edge, first, second)) return false;
    const std::array<std::int32_t, 4> around{a, b, across(first, a, b), across(second, a, b)};
    return std::any_of(around.begin(), around.end(),
                       [&](std::int32_t v) { return last_touch(v) >= last_pairs_; });
  }

  void begin_pass(bool by_pairs) {
    ++pass_;
    touched_.resize(surfaces_.points().size(), 0);
    last_pairs_ = pairs_;
    if (by_pairs) pairs_ = pass_;
  }

 private:
  // As `MaterialSurfaces::facets_of_edge`, without a search where the edge's facet still has it.
  bool find_facets(const FacetEdge& edge, std::int32_t& first, std::int32_t& second) const {
    const auto [a, b] = edge.edge;
    const VertexTriple& t = surfaces_.facets()[edge.facet].vertices;
    const auto place_a = std::find(t.begin(), t.end(), a) - t.begin();
    const auto place_b = std::find(t.begin(), t.end(), b) - t.begin();
    if (place_a == 3 || place_b == 3) return surfaces_.facets_of_edge(a, b, first, second);
    first = edge.facet;
    second = surfaces_.facet_across(edge.facet, a, b);
    if (place_b != (place_a + 1) % 3) std::swap(first, second);
    return std::min(first, second) >= 0;
  }

  // What flipping edge a-b would change; nothing where it is no edge inside a patch, or where
  // `accept(cost before, cost after)` is false. Bounds of the cost after, from below, settle most
  // cases before the dear part of it.
  template <typename Accept>
  [[nodiscard]] std::optional<Flip> find(const FacetEdge& edge, const Accept& accept) const {
    const auto [a, b] = edge.edge;
    Flip flip{};
    if (!find_facets(edge, flip.first, flip.second)) return std::nullopt;
    const std::int32_t c = across(flip.first, a, b), d = across(flip.second, a, b);
    flip.a = a;
    flip.b = b;
    flip.c = c;
    flip.d = d;
    flip.after = {{{a, d, c}, {d, b, c}}};
    flip.outer = {normal_across(b, c, flip.first), normal_across(c, a, flip.first),
                  normal_across(a, d, flip.second), normal_across(d, b, flip.second)};
    flip.cost_before =
        cost({{{a, b, c}, {b, a, d}}}, {farthest_of_[flip.first], farthest_of_[flip.second]},
             {0, 1, 2, 3}, flip.outer);
    const auto is_accepted = [&] {
      flip.cost_after = cost(flip.after, flip.farthest_after, {2, 1, 3, 0}, flip.outer);
      return accept(flip.cost_before, flip.cost_after);
    };
    if (!is_accepted()) return std::nullopt;
    flip.farthest_after = farthest_sample(flip);
    if (!is_accepted()) return std::nullopt;
    for (int f = 0; f < 2; ++f)
      flip.farthest_after[f] = std::max(flip.farthest_after[f], bridge(flip.after[f]));
    if (!is_accepted()) return std::nullopt;
    return flip;
  }

  // Of the samples of both facets after a flip, each with the facet that `MaterialSurfaces` will
  // hand it to.
  [[nodiscard]] std::array<double, 2> farthest_sample(const Flip& flip) const {
    std::array<double, 2> farthest2{};
    for (const auto f : {flip.first, flip.second})
      surfaces_.for_each_sample(f, [&](const Vec3& s) {
        const double to_first = squared_distance(s, flip.after[0]);
        const double to_second = squared_distance(s, flip.after[1]);
        const int nearest = to_first <= to_second ? 0 : 1;
        farthest2[nearest] = std::max(farthest2[nearest], std::min(to_first, to_second));
      });
    return {std::sqrt(farthest2[0]), std::sqrt(farthest2[1])};
  }

  // Two-sided distance between a facet and the dense surface.
  [[nodiscard]] double farthest(std::int32_t facet) const {
    const VertexTriple& t = surfaces_.facets()[facet].vertices;
    double farthest2 = 0;
    surfaces_.for_each_sample(
        facet, [&](const Vec3& s) { farthest2 = std::max(farthest2, squared_distance(s, t)); });
    return std::max(std::sqrt(farthest2), bridge(t));
  }

  // Of all samples, so that it depends on the facet alone: what is minimised is one function, and
  // the descent ends.
  [[nodiscard]] double bridge(const VertexTriple& t) const {
    const auto& p = surfaces_.points();
    std::vector<std::int32_t>& nearest = nearest_.local();
    const auto nearest_mm2 = [&](const Vec3& probe) {
      samples_.nearest(probe, 1, nearest);
      return nearest.empty() ? 0 : squared_norm(surfaces_.samples()[nearest.front()] - probe);
    };
    return objective_.bridge_mm(p[t[0]], p[t[1]], p[t[2]], nearest_mm2, spacing_mm_);
  }

  void carry_out(const Flip& flip) {
    for (const auto f : {flip.first, flip.second})
      index_.remove(f);
    surfaces_.flip_edge(flip.a, flip.b);
    for (const auto f : {flip.first, flip.second})
      insert_facet(surfaces_, f, index_);
    farthest_of_[flip.first] = flip.farthest_after[0];
    farthest_of_[flip.second] = flip.farthest_after[1];
  }

  void touch(const Flip& flip) {
    for (const auto v : {flip.a, flip.b, flip.c, flip.d})
      touched_[static_cast<std::size_t>(v)] = pass_;
  }

  [[nodiscard]] int last_touch(std::int32_t vertex) const {
    return touched_[static_cast<std::size_t>(vertex)];
  }

  [[nodiscard]] std::int32_t across(std::int32_t facet, std::int32_t a, std::int32_t b) const {
    for (const auto v : surfaces_.facets()[facet].vertices)
      if (v != a && v != b) return v;
    return -1;
  }

  [[nodiscard]] Vec3 unit_normal(const VertexTriple& t) const {
    const auto& p = surfaces_.points();
    return normalized(area_vector2(p[t[0]], p[t[1]], p[t[2]]));
  }

  [[nodiscard]] double squared_distance(const Vec3& s, const VertexTriple& t) const {
    const auto& p = surfaces_.points();
    return squared_norm(nearest_on_triangle(s, p[t[0]], p[t[1]], p[t[2]]) - s);
  }

  // Unit normal of the facet on the other side of edge (u, v) of `facet`; zero on a curve.
  [[nodiscard]] Vec3 normal_across(std::int32_t u, std::int32_t v, std::int32_t facet) const {
    const std::int32_t other = surfaces_.facet_across(facet, u, v);
    return other < 0 ? Vec3{} : unit_normal(surfaces_.facets()[other].vertices);
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

  bool is_allowed(const Flip& flip) {
    const auto& [first, second, a, b, c, d, after, farthest_after, outer, before_, after_] = flip;
    const auto& p = surfaces_.points();
    const auto quality = [&](const VertexTriple& t) {
      return triangle_quality(p[t[0]], p[t[1]], p[t[2]]);
    };
    // What is poorer already may become less so.
    const double least = std::min({kMinQuality, quality({a, b, c}), quality({b, a, d})});
    for (const auto& t : after)
      if (quality(t) < least) return false;
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
    return !guard_.sweeps_over_part(p[b], after[0]);  // the tet of all four
  }

  MaterialSurfaces& surfaces_;
  FacetIndex index_;
  EmbeddingGuard guard_;
  SurfaceObjective objective_;
  double spacing_mm_;  // of dense vertices, at most
  NeighbourTree samples_;
  mutable tbb::enumerable_thread_specific<std::vector<std::int32_t>> nearest_;
  std::vector<double> farthest_of_;  // by facet: distance between it and the dense surface
  int pass_ = 0;
  int pairs_ = 0, last_pairs_ = 0;  // the passes of pairs: the latest, and the one before
  std::vector<int> touched_;        // per vertex: the last pass that changed its facets
};

// All edges, ascending: sorted by counting what starts at each vertex, as every pass needs them.
std::vector<FacetEdge> list_edges(const MaterialSurfaces& surfaces) {
  const auto for_each_side = [&](const auto& visit) {
    for (std::size_t f = 0; f < surfaces.facets().size(); ++f) {
      const auto& facet = surfaces.facets()[f];
      if (!facet.is_alive) continue;
      for (int c = 0; c < 3; ++c)
        visit({Edge(std::minmax(facet.vertices[c], facet.vertices[(c + 1) % 3])),
               static_cast<std::int32_t>(f)});
    }
  };
  std::vector<std::size_t> place_of(surfaces.points().size() + 1, 0);
  for_each_side([&](const FacetEdge& side) { ++place_of[side.edge.first + 1]; });
  std::partial_sum(place_of.begin(), place_of.end(), place_of.begin());
  std::vector<FacetEdge> edges(place_of.back());
  for_each_side([&](const FacetEdge& side) { edges[place_of[side.edge.first]++] = side; });
  // Each place has moved to where its vertex ends.
  std::size_t begin = 0;
  for (const std::size_t end : place_of) {
    std::sort(edges.begin() + static_cast<std::ptrdiff_t>(begin),
              edges.begin() + static_cast<std::ptrdiff_t>(end));
    begin = end;
  }
  const auto are_same = [](const FacetEdge& a, const FacetEdge& b) { return a.edge == b.edge; };
  edges.erase(std::unique(edges.begin(), edges.end(), are_same), edges.end());
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
    using Outcome = Flipper::Outcome;
    std::set<Edge> refused;
    // Edges around which nothing has changed since they were last looked at are not looked at.
    const auto is_due = [&](const FacetEdge& side, bool by_pairs) {
      if (by_pairs) return flipper.is_pair_touched(side);
      return flipper.is_touched(side.edge) || refused.contains(side.edge);
    };
    const auto run_pass = [&](bool by_pairs, bool all) {
      flipper.begin_pass(by_pairs);
      const std::vector<FacetEdge> edges = list_edges(surfaces);
      // Most edges are left as they are. Which, is found out in parallel; it holds until something
      // changes beside the edge. Those that are not due yet may become so during the pass.
      std::vector<char> is_promising(edges.size(), true);
      parallel_for_each_index(0, edges.size(), [&](std::size_t n) {
        if (all || is_due(edges[n], by_pairs))
          is_promising[n] = flipper.is_promising(edges[n], by_pairs);
      });
      std::size_t flips = 0;
      for (std::size_t n = 0; n < edges.size(); ++n) {
        if (!all && !is_due(edges[n], by_pairs)) continue;
        Outcome outcome = Outcome::NoGain;
        if (is_promising[n] || flipper.is_touched_now(edges[n].edge))
          outcome = by_pairs ? flipper.try_pair(edges[n]) : flipper.try_flip(edges[n]);
        if (outcome == Outcome::Flipped) flips += by_pairs ? 2 : 1;
        if (by_pairs) continue;
        if (outcome == Outcome::Refused)
          refused.insert(edges[n].edge);
        else
          refused.erase(edges[n].edge);
      }
      result.stats.flips += flips;
      ++result.stats.passes;
      report_progress(context, "edge flipping",
                      static_cast<double>(result.stats.passes) / options.max_passes);
      return flips;
    };
    // Single flips until none is left, then one pass of pairs, and so on.
    bool all = true, all_pairs = true;
    while (result.stats.passes < options.max_passes) {
      const std::size_t flips = run_pass(false, all);
      all = false;
      if (flips > 0) continue;
      if (result.stats.passes + 1 >= options.max_passes || run_pass(true, all_pairs) == 0) break;
      all_pairs = false;
    }
    result.stats.refused = refused.size();
  }
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
