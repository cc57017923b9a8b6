// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/compact_interfaces.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/facet_shapes.h"
#include "cvmesh/mesh/shape_tree.h"
#include "cvmesh/pipeline/stage_names.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

using Node = std::array<std::int32_t, 3>;

// How far the surface may leave a vertex that is merged into another one, in voxels; as far again
// where its neighbours are merged after it.
constexpr double kMostSagVox = 0.02;
// Least cosine between a facet's normals before and after.
constexpr double kLeastCosine = 0.9;
// Least height of a facet over its longest side, where it was not lower before. Much of what is low
// goes when the vertices at its short side are merged in their turn: with 0.1, half of all stay.
constexpr double kLeastHeight = 0.03;

// A vertex that may be merged, with the lattice node that it is next to.
struct Member {
  std::uint8_t colour = 0;
  Node node{};
  std::int32_t vertex = -1;

  [[nodiscard]] auto key() const { return std::tie(colour, node, vertex); }
};

// Of a node: a bit for the parity of each axis. The vertices around two nodes of one colour have no
// facet in common.
std::uint8_t colour_of(const Node& node) {
  return static_cast<std::uint8_t>((node[0] & 1) | (node[1] & 1) << 1 | (node[2] & 1) << 2);
}

constexpr std::uint8_t kColours = 8;

double height_over_side(const Vec3& p, const Vec3& q, const Vec3& r) {
  const double longest2 = std::max({squared_norm(q - p), squared_norm(r - q), squared_norm(p - r)});
  return norm(area_vector2(p, q, r)) / longest2;
}

// Merges vertices cluster by cluster, a cluster being those next to one node. Clusters go by their
// colours. What comes of one depends on what has come of those around it with a lower colour, and
// on nothing else: those of a colour are worked on in parallel, and where some are barred later on,
// only these and what depends on them is done again.
class Compactor {
 public:
  Compactor(const InterfaceMesh& mesh, const GridFrame& frame)
      : mesh_(mesh),
        frame_(frame),
        stars_(find_vertex_stars(mesh)),
        merged_into_(mesh.points.size()),
        position_(mesh.points) {
    collect_members();
    collect_clusters();
    parallel_for_each_index(0, merged_into_.size(),
                            [&](std::size_t v) { merged_into_[v] = static_cast<std::int32_t>(v); });
  }

  /// Merges what is not barred in all clusters that are due: at first all of them.
  void merge() {
    tbb::enumerable_thread_specific<Scratch> scratch;
    for (std::size_t colour = 0; colour < kColours; ++colour) {
      std::vector<std::uint32_t> due;
      for (std::size_t c = first_of_colour_[colour]; c < first_of_colour_[colour + 1]; ++c)
        if (is_due_[c] != 0) due.push_back(static_cast<std::uint32_t>(c));
      parallel_for_each_index(
          0, due.size(), [&](std::size_t n) { merge_cluster(due[n], scratch.local()); }, 64);
    }
  }

  /// The facets that are left, by the old numbers of their vertices; of those around clusters that
  /// were due `is_new` is set.
  void collect_facets(InterfaceMesh& compact, std::vector<char>& is_new) const {
    compact.points = position_;
    compact.facets.clear();
    compact.patch_of.clear();
    is_new.clear();
    for (std::size_t f = 0; f < mesh_.facets.size(); ++f) {
      const auto& [a, b, c] = mesh_.facets[f];
      const VertexTriple corners{merged_into_[a], merged_into_[b], merged_into_[c]};
      if (is_gone(corners)) continue;
      compact.facets.push_back(corners);
      compact.patch_of.push_back(mesh_.patch_of[f]);
      is_new.push_back(was_due(a) || was_due(b) || was_due(c) ? 1 : 0);
    }
  }

  /// Leaves alone what is around the nodes of these vertices from now on, and makes due what
  /// depends on it; false where nothing is merged there.
  bool bar(const std::vector<std::int32_t>& vertices) {
    std::vector<std::uint32_t> barred;
    for (const std::int32_t v : vertices) {
      const std::int32_t c = cluster_of_[v];
      if (c >= 0 && is_barred_[c] == 0) barred.push_back(static_cast<std::uint32_t>(c));
      if (c >= 0) is_barred_[c] = 1;
    }
    std::fill(is_due_.begin(), is_due_.end(), char{0});
    for (const std::uint32_t c : barred)
      is_due_[c] = 1;
    for (std::size_t c = 0; c < clusters_.size(); ++c)  // by colour: each before what depends on it
      if (is_due_[c] != 0) make_dependent_due(c);
    return !barred.empty();
  }

  /// Where the merged vertices were, each with the nearest of the facets around what it went into.
  /// @param compact  from `collect_facets`
  [[nodiscard]] std::vector<FacetSample> samples(const InterfaceMesh& compact) const {
    const VertexStars stars = find_vertex_stars(compact);
    const FacetShapes shapes{compact};
    std::vector<std::int32_t> facet_of(mesh_.points.size(), -1);
    parallel_for_each_index(0, facet_of.size(), [&](std::size_t v) {
      const std::int32_t own = merged_into_[v];
      if (position_[own] == mesh_.points[v]) return;
      double least = std::numeric_limits<double>::infinity();
      for (auto i = stars.first[own]; i < stars.first[own + 1]; ++i) {
        const double d2 = shapes.squared_distance(stars.facet[i], mesh_.points[v]);
        if (d2 >= least) continue;
        least = d2;
        facet_of[v] = stars.facet[i];
      }
    });
    std::vector<FacetSample> samples;
    for (std::size_t v = 0; v < facet_of.size(); ++v)
      if (facet_of[v] >= 0) samples.push_back({facet_of[v], mesh_.points[v]});
    return samples;
  }

  [[nodiscard]] std::size_t barred() const {
    return static_cast<std::size_t>(std::count(is_barred_.begin(), is_barred_.end(), char{1}));
  }

 private:
  struct Cluster {
    std::size_t begin, end;  // of its members
  };

  // What one thread needs while it merges.
  struct Scratch {
    std::uint8_t colour = 0;                // of the cluster
    std::vector<std::int32_t> rest, group;  // its vertices to be looked at, those merged into one
    std::vector<std::int32_t> around_group, around_vertex, common, sum;
    std::vector<std::int32_t> facets, left;  // those of the group, of these those that are left
  };

  // On an edge of the lattice a vertex is nearer to one of its two nodes in every axis. In the
  // layer before the box, where nodes stand closer, rounding would not find it.
  void collect_members() {
    std::vector<char> is_free(mesh_.points.size());
    parallel_for_each_index(0, is_free.size(), [&](std::size_t v) { is_free[v] = may_merge(v); });
    for (std::size_t v = 0; v < is_free.size(); ++v) {
      if (is_free[v] == 0) continue;
      const Node node = node_of(v);
      members_.push_back({colour_of(node), node, static_cast<std::int32_t>(v)});
    }
    parallel_sort(members_.begin(), members_.end(),
                  [](const Member& a, const Member& b) { return a.key() < b.key(); });
  }

  [[nodiscard]] bool may_merge(std::size_t v) const {
    const PatchKey& patch = mesh_.patch_of[stars_.facet[stars_.first[v]]];
    for (auto i = stars_.first[v]; i < stars_.first[v + 1]; ++i)
      if (!(mesh_.patch_of[stars_.facet[i]] == patch)) return false;
    const Vec3 index = frame_.mm_to_index(mesh_.points[v]);
    for (int axis = 0; axis < 3; ++axis)
      if (index[axis] < 0 || index[axis] > frame_.dims[axis] - 1) return false;
    return patch.wall == 0;
  }

  [[nodiscard]] Node node_of(std::size_t v) const {
    const Vec3 index = frame_.mm_to_index(mesh_.points[v]);
    return {static_cast<std::int32_t>(index.x + 0.5), static_cast<std::int32_t>(index.y + 0.5),
            static_cast<std::int32_t>(index.z + 0.5)};
  }

  void collect_clusters() {
    cluster_of_.assign(mesh_.points.size(), -1);
    colour_of_vertex_.assign(mesh_.points.size(), 0);
    for (std::size_t begin = 0, end = 0; begin < members_.size(); begin = end) {
      for (; end < members_.size() && members_[end].node == members_[begin].node; ++end) {
        cluster_of_[members_[end].vertex] = static_cast<std::int32_t>(clusters_.size());
        colour_of_vertex_[members_[end].vertex] = members_[end].colour;
      }
      clusters_.push_back({begin, end});
    }
    is_due_.assign(clusters_.size(), 1);
    is_barred_.assign(clusters_.size(), 0);
    for (std::uint8_t colour = 0; colour <= kColours; ++colour)
      first_of_colour_[colour] = first_cluster(colour, {});
  }

  // The first cluster of a colour with this node or a later one.
  [[nodiscard]] std::size_t first_cluster(std::uint8_t colour, const Node& node) const {
    const auto it =
        std::partition_point(clusters_.begin(), clusters_.end(), [&](const Cluster& cluster) {
          const Member& member = members_[cluster.begin];
          return std::tie(member.colour, member.node) < std::tie(colour, node);
        });
    return static_cast<std::size_t>(it - clusters_.begin());
  }

  void make_dependent_due(std::size_t c) {
    const Member& own = members_[clusters_[c].begin];
    for (std::int32_t n = 0; n < 27; ++n) {
      const Node node{own.node[0] + n % 3 - 1, own.node[1] + n / 3 % 3 - 1,
                      own.node[2] + n / 9 - 1};
      const std::uint8_t colour = colour_of(node);
      if (colour <= own.colour) continue;
      const std::size_t other = first_cluster(colour, node);
      if (other < clusters_.size() && members_[clusters_[other].begin].node == node)
        is_due_[other] = 1;
    }
  }

  [[nodiscard]] bool was_due(std::int32_t v) const {
    return cluster_of_[v] >= 0 && is_due_[cluster_of_[v]] != 0;
  }

  // --- as a cluster sees it: what has a higher colour is not merged yet --------------------------

  [[nodiscard]] std::int32_t seen(std::int32_t v, std::uint8_t colour) const {
    return colour_of_vertex_[v] > colour ? v : merged_into_[v];
  }

  [[nodiscard]] VertexTriple seen_corners(std::int32_t f, std::uint8_t colour) const {
    const auto& [a, b, c] = mesh_.facets[f];
    return {seen(a, colour), seen(b, colour), seen(c, colour)};
  }

  [[nodiscard]] const Vec3& seen_at(std::int32_t v, std::uint8_t colour) const {
    return colour_of_vertex_[v] > colour ? mesh_.points[v] : position_[v];
  }

  static bool is_gone(const VertexTriple& t) {
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
  }

  // --- merging -----------------------------------------------------------------------------------

  void merge_cluster(std::size_t c, Scratch& scratch) {
    const Cluster& cluster = clusters_[c];
    scratch.colour = members_[cluster.begin].colour;
    scratch.rest.clear();
    for (std::size_t m = cluster.begin; m < cluster.end; ++m)
      scratch.rest.push_back(members_[m].vertex);
    take_apart(scratch.rest);
    if (is_barred_[c] != 0) return;
    while (scratch.rest.size() > 1) {
      grow_group(scratch);
      if (scratch.group.size() == 1) continue;
      collect_star(scratch);
      if (!place(scratch) || !is_good_star(scratch)) take_apart(scratch.group);
    }
  }

  void take_apart(const std::vector<std::int32_t>& vertices) {
    for (const std::int32_t v : vertices) {
      merged_into_[v] = v;
      position_[v] = mesh_.points[v];
    }
  }

  // Takes the first of the rest, and contracts edges to others as long as that is possible.
  void grow_group(Scratch& scratch) {
    std::vector<std::int32_t>&rest = scratch.rest, &group = scratch.group;
    group.assign(1, rest.front());
    rest.erase(rest.begin());
    find_neighbours(group.front(), scratch.colour, scratch.around_group);
    for (std::size_t n = 0; n < rest.size();) {
      if (!can_contract(rest[n], scratch)) {
        ++n;
        continue;
      }
      const std::int32_t v = rest[n], own = group.front();
      std::vector<std::int32_t>& sum = scratch.sum;
      sum.clear();
      std::set_union(scratch.around_group.begin(), scratch.around_group.end(),
                     scratch.around_vertex.begin(), scratch.around_vertex.end(),
                     std::back_inserter(sum));
      sum.erase(std::remove_if(sum.begin(), sum.end(),
                               [&](std::int32_t w) { return w == v || w == own; }),
                sum.end());
      std::swap(scratch.around_group, sum);
      merged_into_[v] = own;
      group.push_back(v);
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(n));
      n = 0;  // some that were no neighbours are now
    }
  }

  // The link condition for two vertices inside a patch: the neighbours that they share are the two
  // across from their edge. And four at least are left around them.
  [[nodiscard]] bool can_contract(std::int32_t v, Scratch& scratch) const {
    const std::vector<std::int32_t>& around = scratch.around_group;
    if (!std::binary_search(around.begin(), around.end(), v)) return false;
    find_neighbours(v, scratch.colour, scratch.around_vertex);
    scratch.common.clear();
    std::set_intersection(around.begin(), around.end(), scratch.around_vertex.begin(),
                          scratch.around_vertex.end(), std::back_inserter(scratch.common));
    return scratch.common.size() == 2 && around.size() + scratch.around_vertex.size() >= 8;
  }

  // The vertices around one that nothing is merged into; ascending.
  void find_neighbours(std::int32_t v,
                       std::uint8_t colour,
                       std::vector<std::int32_t>& neighbours) const {
    neighbours.clear();
    for (auto i = stars_.first[v]; i < stars_.first[v + 1]; ++i) {
      const VertexTriple corners = seen_corners(stars_.facet[i], colour);
      if (is_gone(corners)) continue;
      for (const std::int32_t w : corners)
        if (w != v) neighbours.push_back(w);
    }
    std::sort(neighbours.begin(), neighbours.end());
    neighbours.erase(std::unique(neighbours.begin(), neighbours.end()), neighbours.end());
  }

  // The facets around the vertices of the group as the clusters before have left them, and those
  // that are left of them.
  void collect_star(Scratch& scratch) const {
    std::vector<std::int32_t>&facets = scratch.facets, &left = scratch.left;
    facets.clear();
    for (const std::int32_t v : scratch.group)
      facets.insert(facets.end(), stars_.facet.begin() + stars_.first[v],
                    stars_.facet.begin() + stars_.first[v + 1]);
    std::sort(facets.begin(), facets.end());
    facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
    left.clear();
    for (const std::int32_t f : facets)
      if (!is_gone(seen_corners(f, scratch.colour))) left.push_back(f);
  }

  // A facet's corners before the group was merged.
  [[nodiscard]] std::array<Vec3, 3> corners_before(std::int32_t f, const Scratch& scratch) const {
    std::array<Vec3, 3> p;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::int32_t v = mesh_.facets[f][c];
      p[c] = merged_into_[v] == scratch.group.front()
                 ? mesh_.points[v]
                 : seen_at(seen(v, scratch.colour), scratch.colour);
    }
    return p;
  }

  [[nodiscard]] std::array<Vec3, 3> corners_now(std::int32_t f, std::uint8_t colour) const {
    const auto [a, b, c] = seen_corners(f, colour);
    return {seen_at(a, colour), seen_at(b, colour), seen_at(c, colour)};
  }

  // Puts the merged vertex where the volumes stay as they were, along the mean normal from the mean
  // of what went into it.
  bool place(const Scratch& scratch) {
    const std::int32_t own = scratch.group.front();
    Vec3 mean;
    for (const std::int32_t v : scratch.group)
      mean += mesh_.points[v] / static_cast<double>(scratch.group.size());
    double volume6 = 0;  // between the mean and the facets as they were
    for (const std::int32_t f : scratch.facets) {
      const auto [a, b, c] = corners_before(f, scratch);
      volume6 += dot(a - mean, cross(b - mean, c - mean));
    }
    position_[own] = mean;
    Vec3 area2;  // of the facets to be, wherever the vertex is
    for (const std::int32_t f : scratch.left) {
      const auto [a, b, c] = corners_now(f, scratch.colour);
      area2 += area_vector2(a, b, c);
    }
    if (!(squared_norm(area2) > 0)) return false;
    position_[own] = mean + (volume6 / squared_norm(area2)) * area2;
    return true;
  }

  // Whether the facets around the merged vertex will do, and are near to all that went into it.
  [[nodiscard]] bool is_good_star(const Scratch& scratch) const {
    double least = kLeastHeight;
    for (const std::int32_t f : scratch.facets) {
      const auto [a, b, c] = corners_before(f, scratch);
      if (!(a == b || b == c || c == a)) least = std::min(least, height_over_side(a, b, c));
    }
    return std::all_of(scratch.left.begin(), scratch.left.end(),
                       [&](std::int32_t f) { return is_good_facet(f, least, scratch.colour); }) &&
           std::all_of(scratch.group.begin(), scratch.group.end(),
                       [&](std::int32_t v) { return is_near(mesh_.points[v], scratch); });
  }

  // Whether a facet is well shaped, has not turned far, and has the nodes next to its corners on
  // the sides where they were.
  [[nodiscard]] bool is_good_facet(std::int32_t f, double least, std::uint8_t colour) const {
    const auto& old = mesh_.facets[f];
    const auto [p, q, r] = corners_now(f, colour);
    const Vec3 before =
        area_vector2(mesh_.points[old[0]], mesh_.points[old[1]], mesh_.points[old[2]]);
    const Vec3 after = area_vector2(p, q, r);
    if (!(dot(before, after) >= kLeastCosine * norm(before) * norm(after))) return false;
    if (height_over_side(p, q, r) < least) return false;
    return std::all_of(old.begin(), old.end(), [&](std::int32_t v) {
      if (cluster_of_[v] < 0) return true;
      const auto [i, j, k] = node_of(static_cast<std::size_t>(v));
      const Vec3 node = frame_.index_to_mm({double(i), double(j), double(k)});
      return dot(before, node - mesh_.points[old[0]]) * dot(after, node - p) > 0;
    });
  }

  [[nodiscard]] bool is_near(const Vec3& point, const Scratch& scratch) const {
    const double most_mm = kMostSagVox * frame_.voxel_mm();
    return std::any_of(scratch.left.begin(), scratch.left.end(), [&](std::int32_t f) {
      const auto [a, b, c] = corners_now(f, scratch.colour);
      return squared_norm(point - nearest_on_triangle(point, a, b, c)) <= most_mm * most_mm;
    });
  }

  const InterfaceMesh& mesh_;
  const GridFrame& frame_;
  VertexStars stars_;
  std::vector<Member> members_;    // by colour, then by node
  std::vector<Cluster> clusters_;  // in the same order
  std::array<std::size_t, kColours + 1> first_of_colour_{};
  std::vector<char> is_due_, is_barred_;        // by cluster
  std::vector<std::int32_t> cluster_of_;        // by vertex; -1: it may not be merged
  std::vector<std::uint8_t> colour_of_vertex_;  // 0 where there is no cluster
  std::vector<std::int32_t> merged_into_;       // by vertex: itself, or what it went into
  std::vector<Vec3> position_;
};

// Some facets of a mesh, as a `ShapeTree` wants them.
struct SomeFacets {
  const InterfaceMesh& mesh;
  std::vector<std::uint32_t> facets;

  [[nodiscard]] std::size_t size() const { return facets.size(); }

  [[nodiscard]] Box3 box(std::size_t n) const {
    return box_of(mesh.points, mesh.facets[facets[n]]);
  }
};

// The vertices of facets that intersect or are nearer to each other than the clearance, one of each
// two being new.
std::vector<std::int32_t> find_crowded(const InterfaceMesh& mesh,
                                       const std::vector<char>& is_new,
                                       double clearance_mm) {
  SomeFacets some{mesh, {}};
  for (std::size_t f = 0; f < is_new.size(); ++f)
    if (is_new[f] != 0) some.facets.push_back(static_cast<std::uint32_t>(f));
  const ShapeTree<SomeFacets> tree(some);
  // Facets lie along a curve: a few that follow each other share a part of the tree.
  constexpr std::size_t kChunk = 32;
  const double clearance2 = clearance_mm * clearance_mm;
  std::vector<std::vector<std::int32_t>> found((mesh.facets.size() + kChunk - 1) / kChunk);
  tbb::enumerable_thread_specific<ShapeTree<SomeFacets>::Region> regions;
  parallel_for_each_index(
      0, found.size(),
      [&](std::size_t chunk) {
        const std::size_t begin = chunk * kChunk,
                          end = std::min(mesh.facets.size(), begin + kChunk);
        Box3 all;
        for (std::size_t f = begin; f < end; ++f)
          for (const std::int32_t v : mesh.facets[f])
            all.add(mesh.points[v]);
        auto& region = regions.local();
        tree.find_region(all, clearance_mm, region);
        for (std::size_t f = begin; f < end; ++f) {
          const VertexTriple& s = mesh.facets[f];
          tree.for_each_near(region, box_of(mesh.points, s), clearance2, [&](std::uint32_t n) {
            const std::uint32_t g = some.facets[n];
            const VertexTriple& t = mesh.facets[g];
            if (g == f || (g < f && is_new[f] != 0)) return clearance2;  // each two once
            if (!are_facets_apart(mesh.points, s, t, clearance_mm) &&
                (facets_intersect(mesh.points, s, t) ||
                 are_facets_near(mesh.points, s, t, clearance_mm))) {
              found[chunk].insert(found[chunk].end(), s.begin(), s.end());
              found[chunk].insert(found[chunk].end(), t.begin(), t.end());
            }
            return clearance2;
          });
        }
      },
      16);
  std::vector<std::int32_t> vertices;
  for (const auto& of_chunk : found)
    vertices.insert(vertices.end(), of_chunk.begin(), of_chunk.end());
  return vertices;
}

// Drops the points that no facet has.
void drop_unused_points(InterfaceMesh& mesh) {
  std::vector<std::int32_t> number(mesh.points.size(), -1);
  for (const auto& facet : mesh.facets)
    for (const std::int32_t v : facet)
      number[v] = 0;
  std::int32_t count = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] < 0) continue;
    mesh.points[count] = mesh.points[v];
    number[v] = count++;
  }
  mesh.points.resize(count);
  mesh.points.shrink_to_fit();
  for (auto& facet : mesh.facets)
    for (std::int32_t& v : facet)
      v = number[v];
}

}  // namespace

CompactInterfaces compact_interfaces(const InterfaceMesh& mesh,
                                     const GridFrame& frame,
                                     double clearance_mm,
                                     const StageContext& context) {
  Compactor compactor(mesh, frame);
  CompactInterfaces result;
  std::vector<char> is_new;
  // What is still near to each other where nothing is merged was so before: the loop ends.
  do {
    compactor.merge();
    compactor.collect_facets(result.mesh, is_new);
    report_progress(context, stage_names::kDenseSurfaces, 1);
  } while (compactor.bar(find_crowded(result.mesh, is_new, clearance_mm)));
  result.samples = compactor.samples(result.mesh);
  drop_unused_points(result.mesh);
  result.stats = {mesh.points.size() - result.mesh.points.size(), compactor.barred()};
  return result;
}

}  // namespace cvmesh
