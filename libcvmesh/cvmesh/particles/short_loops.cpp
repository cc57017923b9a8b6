// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/short_loops.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/local_numbers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <functional>
#include <limits>
#include <numeric>
#include <queue>
#include <set>
#include <utility>

namespace cvmesh {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Steps of h that a loop must have room for: three, and a tenth for the detour that paths along
// edges make. Where the spread of the particles, or h between two loops, then leaves fewer, loop
// guards mend it: with half a step more in reserve, totalseg at epsilon 4 has 1,199 guards instead
// of 863, and 56 kept vertices instead of 62.
constexpr double kStepsPerLoop = 3.3;
/// Growth of h away from a lowered place, over delta. These particles serve the topology, and with
/// slope delta most of them would not lie on the loop: 543 guards instead of 268 on the spine at
/// epsilon 4 (3.8 steps), with as many kept vertices. From 2 on, places between loops are left too
/// coarse.
constexpr double kGrowth = 1.7;
constexpr double kRootSpacing = 0.5;  // over h
constexpr int kTightenRounds = 3;
constexpr int kRounds = 5;
constexpr std::size_t kRootsPerTask = 256;

struct Edge {
  std::int32_t a = -1, b = -1;
  std::array<std::int32_t, 2> facet{-1, -1};
  double length = 0;
  std::uint64_t word = 0;  // of the cocycle
};

struct Loop {
  double length = kInfinity;
  std::vector<std::int32_t> vertices;
};

// One sheet as a graph of its own.
class SheetGraph {
 public:
  SheetGraph(const InterfaceMesh& dense, const std::vector<std::int32_t>& facets) {
    std::vector<std::array<std::int32_t, 3>> corners;
    corners.reserve(facets.size());
    for (const auto f : facets)
      corners.push_back(dense.facets[f]);
    const LocalNumbers numbers(corners);
    vertices = numbers.vertices();
    for (auto& triple : corners)
      for (auto& v : triple)
        v = numbers(v);
    const std::vector<FacetSide> sides = sides_by_edge(corners, vertices.size());
    edges.reserve(sides.size() / 2 + vertices.size());
    edges_of_facet.assign(facets.size(), {-1, -1, -1});
    for (const auto& [a, b, place] : sides) {
      if (edges.empty() || edges.back().a != a || edges.back().b != b) {
        edges.push_back({a, b, {-1, -1}, 0, 0});
        edges.back().length = distance(dense.points[vertices[a]], dense.points[vertices[b]]);
      }
      Edge& edge = edges.back();
      const std::int32_t f = place / 3;
      edge.facet[edge.facet[0] < 0 ? 0 : 1] = f;
      auto& of_facet = edges_of_facet[f];
      *std::find(of_facet.begin(), of_facet.end(), -1) =
          static_cast<std::int32_t>(edges.size() - 1);
    }
    first.assign(vertices.size() + 1, 0);
    for (const Edge& e : edges) {
      ++first[e.a + 1];
      ++first[e.b + 1];
    }
    for (std::size_t v = 0; v < vertices.size(); ++v)
      first[v + 1] += first[v];
    incident.resize(2 * edges.size());
    auto fill = first;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      incident[fill[edges[e].a]++] = static_cast<std::int32_t>(e);
      incident[fill[edges[e].b]++] = static_cast<std::int32_t>(e);
    }
  }

  // Whether a loop along the rim counts as one that bounds nothing.
  enum class Rim { Bounds, Counts };

  // False when every loop bounds.
  bool find_cocycle(Rim rim) {
    std::vector<bool> is_in_tree = spanning_tree(rim);
    // The tree of facets grows from the rim (all of it as one node, or from one edge of it), or
    // from the first facet.
    std::vector<bool> is_facet_reached(edges_of_facet.size(), false);
    std::vector<std::int32_t> parent_edge(edges_of_facet.size(), -1), order;
    const auto reach = [&](std::int32_t f, std::int32_t through) {
      if (f < 0 || is_facet_reached[f]) return;
      is_facet_reached[f] = true;
      parent_edge[f] = through;
      if (through >= 0) is_in_tree[through] = true;
      order.push_back(f);
    };
    for (std::size_t e = 0; e < edges.size() && (rim == Rim::Bounds || order.empty()); ++e)
      if (edges[e].facet[1] < 0 && !is_in_tree[e])
        reach(edges[e].facet[0], static_cast<std::int32_t>(e));
    if (order.empty()) reach(0, -1);
    for (std::size_t q = 0; q < order.size(); ++q)
      for (const auto e : edges_of_facet[order[q]]) {
        if (is_in_tree[e]) continue;
        const auto& sides = edges[e].facet;
        reach(sides[0] == order[q] ? sides[1] : sides[0], e);
      }
    const CounterRandom random(0, "short loops");
    bool has_generator = false;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      if (is_in_tree[e]) continue;
      edges[e].word = random.bits(e) | 1;
      has_generator = true;
    }
    if (!has_generator) return false;
    // Around every facet the words cancel; from the leaves this fixes the edges of the tree.
    for (std::size_t q = order.size(); q-- > 0;) {
      const auto parent = parent_edge[order[q]];
      if (parent < 0) continue;
      std::uint64_t word = 0;
      for (const auto e : edges_of_facet[order[q]])
        if (e != parent) word ^= edges[e].word;
      edges[parent].word = word;
    }
    return true;
  }

  // A tree of edges over all vertices: breadth first, so that its paths are short; where the rim
  // counts, the edges of the rim come first, so that no other path of the tree cuts it off from
  // itself and the facets with it.
  [[nodiscard]] std::vector<bool> spanning_tree(Rim rim) const {
    std::vector<bool> is_in_tree(edges.size(), false), is_reached(vertices.size(), false);
    std::vector<std::int32_t> queue;
    const auto visit = [&](std::int32_t v) {
      if (is_reached[v]) return;
      is_reached[v] = true;
      queue.push_back(v);
      if (rim == Rim::Bounds) return;
      // The whole component of the rim at once.
      for (std::size_t q = queue.size() - 1; q < queue.size(); ++q)
        for (auto n = first[queue[q]]; n < first[queue[q] + 1]; ++n) {
          const auto w = other_end(incident[n], queue[q]);
          if (edges[incident[n]].facet[1] >= 0 || is_reached[w]) continue;
          is_reached[w] = is_in_tree[incident[n]] = true;
          queue.push_back(w);
        }
    };
    visit(0);
    for (std::size_t q = 0; q < queue.size(); ++q)
      for (auto n = first[queue[q]]; n < first[queue[q] + 1]; ++n) {
        const auto w = other_end(incident[n], queue[q]);
        if (is_reached[w]) continue;
        is_in_tree[incident[n]] = true;
        visit(w);
      }
    return is_in_tree;
  }

  [[nodiscard]] std::int32_t other_end(std::int32_t e, std::int32_t v) const {
    return edges[e].a == v ? edges[e].b : edges[e].a;
  }

  // What shortest paths read of an edge, from one of its ends.
  struct Link {
    std::int32_t to, edge;
    double length;
    std::uint64_t word;
  };

  // In the order of `incident`, so that those of a vertex stand together.
  [[nodiscard]] std::vector<Link> links() const {
    std::vector<Link> result(incident.size());
    for (std::size_t v = 0; v < vertices.size(); ++v)
      for (auto n = first[v]; n < first[v + 1]; ++n) {
        const std::int32_t e = incident[n];
        result[n] = {other_end(e, static_cast<std::int32_t>(v)), e, edges[e].length, edges[e].word};
      }
    return result;
  }

  std::vector<std::int32_t> vertices;  // dense vertex of each, ascending
  std::vector<Edge> edges;
  std::vector<std::array<std::int32_t, 3>> edges_of_facet;
  std::vector<std::int32_t> first, incident;  // edges around each vertex
};

// Shortest paths from one root, up to a limit. Used again and again: it clears what it touched.
class LocalPaths {
 public:
  /// @param links  of `graph`
  LocalPaths(const SheetGraph& graph, const std::vector<SheetGraph::Link>& links)
      : graph_(graph),
        links_(links),
        distance_(graph.vertices.size(), kInfinity),
        word_(graph.vertices.size(), 0),
        parent_(graph.vertices.size(), -1),
        is_settled_(graph.vertices.size(), 0) {}

  // The vertices within `limit` of the root.
  const std::vector<std::int32_t>& reach(std::int32_t root, double limit) {
    grow(root, limit, [](double, std::int32_t) { return true; });
    return reached_;
  }

  // The shortest loop through the root that bounds nothing, among the shortest paths up to `limit`
  // and the edges between them.
  //
  // A loop of length l closes between two vertices no farther than l / 2 from the root, because
  // their distances differ by the length of the closing edge at most. So the paths need not grow
  // beyond half of the shortest loop so far.
  [[nodiscard]] Loop shortest_loop(std::int32_t root, double limit) {
    constexpr double kHalf = 0.5 + 1e-9;  // rounding may not cost the last candidates
    double best = kInfinity;
    std::int32_t closing = -1;
    grow(root, limit, [&](double d, std::int32_t v) {
      if (d > kHalf * best) return false;
      for (auto n = graph_.first[v]; n < graph_.first[v + 1]; ++n) {
        const auto& [w, e, edge_length, word] = links_[n];
        if (is_settled_[w] == 0 || (word_[v] ^ word_[w] ^ word) == 0) continue;
        const Edge& edge = graph_.edges[e];
        const double length = distance_[edge.a] + distance_[edge.b] + edge_length;
        if (length < best || (length == best && e < closing)) {
          best = length;
          closing = e;
        }
      }
      return true;
    });
    Loop loop;
    loop.length = best;
    if (closing < 0) return loop;
    loop.vertices = path_from(graph_.edges[closing].a);
    std::reverse(loop.vertices.begin(), loop.vertices.end());
    const auto back = path_from(graph_.edges[closing].b);
    loop.vertices.insert(loop.vertices.end(), back.begin(), back.end());
    return loop;
  }

 private:
  using Item = std::pair<double, std::int32_t>;

  // Calls on_settled(distance, vertex) in ascending order until it returns false.
  template <typename OnSettled>
  void grow(std::int32_t root, double limit, const OnSettled& on_settled) {
    for (const auto v : reached_) {
      distance_[v] = kInfinity;
      is_settled_[v] = 0;
    }
    reached_.clear();
    queue_.clear();
    distance_[root] = 0;
    word_[root] = 0;
    parent_[root] = -1;
    queue_.emplace_back(0, root);
    reached_.push_back(root);
    while (!queue_.empty()) {
      const auto [d, v] = queue_.front();
      std::pop_heap(queue_.begin(), queue_.end(), std::greater<>());
      queue_.pop_back();
      if (d > distance_[v]) continue;
      is_settled_[v] = 1;
      if (!on_settled(d, v)) return;
      for (auto n = graph_.first[v]; n < graph_.first[v + 1]; ++n) {
        const auto& [w, e, length, word] = links_[n];
        const double next = d + length;
        if (next > limit || next >= distance_[w]) continue;
        if (distance_[w] == kInfinity) reached_.push_back(w);
        distance_[w] = next;
        word_[w] = word_[v] ^ word;
        parent_[w] = e;
        queue_.emplace_back(next, w);
        std::push_heap(queue_.begin(), queue_.end(), std::greater<>());
      }
    }
  }

  [[nodiscard]] std::vector<std::int32_t> path_from(std::int32_t v) const {
    std::vector<std::int32_t> path{v};
    while (parent_[v] >= 0)
      path.push_back(v = graph_.other_end(parent_[v], v));
    return path;
  }

  const SheetGraph& graph_;
  const std::vector<SheetGraph::Link>& links_;
  std::vector<double> distance_;
  std::vector<std::uint64_t> word_;
  std::vector<std::int32_t> parent_, reached_;  // parent_: edge towards the root
  std::vector<std::uint8_t> is_settled_;
  std::vector<Item> queue_;  // a heap, the nearest first
};

std::vector<std::int32_t> spread_roots(const SheetGraph& graph,
                                       const std::vector<SheetGraph::Link>& links,
                                       const std::vector<bool>& is_open,
                                       const std::vector<double>& h) {
  std::vector<bool> is_covered(graph.vertices.size(), false);
  std::vector<std::int32_t> roots;
  LocalPaths paths(graph, links);
  for (std::size_t v = 0; v < graph.vertices.size(); ++v) {
    if (is_covered[v] || !is_open[v]) continue;
    roots.push_back(static_cast<std::int32_t>(v));
    for (const auto w : paths.reach(roots.back(), kRootSpacing * h[v]))
      is_covered[w] = true;
  }
  return roots;
}

// The shortest loop near `root`, if it is too short for h there. A narrow place one root spacing
// away is seen as a loop longer by two spacings.
Loop find_short_loop(LocalPaths& paths, std::int32_t root, const std::vector<double>& h) {
  Loop loop = paths.shortest_loop(root, 0.5 * (kStepsPerLoop + 2 * kRootSpacing) * h[root]);
  for (int round = 0; round < kTightenRounds && !loop.vertices.empty(); ++round) {
    Loop best = loop;
    for (const std::size_t part : {1U, 2U, 3U}) {
      Loop other =
          paths.shortest_loop(loop.vertices[part * loop.vertices.size() / 4], 0.51 * loop.length);
      if (other.length < best.length) best = std::move(other);
    }
    if (!(best.length < loop.length)) break;
    loop = std::move(best);
  }
  return loop;
}

void limit_growth(const SheetGraph& graph,
                  const std::vector<SheetGraph::Link>& links,
                  double delta,
                  std::vector<double>& h) {
  using Item = std::pair<double, std::int32_t>;
  std::priority_queue<Item, std::vector<Item>, std::greater<>> queue;
  const auto visit_higher = [&](std::int32_t v, double value, const auto& visit) {
    for (auto n = graph.first[v]; n < graph.first[v + 1]; ++n) {
      const double bound = value + delta * links[n].length;
      if (bound < h[links[n].to]) visit(links[n].to, bound);
    }
  };
  for (std::size_t n = 0; n < h.size(); ++n) {
    const auto v = static_cast<std::int32_t>(n);
    bool is_source = false;
    visit_higher(v, h[n], [&](std::int32_t, double) { is_source = true; });
    if (is_source) queue.emplace(h[n], v);
  }
  while (!queue.empty()) {
    const auto [value, v] = queue.top();
    queue.pop();
    if (value > h[v]) continue;
    visit_higher(v, value, [&](std::int32_t w, double bound) {
      h[w] = bound;
      queue.emplace(bound, w);
    });
  }
}

// One round of roots among the open vertices.
bool lower_along_loops(const SheetGraph& graph,
                       const std::vector<SheetGraph::Link>& links,
                       const std::vector<bool>& is_open,
                       const std::vector<double>& h,
                       std::vector<double>& lowered) {
  const auto roots = spread_roots(graph, links, is_open, h);
  std::vector<Loop> loops(roots.size());
  const std::size_t tasks = (roots.size() + kRootsPerTask - 1) / kRootsPerTask;
  parallel_for_each_index(
      0, tasks,
      [&](std::size_t t) {
        LocalPaths paths(graph, links);
        const std::size_t end = std::min(roots.size(), (t + 1) * kRootsPerTask);
        for (std::size_t r = t * kRootsPerTask; r < end; ++r)
          loops[r] = find_short_loop(paths, roots[r], h);
      },
      1);
  bool is_changed = false;
  for (const Loop& loop : loops)
    for (const auto v : loop.vertices)
      if (loop.length < kStepsPerLoop * lowered[v]) {
        lowered[v] = loop.length / kStepsPerLoop;
        is_changed = true;
      }
  return is_changed;
}

// The Voronoi cells of particles along the edges of a sheet.
class Cells {
 public:
  /// @param links  of `graph`
  Cells(const SheetGraph& graph,
        const std::vector<SheetGraph::Link>& links,
        std::vector<std::int32_t> sources)
      : graph_(graph),
        distance_(graph.vertices.size(), kInfinity),
        word_(graph.vertices.size(), 0),
        owner_(graph.vertices.size(), -1) {
    std::sort(sources.begin(), sources.end());
    sources.erase(std::unique(sources.begin(), sources.end()), sources.end());
    // Without any particle the first vertex stands for the one that is missing.
    if (sources.empty()) sources.push_back(graph.vertices.front());
    std::vector<std::int32_t> seeds;
    for (const auto source : sources) {
      const auto v = static_cast<std::int32_t>(
          std::lower_bound(graph.vertices.begin(), graph.vertices.end(), source) -
          graph.vertices.begin());
      distance_[v] = 0;
      owner_[v] = v;
      seeds.push_back(v);
    }
    grow(links, std::move(seeds));
  }

  // One vertex for each cell, or pair of cells, with a loop: of the edges that show it, the end
  // farthest from its particle.
  [[nodiscard]] std::vector<std::int32_t> vertices_for_loops() const {
    std::vector<bool> is_on_rim(graph_.vertices.size(), false);
    for (const Edge& e : graph_.edges)
      if (e.facet[1] < 0) is_on_rim[e.a] = is_on_rim[e.b] = true;

    // Edges that leave a cell, or close a loop in it; those between the same two cells together.
    struct Way {
      std::int32_t from, to, edge;
      auto operator<=>(const Way&) const = default;
    };

    std::vector<Way> ways;
    for (std::size_t e = 0; e < graph_.edges.size(); ++e) {
      const auto [from, to] = std::minmax(owner_[graph_.edges[e].a], owner_[graph_.edges[e].b]);
      if (from != to || word_of(graph_.edges[e]) != 0)
        ways.push_back({from, to, static_cast<std::int32_t>(e)});
    }
    parallel_sort(ways.begin(), ways.end());

    struct Missing {
      std::int32_t from, to, vertex;
    };

    std::vector<Missing> missing;
    std::uint64_t first_word = 0;
    for (std::size_t n = 0; n < ways.size(); ++n) {
      const auto [from, to, id] = ways[n];
      const Edge& e = graph_.edges[id];
      const bool is_first = n == 0 || ways[n - 1].from != from || ways[n - 1].to != to;
      // The way from a cell to itself without leaving it has no word.
      if (is_first) first_word = from == to ? 0 : word_of(e);
      if (word_of(e) == first_word) continue;
      // The rim has its own particles, which are not for the sheet to add.
      if (is_on_rim[e.a] && is_on_rim[e.b]) continue;
      const bool takes_a = is_on_rim[e.b] || (!is_on_rim[e.a] && distance_[e.a] >= distance_[e.b]);
      const auto far = takes_a ? e.a : e.b;
      if (missing.empty() || missing.back().from != from || missing.back().to != to)
        missing.push_back({from, to, far});
      else if (distance_[far] > distance_[missing.back().vertex])
        missing.back().vertex = far;
    }
    std::vector<std::int32_t> result;
    std::set<std::int32_t> used;
    for (const auto& [from, to, v] : missing) {
      // What is added to one cell changes its neighbours, too. A particle stands on every vertex
      // of the loop when the farthest is its own: the dense surface has no more to give.
      if (distance_[v] == 0 || used.count(from) > 0 || used.count(to) > 0) continue;
      used.insert({from, to});
      result.push_back(v);
    }
    return result;
  }

 private:
  struct Arrival {
    double distance;
    std::int32_t vertex;
  };

  // All cells at the same time, by rings of distance half an edge wide, so that no heap is needed;
  // inside a ring a vertex may be reached twice. Of two particles equally far the first wins.
  void grow(const std::vector<SheetGraph::Link>& links, std::vector<std::int32_t> seeds) {
    double sum = 0;
    for (const Edge& e : graph_.edges)
      sum += e.length;
    const double width = std::max(0.5 * sum / static_cast<double>(graph_.edges.size()),
                                  std::numeric_limits<double>::min());
    std::vector<std::vector<Arrival>> rings(1);
    for (const auto v : seeds)
      rings[0].push_back({0, v});
    for (std::size_t ring = 0; ring < rings.size(); ++ring) {
      for (std::size_t q = 0; q < rings[ring].size(); ++q) {
        const auto [d, v] = rings[ring][q];
        if (d > distance_[v]) continue;
        for (auto n = graph_.first[v]; n < graph_.first[v + 1]; ++n) {
          const auto& [w, e, length, word] = links[n];
          const double next = d + length;
          if (next > distance_[w] || (next == distance_[w] && owner_[v] >= owner_[w])) continue;
          distance_[w] = next;
          owner_[w] = owner_[v];
          word_[w] = word_[v] ^ word;
          const auto at = static_cast<std::size_t>(next / width);
          if (at >= rings.size()) rings.resize(at + 1);
          rings[std::max(at, ring)].push_back({next, w});
        }
      }
      rings[ring] = {};
    }
  }

  // Of the way along an edge from the particle of one cell to that of the other.
  [[nodiscard]] std::uint64_t word_of(const Edge& e) const {
    return word_[e.a] ^ word_[e.b] ^ e.word;
  }

  const SheetGraph& graph_;
  std::vector<double> distance_;
  std::vector<std::uint64_t> word_;
  std::vector<std::int32_t> owner_;  // the vertex of the cell's particle
};

}  // namespace

std::vector<LoweredSize> sizes_at_short_loops(const InterfaceMesh& dense,
                                              const std::vector<std::int32_t>& facets,
                                              double delta,
                                              const std::vector<double>& h_mm) {
  SheetGraph graph(dense, facets);
  if (!graph.find_cocycle(SheetGraph::Rim::Bounds)) return {};
  std::vector<double> h;
  for (const auto v : graph.vertices)
    h.push_back(h_mm[v]);
  // Every loop that bounds nothing crosses an edge with a word, and these form a few cuts: roots
  // along them see all such loops.
  std::vector<bool> is_on_cut(h.size(), false);
  for (const Edge& e : graph.edges)
    if (e.word != 0) is_on_cut[e.a] = is_on_cut[e.b] = true;
  // Loops lie as far apart as their roots: between them h is still too large, but less so. Each
  // round looks closer where the last one found something.
  std::vector<bool> is_open = is_on_cut;
  const std::vector<SheetGraph::Link> links = graph.links();
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> lowered = h;
    if (!lower_along_loops(graph, links, is_open, h, lowered)) break;
    limit_growth(graph, links, kGrowth * delta, lowered);
    for (std::size_t v = 0; v < h.size(); ++v)
      is_open[v] = is_on_cut[v] && lowered[v] < h[v];
    h = std::move(lowered);
  }
  std::vector<LoweredSize> result;
  for (std::size_t v = 0; v < h.size(); ++v)
    if (h[v] < h_mm[graph.vertices[v]]) result.push_back({graph.vertices[v], h[v]});
  return result;
}

struct LoopTest::Sheet {
  SheetGraph graph;
  std::vector<SheetGraph::Link> links;
};

LoopTest::LoopTest(const InterfaceMesh& dense, const std::vector<std::int32_t>& facets) {
  SheetGraph graph(dense, facets);
  if (!graph.find_cocycle(SheetGraph::Rim::Counts)) return;
  std::vector<SheetGraph::Link> links = graph.links();
  sheet_ = std::make_unique<Sheet>(Sheet{std::move(graph), std::move(links)});
}

LoopTest::~LoopTest() = default;
LoopTest::LoopTest(LoopTest&&) noexcept = default;

std::vector<std::int32_t> LoopTest::missing(
    const std::vector<std::int32_t>& particle_vertices) const {
  std::vector<std::int32_t> result;
  if (!sheet_) return result;
  for (const auto v : Cells(sheet_->graph, sheet_->links, particle_vertices).vertices_for_loops())
    result.push_back(sheet_->graph.vertices[v]);
  return result;
}

}  // namespace cvmesh
