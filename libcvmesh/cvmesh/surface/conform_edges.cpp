// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/conform_edges.h"

#include "cvmesh/pipeline/stage_names.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <queue>
#include <span>
#include <unordered_map>
#include <utility>

namespace cvmesh {
namespace {

using Edge = std::pair<std::int32_t, std::int32_t>;  // ascending

Edge edge_of(std::int32_t a, std::int32_t b) {
  return std::minmax(a, b);
}

double segment_distance(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  double least = std::min(
      {distance(a, nearest_on_segment(a, c, d)), distance(b, nearest_on_segment(b, c, d)),
       distance(c, nearest_on_segment(c, a, b)), distance(d, nearest_on_segment(d, a, b))});
  // inside of both segments: along the common normal of the lines
  const Vec3 u = b - a, v = d - c, w = a - c;
  const double uu = squared_norm(u), uv = dot(u, v), vv = squared_norm(v);
  const double determinant = uu * vv - uv * uv;
  if (determinant <= 0) return least;
  const double s = (uv * dot(v, w) - vv * dot(u, w)) / determinant;
  const double t = (uu * dot(v, w) - uv * dot(u, w)) / determinant;
  if (s > 0 && s < 1 && t > 0 && t < 1) least = std::min(least, norm(w + s * u - t * v));
  return least;
}

/// The edges of a list of facets, each with its facets (-1 for none).
class EdgeMap {
 public:
  explicit EdgeMap(const std::vector<VertexTriple>& facets) {
    for (std::size_t f = 0; f < facets.size(); ++f)
      for (int c = 0; c < 3; ++c)
        add(facets[f][c], facets[f][(c + 1) % 3], static_cast<std::int32_t>(f));
  }

  [[nodiscard]] bool has(const Edge& e) const { return facets_.contains(key(e)); }

  [[nodiscard]] bool is_inner(const Edge& e) const {
    const auto it = facets_.find(key(e));
    return it != facets_.end() && it->second[1] >= 0;
  }

  /// @pre the edge is there
  [[nodiscard]] const std::array<std::int32_t, 2>& facets(const Edge& e) const {
    return facets_.at(key(e));
  }

  /// The edges with two facets, ascending; or those with one.
  [[nodiscard]] std::vector<Edge> list(bool inner) const {
    std::vector<Edge> edges;
    for (const auto& [packed, pair] : facets_)
      if ((pair[1] >= 0) == inner)
        edges.emplace_back(static_cast<std::int32_t>(packed >> 32),
                           static_cast<std::int32_t>(packed & 0xffffffffU));
    std::sort(edges.begin(), edges.end());
    return edges;
  }

  void add(std::int32_t a, std::int32_t b, std::int32_t facet) {
    const auto [it, is_new] = facets_.try_emplace(key(edge_of(a, b)), std::array{facet, -1});
    if (!is_new) it->second[1] = facet;
  }

  void remove(const Edge& e) { facets_.erase(key(e)); }

  void replace(std::int32_t a, std::int32_t b, std::int32_t old_facet, std::int32_t new_facet) {
    for (auto& f : facets_.at(key(edge_of(a, b))))
      if (f == old_facet) {
        f = new_facet;
        return;
      }
  }

 private:
  static std::uint64_t key(const Edge& e) {
    return std::uint64_t{static_cast<std::uint32_t>(e.first)} << 32 |
           static_cast<std::uint32_t>(e.second);
  }

  std::unordered_map<std::uint64_t, std::array<std::int32_t, 2>> facets_;
};

/// A slave patch on its way to the master's edges.
class PatchFlipper {
 public:
  PatchFlipper(const EdgeMap& wanted,
               const std::vector<Vec3>& points,
               std::vector<VertexTriple>& facets)
      : wanted_(wanted), points_(points), facets_(facets), edges_(facets) {}

  [[nodiscard]] bool has(const Edge& e) const { return edges_.has(e); }

  [[nodiscard]] std::size_t flips() const { return flips_; }

  /// @pre the edge is there
  [[nodiscard]] std::array<std::int32_t, 2> facets(const Edge& e) const { return edges_.facets(e); }

  /// The edge that a flip of `e` gives. @pre `e` has two facets
  [[nodiscard]] Edge turned_of(const Edge& e) const {
    const auto& [f, g] = edges_.facets(e);
    return edge_of(across(f, e), across(g, e));
  }

  /// Flips `e` unless the edge that this gives is there already. @pre `e` has two facets
  bool try_flip(const Edge& e) {
    auto [f, g] = edges_.facets(e);
    auto [a, b] = e;
    // f has a -> b: (a, b, c); g has b -> a: (b, a, d)
    const auto runs = [&](std::int32_t facet) {
      const VertexTriple& t = facets_[facet];
      for (int c = 0; c < 3; ++c)
        if (t[c] == a && t[(c + 1) % 3] == b) return true;
      return false;
    };
    if (!runs(f)) std::swap(f, g);
    const std::int32_t c = across(f, e), d = across(g, e);
    if (c == d || edges_.has(edge_of(c, d))) return false;
    facets_[f] = {a, d, c};
    facets_[g] = {d, b, c};
    edges_.remove(e);
    edges_.add(c, d, f);
    edges_.add(c, d, g);
    edges_.replace(b, c, f, g);
    edges_.replace(a, d, g, f);
    ++flips_;
    return true;
  }

  /// Flips edges that give an edge of the master at once, until there are none.
  void flip_directly() {
    for (std::size_t before = flips_ + 1; before != flips_;) {
      before = flips_;
      for (const Edge& e : edges_.list(true)) {
        if (wanted_.has(e)) continue;
        const Edge turned = turned_of(e);
        if (wanted_.has(turned)) try_flip(e);
      }
    }
  }

  /// Makes `e` an edge by flipping away what it crosses. @return whether it is one now
  bool insert(const Edge& e) {
    std::vector<Edge> crossed;
    if (!find_crossed(e, crossed)) return false;
    while (!crossed.empty())
      if (!flip_one(crossed)) return false;
    return has(e);
  }

 private:
  [[nodiscard]] std::int32_t across(std::int32_t facet, const Edge& e) const {
    for (const auto v : facets_[facet])
      if (v != e.first && v != e.second) return v;
    return -1;
  }

  // Flips one of the crossed edges so that one fewer is left: the first or the last, or one whose
  // neighbours in the list have a vertex in common, around which the three lie like a fan.
  bool flip_one(std::vector<Edge>& crossed) {
    const auto common = [](const Edge& e, const Edge& f) {
      return e.first == f.first || e.first == f.second ? e.first : e.second;
    };
    for (const bool only_wanted : {true, false})
      for (std::size_t n = 0; n < crossed.size(); ++n) {
        const bool is_end = n == 0 || n + 1 == crossed.size();
        if (!is_end && common(crossed[n], crossed[n - 1]) != common(crossed[n], crossed[n + 1]))
          continue;
        if (only_wanted && !wanted_.has(turned_of(crossed[n]))) continue;
        if (!try_flip(crossed[n])) continue;
        crossed.erase(crossed.begin() + static_cast<std::ptrdiff_t>(n));
        return true;
      }
    return false;
  }

  // The edges to cross from one end of e to the other, in order: the way through the facets whose
  // edges lie nearest to e (Dijkstra). Edges that the master has are crossed only where there is no
  // other way; they come back in a later round.
  bool find_crossed(const Edge& e, std::vector<Edge>& crossed) const {
    const Vec3 &a = points_[e.first], &b = points_[e.second];
    const double length = std::max(distance(a, b), 1e-300);
    // A crossing by itself costs next to nothing, so that among ways of equal distance the short
    // one is taken; one of an edge of the master costs as much as a detour of many edges.
    constexpr double kCrossing = 1e-6, kMastersEdge = 100;

    struct Step {
      double cost;
      std::int32_t facet;

      bool operator<(const Step& other) const {  // the cheapest first, ties by index
        return std::pair(cost, facet) > std::pair(other.cost, other.facet);
      }
    };

    struct Reached {
      double cost;
      std::int32_t from;  // facet; -1 at the start
      Edge entry;
      bool is_final = false;
    };

    std::unordered_map<std::int32_t, Reached> reached;
    std::priority_queue<Step> queue;
    const auto has_vertex = [&](std::int32_t f, std::int32_t v) {
      return std::find(facets_[f].begin(), facets_[f].end(), v) != facets_[f].end();
    };
    for (std::size_t n = 0; n < facets_.size(); ++n) {
      const auto f = static_cast<std::int32_t>(n);
      if (!has_vertex(f, e.first)) continue;
      reached[f] = {0, -1, {}};
      queue.push({0, f});
    }
    while (!queue.empty()) {
      const Step step = queue.top();
      queue.pop();
      Reached& here = reached.at(step.facet);
      if (here.is_final) continue;
      here.is_final = true;
      if (has_vertex(step.facet, e.second)) {
        for (auto f = step.facet; reached.at(f).from >= 0; f = reached.at(f).from)
          crossed.push_back(reached.at(f).entry);
        std::reverse(crossed.begin(), crossed.end());
        return !crossed.empty();
      }
      const VertexTriple t = facets_[step.facet];
      for (int c = 0; c < 3; ++c) {
        const Edge side = edge_of(t[c], t[(c + 1) % 3]);
        if (side.first == e.first || side.second == e.first || !edges_.is_inner(side)) continue;
        const auto& [f, g] = edges_.facets(side);
        const std::int32_t next = f == step.facet ? g : f;
        if (has_vertex(next, e.first)) continue;
        const double cost =
            step.cost + kCrossing + (wanted_.has(side) ? kMastersEdge : 0) +
            segment_distance(a, b, points_[side.first], points_[side.second]) / length;
        const auto [it, is_new] = reached.try_emplace(next, Reached{cost, step.facet, side});
        if (!is_new) {
          if (it->second.is_final || it->second.cost <= cost) continue;
          it->second = {cost, step.facet, side};
        }
        queue.push({cost, next});
      }
    }
    return false;
  }

  const EdgeMap& wanted_;
  const std::vector<Vec3>& points_;
  std::vector<VertexTriple>& facets_;
  EdgeMap edges_;
  std::size_t flips_ = 0;
};

std::vector<std::int32_t> vertices_of(const std::vector<VertexTriple>& facets) {
  std::vector<std::int32_t> vertices;
  for (const auto& facet : facets)
    vertices.insert(vertices.end(), facet.begin(), facet.end());
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

std::vector<VertexTriple> canonical(std::vector<VertexTriple> facets) {
  for (auto& f : facets)
    std::rotate(f.begin(), std::min_element(f.begin(), f.end()), f.end());
  std::sort(facets.begin(), facets.end());
  return facets;
}

Vec3 middle(const std::vector<Vec3>& points, const Edge& e) {
  return 0.5 * (points[e.first] + points[e.second]);
}

std::vector<Edge> absent(const std::vector<Edge>& edges, const PatchFlipper& flipper) {
  std::vector<Edge> result;
  for (const Edge& e : edges)
    if (!flipper.has(e)) result.push_back(e);
  return result;
}

void add(const EdgeConformity& part, EdgeConformity& sum) {
  sum.edges += part.edges;
  sum.edges_differing += part.edges_differing;
  sum.flips += part.flips;
  sum.edges_not_flippable += part.edges_not_flippable;
  std::vector<std::int32_t> all;
  std::set_union(sum.vertices_differing.begin(), sum.vertices_differing.end(),
                 part.vertices_differing.begin(), part.vertices_differing.end(),
                 std::back_inserter(all));
  sum.vertices_differing = std::move(all);
  if (!sum.obstacle) sum.obstacle = part.obstacle;
}

/// The facets of one patch in an ordered boundary.
std::span<const OwnFacet> facets_on(const OwnBoundary& boundary, const PatchKey& patch) {
  const auto begin =
      std::lower_bound(boundary.begin(), boundary.end(), patch,
                       [](const OwnFacet& f, const PatchKey& key) { return f.patch < key; });
  const auto end =
      std::upper_bound(begin, boundary.end(), patch,
                       [](const PatchKey& key, const OwnFacet& f) { return key < f.patch; });
  return {begin, end};
}

std::vector<VertexTriple> triples_of(std::span<const OwnFacet> facets) {
  std::vector<VertexTriple> triples;
  for (const OwnFacet& facet : facets)
    triples.push_back(facet.vertices);
  return triples;
}

std::vector<PatchKey> patches_of(const std::vector<OwnBoundary>& boundaries) {
  std::vector<PatchKey> patches;
  for (const OwnBoundary& boundary : boundaries)
    for (const OwnFacet& facet : boundary)
      if (patches.empty() || patches.back() != facet.patch) patches.push_back(facet.patch);
  std::sort(patches.begin(), patches.end());
  patches.erase(std::unique(patches.begin(), patches.end()), patches.end());
  return patches;
}

// Hands the samples of two facets to the nearer of both.
void share_samples(const std::vector<Vec3>& points, OwnFacet& f, OwnFacet& g) {
  std::vector<Vec3> samples = std::move(f.samples);
  samples.insert(samples.end(), g.samples.begin(), g.samples.end());
  f.samples.clear();
  g.samples.clear();
  const auto squared_distance = [&](const Vec3& p, const OwnFacet& facet) {
    const auto& [a, b, c] = facet.vertices;
    return squared_norm(nearest_on_triangle(p, points[a], points[b], points[c]) - p);
  };
  for (const Vec3& p : samples)
    (squared_distance(p, f) <= squared_distance(p, g) ? f : g).samples.push_back(p);
}

// Flips the edges of a material on the interfaces where it is the master, if its own masters have
// them on theirs. Returns how many; those that cannot go are found when all patches are joined.
std::size_t give_up_edges(const EdgeMap& masters,
                          MaterialId material,
                          const std::vector<Vec3>& points,
                          OwnBoundary& boundary) {
  std::vector<VertexTriple> facets;
  std::vector<std::size_t> place;
  for (std::size_t f = 0; f < boundary.size(); ++f)
    if (is_master(material, boundary[f].patch)) {
      facets.push_back(boundary[f].vertices);
      place.push_back(f);
    }
  PatchFlipper flipper(masters, points, facets);
  std::size_t given_up = 0;
  for (const Edge& e : EdgeMap(facets).list(true)) {
    if (!masters.has(e)) continue;
    const auto [f, g] = flipper.facets(e);
    if (boundary[place[f]].patch != boundary[place[g]].patch) continue;  // on a curve
    if (masters.has(flipper.turned_of(e)) || !flipper.try_flip(e)) continue;
    for (const auto n : {f, g})
      boundary[place[n]].vertices = facets[n];
    share_samples(points, boundary[place[f]], boundary[place[g]]);
    ++given_up;
  }
  return given_up;
}

// Leaves only the points that facets use, in their order.
void compact(const std::vector<Vec3>& points, InterfaceMesh& mesh) {
  const std::vector<std::int32_t> used = vertices_of(mesh.facets);
  std::vector<std::int32_t> place(points.size(), -1);
  for (const auto v : used) {
    place[v] = static_cast<std::int32_t>(mesh.points.size());
    mesh.points.push_back(points[v]);
  }
  for (auto& facet : mesh.facets)
    for (auto& v : facet)
      v = place[v];
}

}  // namespace

EdgeConformity ConformEdgesStats::total() const {
  EdgeConformity sum;
  for (const ConformPass& pass : passes)
    add(pass.result, sum);
  return sum;
}

EdgeConformity conform_patch(const std::vector<VertexTriple>& master,
                             const std::vector<Vec3>& points,
                             std::vector<VertexTriple>& slave) {
  const EdgeMap wanted(master);
  const std::vector<Edge> inner = wanted.list(true);
  PatchFlipper flipper(wanted, points, slave);
  EdgeConformity result;
  result.edges = inner.size();
  std::vector<Edge> missing = absent(inner, flipper);
  result.edges_differing = missing.size();

  const auto masters = vertices_of(master), slaves = vertices_of(slave);
  std::vector<std::int32_t>& alone = result.vertices_differing;
  std::set_symmetric_difference(masters.begin(), masters.end(), slaves.begin(), slaves.end(),
                                std::back_inserter(alone));
  if (!alone.empty()) result.obstacle = points[alone.front()];
  const std::vector<Edge> rim = wanted.list(false), slaves_rim = EdgeMap(slave).list(false);
  if (alone.empty() && rim == slaves_rim) {
    flipper.flip_directly();
    missing = absent(missing, flipper);
    // Edges may have to go again for others, and wait for each other: some rounds settle that.
    constexpr int kMostRounds = 16;
    for (int round = 0; round < kMostRounds && !missing.empty(); ++round) {
      for (const Edge& e : missing)
        if (!flipper.has(e)) flipper.insert(e);
      missing = absent(inner, flipper);
    }
  }
  result.flips = flipper.flips();
  result.edges_not_flippable = missing.size();
  if (missing.empty() && alone.empty() && canonical(master) != canonical(slave)) {
    // other rims, or equal edges around other facets
    std::vector<Edge> others;
    std::set_symmetric_difference(rim.begin(), rim.end(), slaves_rim.begin(), slaves_rim.end(),
                                  std::back_inserter(others));
    if (others.empty()) others = {edge_of(master.front()[0], master.front()[1])};
    result.edges_not_flippable = others.size();
    missing = std::move(others);
  }
  if (!result.obstacle && !missing.empty()) result.obstacle = middle(points, missing.front());
  return result;
}

ConformEdgesResult conform_edges(std::vector<OwnBoundary> boundaries,
                                 const std::vector<Vec3>& points,
                                 const StageContext& context) {
  ConformEdgesResult result;
  const std::vector<PatchKey> patches = patches_of(boundaries);
  std::vector<VertexTriple> masters;  // all facets that one slave has from its masters
  for (std::size_t n = 0; n < patches.size(); ++n) {
    const PatchKey& patch = patches[n];
    const auto master = facets_on(boundaries[patch.sides.outside], patch);
    auto slave = triples_of(facets_on(boundaries[patch.sides.inside], patch));
    auto& passes = result.stats.passes;
    if (passes.empty() || passes.back().sides != patch.sides) passes.push_back({patch.sides, {}});
    add(conform_patch(triples_of(master), points, slave), passes.back().result);
    for (const OwnFacet& facet : master) {
      masters.push_back(facet.vertices);
      result.mesh.facets.push_back(facet.vertices);
      result.mesh.patch_of.push_back(patch);
      result.samples.push_back(facet.samples);
    }
    const bool is_slaves_last =
        n + 1 == patches.size() || patches[n + 1].sides.inside != patch.sides.inside;
    if (is_slaves_last) {
      // The patches where it is the master come later: their slaves have larger labels.
      result.stats.edges_given_up += give_up_edges(EdgeMap(masters), patch.sides.inside, points,
                                                   boundaries[patch.sides.inside]);
      masters.clear();
    }
    report_progress(context, stage_names::kEdgeConformity,
                    static_cast<double>(n + 1) / static_cast<double>(patches.size()));
  }
  compact(points, result.mesh);
  return result;
}

}  // namespace cvmesh
