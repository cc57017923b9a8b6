// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/second_order.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/facet_shapes.h"
#include "cvmesh/mesh/shape_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr const char* kStage = "second-order nodes";
/// Corners of the edges, in the order of `TetMesh::mid_of`.
constexpr std::size_t kEdges[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
constexpr double kLeastJacobian = 0.1;
constexpr int kHalvings = 4;
/// A node moves by no more than this part of its edge: beyond, the dense surface bends away too
/// much for one curved edge.
constexpr double kMostShift = 0.25;

using Edge = std::pair<std::int32_t, std::int32_t>;

/// Which interfaces meet along an edge of a surface, ascending and each once.
using Patches = std::vector<PatchKey>;

/// The edges of a surface with their patches, ascending by edge.
std::vector<std::pair<Edge, Patches>> edges_with_patches(const InterfaceMesh& surface) {
  std::vector<std::pair<Edge, PatchKey>> sides;
  sides.reserve(3 * surface.facets.size());
  for (std::size_t f = 0; f < surface.facets.size(); ++f)
    for (std::size_t k = 0; k < 3; ++k)
      sides.emplace_back(std::minmax(surface.facets[f][k], surface.facets[f][(k + 1) % 3]),
                         surface.patch_of[f]);
  parallel_sort(sides.begin(), sides.end());
  std::vector<std::pair<Edge, Patches>> edges;
  for (const auto& [edge, patch] : sides) {
    if (edges.empty() || edges.back().first != edge) edges.emplace_back(edge, Patches{});
    Patches& patches = edges.back().second;
    if (patches.empty() || patches.back() != patch) patches.push_back(patch);
  }
  return edges;
}

/// Edges on curves, for a search tree.
struct CurveEdges {
  const InterfaceMesh& mesh;
  std::vector<std::pair<Edge, Patches>> edges;

  [[nodiscard]] std::size_t size() const { return edges.size(); }

  [[nodiscard]] Box3 box(std::size_t e) const {
    Box3 box;
    box.add(mesh.points[edges[e].first.first]);
    box.add(mesh.points[edges[e].first.second]);
    return box;
  }

  [[nodiscard]] Vec3 nearest(std::size_t e, const Vec3& p) const {
    const Vec3 a = mesh.points[edges[e].first.first];
    const Vec3 along = mesh.points[edges[e].first.second] - a;
    const double length2 = squared_norm(along);
    const double s = length2 > 0 ? std::clamp(dot(p - a, along) / length2, 0.0, 1.0) : 0;
    return a + s * along;
  }

  [[nodiscard]] double squared_distance(std::size_t e, const Vec3& p) const {
    return squared_norm(p - nearest(e, p));
  }
};

/// The dense surface as the target of mid nodes.
class DenseSurface {
 public:
  explicit DenseSurface(const InterfaceMesh& dense)
      : facets_{dense},
        curves_{dense, curve_edges(dense)},
        facet_tree_(facets_),
        curve_tree_(curves_) {}

  /// The nearest point on the dense surface where `patches` meet; `p` itself where there is none,
  /// and on the border of the image.
  [[nodiscard]] Vec3 nearest(const Vec3& p, const Patches& patches) const {
    if (std::any_of(patches.begin(), patches.end(), [](const auto& k) { return k.wall != 0; }))
      return p;
    if (patches.size() == 1) {
      const auto hit = facet_tree_.nearest(
          p, -1, [&](std::size_t f) { return facets_.mesh.patch_of[f] == patches[0]; });
      return hit.shape < 0 ? p : facets_.nearest(static_cast<std::size_t>(hit.shape), p);
    }
    const auto hit = curve_tree_.nearest(
        p, -1, [&](std::size_t e) { return curves_.edges[e].second == patches; });
    return hit.shape < 0 ? p : curves_.nearest(static_cast<std::size_t>(hit.shape), p);
  }

 private:
  static std::vector<std::pair<Edge, Patches>> curve_edges(const InterfaceMesh& dense) {
    auto edges = edges_with_patches(dense);
    std::erase_if(edges, [](const auto& edge) { return edge.second.size() < 2; });
    return edges;
  }

  FacetShapes facets_;
  CurveEdges curves_;
  ShapeTree<FacetShapes> facet_tree_;
  ShapeTree<CurveEdges> curve_tree_;
};

Vec3 middle_of(const TetMesh& mesh, const Edge& edge) {
  return (mesh.points[edge.first] + mesh.points[edge.second]) / 2;
}

/// Numbers the edges of all tets, ascending by their corners.
std::vector<Edge> number_edges(TetMesh& mesh) {
  std::vector<Edge> edges(6 * mesh.tets.size());
  parallel_for_each_index(0, mesh.tets.size(), [&](std::size_t t) {
    for (std::size_t e = 0; e < 6; ++e)
      edges[6 * t + e] = std::minmax(mesh.tets[t][kEdges[e][0]], mesh.tets[t][kEdges[e][1]]);
  });
  std::vector<Edge> numbered = edges;
  parallel_sort(numbered.begin(), numbered.end());
  numbered.erase(std::unique(numbered.begin(), numbered.end()), numbered.end());
  mesh.mid_of.resize(mesh.tets.size());
  parallel_for_each_index(0, mesh.tets.size(), [&](std::size_t t) {
    for (std::size_t e = 0; e < 6; ++e)
      mesh.mid_of[t][e] = static_cast<std::int32_t>(
          std::lower_bound(numbered.begin(), numbered.end(), edges[6 * t + e]) - numbered.begin());
  });
  return numbered;
}

double least_jacobian_of(const TetMesh& mesh, std::size_t t) {
  std::array<Vec3, 4> corners;
  std::array<Vec3, 6> mids;
  for (std::size_t k = 0; k < 4; ++k)
    corners[k] = mesh.points[mesh.tets[t][k]];
  for (std::size_t e = 0; e < 6; ++e)
    mids[e] = mesh.mid_points[mesh.mid_of[t][e]];
  return least_jacobian(corners, mids);
}

/// Moves the nodes of surface edges onto the dense surface, as far as the tets allow.
void curve(TetMesh& mesh,
           const std::vector<Edge>& edges,
           const InterfaceMesh& dense,
           const StageContext& context,
           SecondOrderStats& stats) {
  const DenseSurface target(dense);
  const auto surface_edges = edges_with_patches(mesh.surface);
  std::vector<Vec3> shift(edges.size());
  std::vector<std::int32_t> node_of(surface_edges.size());
  parallel_for_each_index(
      0, surface_edges.size(),
      [&](std::size_t s) {
        const auto& [edge, patches] = surface_edges[s];
        const auto n = static_cast<std::size_t>(std::lower_bound(edges.begin(), edges.end(), edge) -
                                                edges.begin());
        node_of[s] = static_cast<std::int32_t>(n);
        const Vec3 middle = mesh.mid_points[n];
        const Vec3 way = target.nearest(middle, patches) - middle;
        const double most =
            kMostShift * distance(mesh.points[edge.first], mesh.points[edge.second]);
        if (norm(way) <= most) shift[n] = way;
      },
      64);
  report_progress(context, kStage, 0.6);

  std::vector<int> halvings(edges.size(), 0);
  const auto place = [&](std::size_t n) {
    const double part = halvings[n] > kHalvings ? 0 : std::ldexp(1.0, -halvings[n]);
    mesh.mid_points[n] = middle_of(mesh, edges[n]) + part * shift[n];
  };
  for (const std::int32_t n : node_of)
    place(static_cast<std::size_t>(n));
  // Each round looks at all tets as they are and only then moves nodes back, which ends after at
  // most `kHalvings` + 1 rounds for each node.
  std::vector<char> is_sound(mesh.tets.size());
  for (;;) {
    parallel_for_each_index(0, mesh.tets.size(), [&](std::size_t t) {
      is_sound[t] = least_jacobian_of(mesh, t) >= kLeastJacobian ? 1 : 0;
    });
    std::vector<std::int32_t> back;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
      if (is_sound[t] == 0)
        for (const std::int32_t n : mesh.mid_of[t])
          if (halvings[n] <= kHalvings && squared_norm(shift[n]) > 0) back.push_back(n);
    if (back.empty()) break;
    std::sort(back.begin(), back.end());
    back.erase(std::unique(back.begin(), back.end()), back.end());
    for (const std::int32_t n : back) {
      ++halvings[n];
      place(static_cast<std::size_t>(n));
    }
  }
  for (const std::int32_t n : node_of) {
    if (!(squared_norm(shift[n]) > 0)) continue;
    stats.held_back += halvings[n] > 0 ? 1 : 0;
    if (halvings[n] > kHalvings) continue;
    ++stats.moved;
    stats.max_shift_mm =
        std::max(stats.max_shift_mm, distance(mesh.mid_points[n], middle_of(mesh, edges[n])));
  }
}

}  // namespace

double least_jacobian(const std::array<Vec3, 4>& corners, const std::array<Vec3, 6>& mids) {
  // Control points of the quadratic map: the corners, and 2 m - (p + q) / 2 on the edges.
  Vec3 control[4][4];
  for (std::size_t k = 0; k < 4; ++k)
    control[k][k] = corners[k];
  for (std::size_t e = 0; e < 6; ++e) {
    const auto [i, j] = kEdges[e];
    control[i][j] = control[j][i] = 2 * mids[e] - (corners[i] + corners[j]) / 2;
  }
  // The derivatives along the edges from corner 0 are linear; half of their values at the corners:
  Vec3 u[4], v[4], w[4];
  for (std::size_t k = 0; k < 4; ++k) {
    u[k] = control[1][k] - control[0][k];
    v[k] = control[2][k] - control[0][k];
    w[k] = control[3][k] - control[0][k];
  }
  // Their determinant is cubic. Its Bernstein coefficient for the corners i <= j <= k is the mean
  // over all ways to hand these three out to u, v and w.
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i; j < 4; ++j)
      for (std::size_t k = j; k < 4; ++k) {
        std::array<std::size_t, 3> at_corner{i, j, k};
        double sum = 0;
        int count = 0;
        do {
          sum += dot(u[at_corner[0]], cross(v[at_corner[1]], w[at_corner[2]]));
          ++count;
        } while (std::next_permutation(at_corner.begin(), at_corner.end()));
        least = std::min(least, sum / count);
      }
  // Half derivatives: an eighth of the determinant.
  return 8 * least / volume6(corners[0], corners[1], corners[2], corners[3]);
}

SecondOrderStats make_second_order(TetMesh& mesh,
                                   const InterfaceMesh* dense,
                                   const StageContext& context) {
  report_progress(context, kStage, 0);
  const std::vector<Edge> edges = number_edges(mesh);
  mesh.mid_points.resize(edges.size());
  parallel_for_each_index(0, edges.size(),
                          [&](std::size_t n) { mesh.mid_points[n] = middle_of(mesh, edges[n]); });
  SecondOrderStats stats;
  stats.mid_nodes = edges.size();
  report_progress(context, kStage, 0.3);
  if (dense != nullptr) curve(mesh, edges, *dense, context, stats);
  stats.least_jacobian = deterministic_reduce(
      0, mesh.tets.size(), 1.0, [&](std::size_t t) { return least_jacobian_of(mesh, t); },
      [](double a, double b) { return std::min(a, b); });
  report_progress(context, kStage, 1);
  return stats;
}

}  // namespace cvmesh
