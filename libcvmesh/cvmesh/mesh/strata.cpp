// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <algorithm>
#include <array>
#include <utility>

namespace cvmesh {
namespace {

struct HalfEdge {
  std::int32_t a, b;  // a < b
  std::int32_t patch;
  friend auto operator<=>(const HalfEdge&, const HalfEdge&) = default;
};

struct CurveEdge {
  std::int32_t a, b;
  std::vector<std::int32_t> patches;  // sorted, distinct
};

// Edges where facets of different patches meet, in order of their vertices. Edges with two facets
// of one patch are inside it.
std::vector<CurveEdge> find_curve_edges(const InterfaceMesh& mesh,
                                        const std::vector<std::int32_t>& patch_of) {
  std::vector<HalfEdge> edges(3 * mesh.facets.size());
  parallel_for_each_index(0, mesh.facets.size(), [&](std::size_t f) {
    for (int c = 0; c < 3; ++c) {
      const auto [a, b] = std::minmax(mesh.facets[f][c], mesh.facets[f][(c + 1) % 3]);
      edges[3 * f + c] = {a, b, patch_of[f]};
    }
  });
  parallel_sort(edges.begin(), edges.end());
  std::vector<CurveEdge> curve_edges;
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].a == edges[begin].a && edges[end].b == edges[begin].b)
      ++end;
    if (edges[begin].patch == edges[end - 1].patch) continue;
    CurveEdge edge{edges[begin].a, edges[begin].b, {}};
    for (std::size_t e = begin; e < end; ++e)
      if (edge.patches.empty() || edge.patches.back() != edges[e].patch)
        edge.patches.push_back(edges[e].patch);
    curve_edges.push_back(std::move(edge));
  }
  return curve_edges;
}

// Walks the curve edges into chains between corners, then the closed loops that are left.
class CurveTracer {
 public:
  CurveTracer(const std::vector<CurveEdge>& edges, std::size_t vertex_count, Strata& strata)
      : edges_(edges), strata_(strata), first_(vertex_count + 1, 0), is_used_(edges.size()) {
    for (const auto& e : edges_) {
      ++first_[e.a + 1];
      ++first_[e.b + 1];
    }
    for (std::size_t v = 0; v < vertex_count; ++v)
      first_[v + 1] += first_[v];
    incident_.resize(2 * edges_.size());
    auto fill = first_;
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      incident_[fill[edges_[e].a]++] = static_cast<std::int32_t>(e);
      incident_[fill[edges_[e].b]++] = static_cast<std::int32_t>(e);
    }
  }

  void classify() {
    strata_.dimension.resize(first_.size() - 1);
    for (std::size_t v = 0; v + 1 < first_.size(); ++v) {
      const auto count = first_[v + 1] - first_[v];
      strata_.dimension[v] = count == 0 ? 2 : count == 2 && is_same_kind(v) ? 1 : 0;
    }
  }

  void trace() {
    for (std::size_t v = 0; v + 1 < first_.size(); ++v)
      if (strata_.dimension[v] == 0)
        for (auto n = first_[v]; n < first_[v + 1]; ++n)
          if (!is_used_[incident_[n]]) walk(static_cast<std::int32_t>(v), incident_[n]);
    for (std::size_t e = 0; e < edges_.size(); ++e)
      if (!is_used_[e]) walk(edges_[e].a, static_cast<std::int32_t>(e));
  }

 private:
  // Both curve edges of a vertex join the same patches.
  [[nodiscard]] bool is_same_kind(std::size_t v) const {
    return edges_[incident_[first_[v]]].patches == edges_[incident_[first_[v] + 1]].patches;
  }

  void walk(std::int32_t start, std::int32_t edge) {
    Strata::Curve curve;
    for (const auto patch : edges_[edge].patches)
      curve.patches.push_back(strata_.patches[patch]);
    curve.vertices.push_back(start);
    std::int32_t v = start;
    for (;;) {
      is_used_[edge] = true;
      v = edges_[edge].a == v ? edges_[edge].b : edges_[edge].a;
      if (v == start && strata_.dimension[v] == 1) {
        curve.is_closed = true;
        break;
      }
      curve.vertices.push_back(v);
      if (strata_.dimension[v] == 0) break;
      edge = incident_[first_[v]] == edge ? incident_[first_[v] + 1] : incident_[first_[v]];
    }
    strata_.curves.push_back(std::move(curve));
  }

  const std::vector<CurveEdge>& edges_;
  Strata& strata_;
  std::vector<std::int32_t> first_, incident_;
  std::vector<bool> is_used_;
};

}  // namespace

Strata find_strata(const InterfaceMesh& mesh) {
  Strata strata;
  strata.patches = mesh.patch_of;
  parallel_sort(strata.patches.begin(), strata.patches.end());
  strata.patches.erase(std::unique(strata.patches.begin(), strata.patches.end()),
                       strata.patches.end());
  strata.patch_of.resize(mesh.facets.size());
  parallel_for_each_index(0, mesh.facets.size(), [&](std::size_t f) {
    strata.patch_of[f] = static_cast<std::int32_t>(
        std::lower_bound(strata.patches.begin(), strata.patches.end(), mesh.patch_of[f]) -
        strata.patches.begin());
  });

  const auto edges = find_curve_edges(mesh, strata.patch_of);
  CurveTracer tracer(edges, mesh.points.size(), strata);
  tracer.classify();
  tracer.trace();
  std::sort(strata.curves.begin(), strata.curves.end(), [](const auto& a, const auto& b) {
    const auto smallest = [](const Strata::Curve& c) {
      return *std::min_element(c.vertices.begin(), c.vertices.end());
    };
    return std::pair(smallest(a), a.vertices) < std::pair(smallest(b), b.vertices);
  });
  strata.curve_of.assign(mesh.points.size(), -1);
  for (std::size_t c = 0; c < strata.curves.size(); ++c)
    for (const auto v : strata.curves[c].vertices)
      if (strata.dimension[v] == 1) strata.curve_of[v] = static_cast<std::int32_t>(c);
  return strata;
}

VertexStars find_vertex_stars(const InterfaceMesh& mesh) {
  VertexStars stars;
  stars.first.assign(mesh.points.size() + 1, 0);
  for (const auto& facet : mesh.facets)
    for (const auto v : facet)
      ++stars.first[v + 1];
  for (std::size_t v = 0; v < mesh.points.size(); ++v)
    stars.first[v + 1] += stars.first[v];
  stars.facet.resize(3 * mesh.facets.size());
  auto fill = stars.first;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f)
    for (const auto v : mesh.facets[f])
      stars.facet[fill[v]++] = static_cast<std::int32_t>(f);
  return stars;
}

}  // namespace cvmesh
