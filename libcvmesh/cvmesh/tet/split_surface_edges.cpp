// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/split_surface_edges.h"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

namespace cvmesh {
namespace {

using Edge = std::pair<std::int32_t, std::int32_t>;  // the smaller vertex first

constexpr std::array<std::array<std::size_t, 2>, 6> kEdgesOfTet{
    {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};

Edge edge_of(std::int32_t a, std::int32_t b) {
  return std::minmax(a, b);
}

void sort_and_unite(std::vector<Edge>& edges) {
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
}

/// The number of an edge in a sorted list.
std::optional<std::size_t> find_edge(const std::vector<Edge>& edges, const Edge& edge) {
  const auto found = std::lower_bound(edges.begin(), edges.end(), edge);
  if (found == edges.end() || *found != edge) return std::nullopt;
  return static_cast<std::size_t>(found - edges.begin());
}

/// The same simplex with another corner.
template <typename Simplex>
Simplex with(Simplex simplex, std::int32_t corner, std::int32_t other) {
  std::replace(simplex.begin(), simplex.end(), corner, other);
  return simplex;
}

class EdgeSplitter {
 public:
  EdgeSplitter(TetMesh& mesh,
               std::span<const std::int32_t> tets,
               const std::vector<bool>& is_frozen,
               double least_mm)
      : mesh_(mesh), is_frozen_(is_frozen), is_near_(mesh.points.size(), false) {
    for (const auto t : tets)
      for (const auto v : mesh.tets[t])
        is_near_[v] = true;
    const std::vector<Edge> on_surface = find_surface_edges();
    for (const auto t : tets)
      if (const auto edge = longest_edge(mesh.tets[t], on_surface, least_mm))
        wanted_.push_back(*edge);
    candidates_ = wanted_;
    sort_and_unite(candidates_);
  }

  std::vector<std::int32_t> split(std::size_t most) {
    choose(most);
    if (edges_.empty()) return {};
    insert_middles();
    split_facets();
    split_tets();
    std::sort(touched_.begin(), touched_.end());
    touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
    return std::move(touched_);
  }

 private:
  [[nodiscard]] bool is_frozen(std::int32_t v) const {
    return static_cast<std::size_t>(v) < is_frozen_.size() && is_frozen_[v];
  }

  // Those of which both ends belong to the wanted tets.
  [[nodiscard]] std::vector<Edge> find_surface_edges() const {
    std::vector<Edge> edges;
    for (const auto& facet : mesh_.surface.facets)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto a = facet[k], b = facet[(k + 1) % 3];
        if (is_near_[a] && is_near_[b] && !(is_frozen(a) && is_frozen(b)))
          edges.push_back(edge_of(a, b));
      }
    sort_and_unite(edges);
    return edges;
  }

  [[nodiscard]] std::optional<Edge> longest_edge(const std::array<std::int32_t, 4>& tet,
                                                 const std::vector<Edge>& on_surface,
                                                 double least_mm) const {
    std::optional<Edge> longest;
    for (const auto& [i, j] : kEdgesOfTet) {
      const Edge edge = edge_of(tet[i], tet[j]);
      const double length = distance(mesh_.points[edge.first], mesh_.points[edge.second]);
      if (length < least_mm || !find_edge(on_surface, edge)) continue;
      least_mm = length;
      longest = edge;
    }
    return longest;
  }

  /// Calls `visit(number of the edge)` for the edges of a simplex that are in `edges`.
  template <typename Simplex, typename Visit>
  void for_each_edge_in(const std::vector<Edge>& edges,
                        const Simplex& simplex,
                        const Visit& visit) const {
    for (std::size_t i = 0; i < simplex.size(); ++i)
      for (std::size_t j = i + 1; j < simplex.size(); ++j)
        if (is_near_[simplex[i]] && is_near_[simplex[j]])
          if (const auto n = find_edge(edges, edge_of(simplex[i], simplex[j]))) visit(*n);
  }

  // In the order of the wanted tets, those whose tets no edge before them splits.
  void choose(std::size_t most) {
    std::vector<std::vector<std::int32_t>> tets_at(candidates_.size());
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      for_each_edge_in(candidates_, mesh_.tets[t],
                       [&](std::size_t n) { tets_at[n].push_back(static_cast<std::int32_t>(t)); });
    std::vector<bool> is_split(mesh_.tets.size(), false);
    for (const Edge& edge : wanted_) {
      if (edges_.size() >= most) break;
      const auto& around = tets_at[*find_edge(candidates_, edge)];
      if (std::any_of(around.begin(), around.end(), [&](std::int32_t t) { return is_split[t]; }))
        continue;
      for (const auto t : around)
        is_split[t] = true;
      edges_.push_back(edge);
    }
    std::sort(edges_.begin(), edges_.end());
  }

  void insert_middles() {
    std::vector<Vec3> middles;
    middles.reserve(edges_.size());
    for (const auto& [a, b] : edges_)
      middles.push_back(0.5 * (mesh_.points[a] + mesh_.points[b]));
    first_middle_ = static_cast<std::int32_t>(mesh_.surface.points.size());
    const auto place = mesh_.points.begin() + first_middle_;
    mesh_.points.insert(place, middles.begin(), middles.end());
    mesh_.surface.points.insert(mesh_.surface.points.end(), middles.begin(), middles.end());
  }

  [[nodiscard]] std::int32_t middle_of(std::size_t edge) const {
    return first_middle_ + static_cast<std::int32_t>(edge);
  }

  void split_facets() {
    InterfaceMesh& surface = mesh_.surface;
    for (std::size_t f = 0, count = surface.facets.size(); f < count; ++f) {
      const std::array<std::int32_t, 3> facet = surface.facets[f];
      for_each_edge_in(edges_, facet, [&](std::size_t n) {
        surface.facets[f] = with(facet, edges_[n].second, middle_of(n));
        surface.facets.push_back(with(facet, edges_[n].first, middle_of(n)));
        surface.patch_of.push_back(PatchKey(surface.patch_of[f]));
      });
    }
  }

  void split_tets() {
    const auto shift = static_cast<std::int32_t>(edges_.size());
    const auto renumbered = [&](std::array<std::int32_t, 4> tet) {
      for (auto& v : tet)
        if (v >= first_middle_) v += shift;
      return tet;
    };
    for (std::size_t t = 0, count = mesh_.tets.size(); t < count; ++t) {
      const std::array<std::int32_t, 4> old = mesh_.tets[t];
      const std::array<std::int32_t, 4> tet = mesh_.tets[t] = renumbered(old);
      for_each_edge_in(edges_, old, [&](std::size_t n) {
        // Ends of the edge are on the surface: their numbers stay.
        mesh_.tets[t] = with(tet, edges_[n].second, middle_of(n));
        mesh_.tets.push_back(with(tet, edges_[n].first, middle_of(n)));
        mesh_.material_of.push_back(MaterialId(mesh_.material_of[t]));
        touched_.insert(touched_.end(), tet.begin(), tet.end());
        touched_.push_back(middle_of(n));
      });
    }
  }

  TetMesh& mesh_;
  const std::vector<bool>& is_frozen_;
  std::vector<bool> is_near_;      // vertices of the wanted tets; by their old numbers
  std::vector<Edge> wanted_;       // one of each of these tets, in their order
  std::vector<Edge> candidates_;   // the same, sorted, each once
  std::vector<Edge> edges_;        // that are split, sorted
  std::int32_t first_middle_ = 0;  // vertex in the middle of the first of them
  std::vector<std::int32_t> touched_;
};

}  // namespace

std::vector<std::int32_t> split_surface_edges(TetMesh& mesh,
                                              std::span<const std::int32_t> tets,
                                              const std::vector<bool>& is_frozen,
                                              double least_mm,
                                              std::size_t most) {
  return EdgeSplitter(mesh, tets, is_frozen, least_mm).split(most);
}

}  // namespace cvmesh
