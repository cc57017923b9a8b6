// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tet_partition.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

namespace cvmesh {
namespace {

using Tet = std::array<std::int32_t, 4>;

constexpr std::int32_t kNone = -1, kShared = -2;

/// The tets in groups that halving across the longest side gives, each ascending.
std::vector<std::vector<std::int32_t>> halve(const TetMesh& whole, std::size_t most_tets) {
  std::vector<Vec3> centroids(whole.tets.size());
  parallel_for_each_index(0, centroids.size(), [&](std::size_t t) {
    for (const std::int32_t v : whole.tets[t])
      centroids[t] += whole.points[v] / 4;
  });
  std::vector<std::vector<std::int32_t>> done, open(1);
  open[0].resize(whole.tets.size());
  std::iota(open[0].begin(), open[0].end(), 0);
  while (!open.empty()) {
    std::vector<std::int32_t> group = std::move(open.back());
    open.pop_back();
    if (group.size() <= most_tets) {
      std::sort(group.begin(), group.end());
      done.push_back(std::move(group));
      continue;
    }
    Box3 box;
    for (const std::int32_t t : group)
      box.add(centroids[t]);
    const Vec3 size = box.hi - box.lo;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const auto middle = group.begin() + static_cast<std::ptrdiff_t>(group.size() / 2);
    std::nth_element(group.begin(), middle, group.end(), [&](std::int32_t s, std::int32_t t) {
      return std::pair(centroids[s][axis], s) < std::pair(centroids[t][axis], t);
    });
    open.emplace_back(middle, group.end());
    open.emplace_back(group.begin(), middle);
  }
  return done;
}

/// The part of each vertex: kShared where several have it, kNone where no tet has.
std::vector<std::int32_t> find_parts(const TetMesh& whole,
                                     const std::vector<std::vector<std::int32_t>>& groups) {
  std::vector<std::int32_t> part_of(whole.points.size(), kNone);
  for (std::size_t part = 0; part < groups.size(); ++part)
    for (const std::int32_t t : groups[part])
      for (const std::int32_t v : whole.tets[t]) {
        std::int32_t& here = part_of[v];
        here = here == kNone || here == static_cast<std::int32_t>(part)
                   ? static_cast<std::int32_t>(part)
                   : kShared;
      }
  return part_of;
}

/// Facets of the surface by their smallest vertex.
class FacetsByVertex {
 public:
  explicit FacetsByVertex(const InterfaceMesh& surface)
      : begin_(surface.points.size() + 1, 0), facets_(surface.facets.size()) {
    const auto least = [&](std::size_t f) {
      return static_cast<std::size_t>(
          *std::min_element(surface.facets[f].begin(), surface.facets[f].end()));
    };
    for (std::size_t f = 0; f < facets_.size(); ++f)
      ++begin_[least(f) + 1];
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    std::vector<std::size_t> next = begin_;
    for (std::size_t f = 0; f < facets_.size(); ++f)
      facets_[next[least(f)]++] = static_cast<std::int32_t>(f);
  }

  template <typename Visit>
  void visit(std::int32_t v, const Visit& visit) const {
    for (std::size_t i = begin_[v]; i < begin_[static_cast<std::size_t>(v) + 1]; ++i)
      visit(facets_[i]);
  }

 private:
  std::vector<std::size_t> begin_;
  std::vector<std::int32_t> facets_;
};

/// The part of these tets.
TetPartition::Part cut_out(const TetMesh& whole,
                           const std::vector<std::int32_t>& tets,
                           const std::vector<std::int32_t>& part_of,
                           const FacetsByVertex& facets_by_vertex) {
  TetPartition::Part part;
  const auto surface_count = static_cast<std::int32_t>(whole.surface.points.size());
  const auto comes_first = [&](std::int32_t v) {
    return v < surface_count || part_of[v] == kShared;
  };
  std::vector<std::int32_t> inner;
  for (const std::int32_t t : tets)
    for (const std::int32_t v : whole.tets[t])
      (comes_first(v) ? part.whole_of : inner).push_back(v);
  for (std::vector<std::int32_t>* vertices : {&part.whole_of, &inner}) {
    std::sort(vertices->begin(), vertices->end());
    vertices->erase(std::unique(vertices->begin(), vertices->end()), vertices->end());
  }
  const auto place_in = [](const std::vector<std::int32_t>& vertices, std::int32_t v) {
    const auto place = std::lower_bound(vertices.begin(), vertices.end(), v);
    return place != vertices.end() && *place == v
               ? static_cast<std::int32_t>(place - vertices.begin())
               : kNone;
  };
  const auto numbered = [&](auto simplex) {
    for (std::int32_t& v : simplex)
      v = comes_first(v) ? place_in(part.whole_of, v)
                         : static_cast<std::int32_t>(part.whole_of.size()) + place_in(inner, v);
    return simplex;
  };

  TetMesh& mesh = part.mesh;
  for (const std::int32_t v : part.whole_of) {
    mesh.points.push_back(whole.points[v]);
    part.is_frozen.push_back(part_of[v] == kShared);
  }
  mesh.surface.points = mesh.points;
  for (const std::int32_t v : inner)
    mesh.points.push_back(whole.points[v]);
  for (const std::int32_t t : tets) {
    mesh.tets.push_back(numbered(whole.tets[t]));
    mesh.material_of.push_back(whole.material_of[t]);
  }
  for (const std::int32_t v : part.whole_of) {
    if (v >= surface_count) break;
    facets_by_vertex.visit(v, [&](std::int32_t f) {
      const auto facet = numbered(whole.surface.facets[f]);
      if (std::find(facet.begin(), facet.end(), kNone) != facet.end()) return;
      part.facets.push_back(f);
      mesh.surface.facets.push_back(facet);
      mesh.surface.patch_of.push_back(whole.surface.patch_of[f]);
    });
  }
  return part;
}

}  // namespace

TetPartition::TetPartition(const TetMesh& whole, std::size_t most_tets) {
  const std::vector<std::vector<std::int32_t>> groups = halve(whole, most_tets);
  const std::vector<std::int32_t> part_of = find_parts(whole, groups);
  for (std::size_t v = 0; v < part_of.size(); ++v)
    if (part_of[v] == kShared) shared_.push_back(static_cast<std::int32_t>(v));
  const FacetsByVertex facets_by_vertex(whole.surface);
  parts.resize(groups.size());
  parallel_for_each_index(
      0, groups.size(),
      [&](std::size_t p) { parts[p] = cut_out(whole, groups[p], part_of, facets_by_vertex); }, 1);
}

std::vector<std::int32_t> TetPartition::join(TetMesh& whole) {
  const std::size_t surface_count = whole.surface.points.size();
  std::vector<Vec3> points = whole.surface.points;
  std::vector<std::int32_t> number(whole.points.size(), kNone), on_cuts;
  std::iota(number.begin(), number.begin() + static_cast<std::ptrdiff_t>(surface_count), 0);
  for (const std::int32_t v : shared_) {
    if (static_cast<std::size_t>(v) >= surface_count) {
      number[v] = static_cast<std::int32_t>(points.size());
      points.push_back(whole.points[v]);
    }
    on_cuts.push_back(number[v]);
  }
  whole.tets.clear();
  whole.material_of.clear();
  for (Part& part : parts) {
    const std::size_t given = part.whole_of.size(), before = points.size();
    const auto numbered = [&](auto simplex) {
      for (std::int32_t& v : simplex)
        v = static_cast<std::size_t>(v) < given
                ? number[part.whole_of[v]]
                : static_cast<std::int32_t>(before + static_cast<std::size_t>(v) - given);
      return simplex;
    };
    points.insert(points.end(), part.mesh.points.begin() + static_cast<std::ptrdiff_t>(given),
                  part.mesh.points.end());
    for (const Tet& tet : part.mesh.tets)
      whole.tets.push_back(numbered(tet));
    whole.material_of.insert(whole.material_of.end(), part.mesh.material_of.begin(),
                             part.mesh.material_of.end());
    // A facet that several parts have is in all of them as it was.
    for (std::size_t f = 0; f < part.facets.size(); ++f)
      whole.surface.facets[part.facets[f]] = numbered(part.mesh.surface.facets[f]);
    part = {};
  }
  parts.clear();
  whole.points = std::move(points);
  return on_cuts;
}

}  // namespace cvmesh
