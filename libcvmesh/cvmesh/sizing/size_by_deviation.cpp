// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/size_by_deviation.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/median.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

namespace cvmesh {
namespace {

// Over the mean edge: how far around a place the deviation is measured. About a facet's
// circumscribed circle; between 0.5 and 1 the distances on bunny and tooth hardly differ.
constexpr double kReach = 0.75;
// Over the reach: side of the cells whose facets are taken together.
constexpr double kCell = 1.0 / 3;
// Over the median deviation: regions flatter than this count as this.
constexpr double kFlattest = 0.7;

// Facets of one patch in one cell whose normals point into one octant, so that two walls in a cell
// stay apart.
struct Cluster {
  std::int32_t patch = -1;
  double area_mm2 = 0;
  Vec3 normal;  // unit
};

struct Clusters {
  std::vector<Cluster> list;           // those of a patch stand together
  std::vector<Vec3> centroid;          // of each cluster
  std::vector<std::int32_t> at_facet;  // cluster of each facet
};

struct Place {
  std::int32_t patch;
  std::array<std::int32_t, 3> cell;
  std::uint8_t octant;
  std::int32_t facet;

  auto operator<=>(const Place&) const = default;

  [[nodiscard]] bool is_with(const Place& other) const {
    return cell == other.cell && patch == other.patch && octant == other.octant;
  }
};

Clusters find_clusters(const InterfaceMesh& dense, const Strata& strata, double cell_mm) {
  std::vector<Place> places(dense.facets.size());
  const auto corners = [&](std::int32_t f) {
    const auto& [a, b, c] = dense.facets[static_cast<std::size_t>(f)];
    return std::array<Vec3, 3>{dense.points[a], dense.points[b], dense.points[c]};
  };
  parallel_for_each_index(0, places.size(), [&](std::size_t n) {
    const auto f = static_cast<std::int32_t>(n);
    const auto [a, b, c] = corners(f);
    const Vec3 middle = (a + b + c) / 3, normal = area_vector2(a, b, c);
    Place& place = places[n];
    for (int axis = 0; axis < 3; ++axis)
      place.cell[axis] = static_cast<std::int32_t>(std::floor(middle[axis] / cell_mm));
    place.patch = strata.patch_of[n];
    place.octant = static_cast<std::uint8_t>((normal.x > 0 ? 1 : 0) | (normal.y > 0 ? 2 : 0) |
                                             (normal.z > 0 ? 4 : 0));
    place.facet = f;
  });
  parallel_sort(places.begin(), places.end());

  Clusters clusters;
  clusters.at_facet.resize(places.size());
  for (std::size_t begin = 0, end = 0; begin < places.size(); begin = end) {
    Cluster cluster;
    cluster.patch = places[begin].patch;
    Vec3 normal, moment;
    for (; end < places.size() && places[end].is_with(places[begin]); ++end) {
      const auto [a, b, c] = corners(places[end].facet);
      const Vec3 twice = area_vector2(a, b, c);
      const double area = norm(twice) / 2;
      cluster.area_mm2 += area;
      normal += twice;
      moment += area * ((a + b + c) / 3);
      clusters.at_facet[static_cast<std::size_t>(places[end].facet)] =
          static_cast<std::int32_t>(clusters.list.size());
    }
    cluster.normal = normalized(normal);
    clusters.list.push_back(cluster);
    clusters.centroid.push_back(cluster.area_mm2 > 0 ? moment / cluster.area_mm2
                                                     : corners(places[begin].facet)[0]);
  }
  return clusters;
}

// The clusters of one patch, to be searched.
class PatchClusters {
 public:
  PatchClusters(const Clusters& clusters, std::size_t begin, std::size_t end)
      : first_(static_cast<std::int32_t>(begin)),
        centroid_(clusters.centroid.begin() + static_cast<std::ptrdiff_t>(begin),
                  clusters.centroid.begin() + static_cast<std::ptrdiff_t>(end)),
        tree_(centroid_) {}

  // Ascending.
  void within(const Vec3& p, double radius, std::vector<std::int32_t>& found) const {
    tree_.within(p, radius, found);
    for (auto& n : found)
      n += first_;
  }

 private:
  std::int32_t first_;
  std::vector<Vec3> centroid_;
  NeighbourTree tree_;
};

// One for each patch. Where thin materials lie on each other most of what is near is of another
// patch.
std::vector<std::unique_ptr<PatchClusters>> sort_by_patch(const Clusters& clusters,
                                                          std::size_t patch_count) {
  std::vector<std::size_t> first(patch_count + 1, 0);
  for (const Cluster& cluster : clusters.list)
    ++first[static_cast<std::size_t>(cluster.patch) + 1];
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<std::unique_ptr<PatchClusters>> patches(patch_count);
  parallel_for_each_index(
      0, patch_count,
      [&](std::size_t p) {
        if (first[p] < first[p + 1])
          patches[p] = std::make_unique<PatchClusters>(clusters, first[p], first[p + 1]);
      },
      1);
  return patches;
}

// How far the clusters around one that face its way lie off their best plane (root mean square).
// @param around  of its patch
double deviation_around(const Clusters& clusters,
                        std::size_t n,
                        const std::vector<std::int32_t>& around) {
  const Cluster& here = clusters.list[n];
  const Vec3& origin = clusters.centroid[n];
  double mass = 0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
  for (const auto m : around) {
    const Cluster& other = clusters.list[static_cast<std::size_t>(m)];
    if (dot(other.normal, here.normal) <= 0) continue;
    const Vec3 d = clusters.centroid[static_cast<std::size_t>(m)] - origin;
    const Eigen::Vector3d x(d.x, d.y, d.z);
    mass += other.area_mm2;
    first += other.area_mm2 * x;
    second += other.area_mm2 * x * x.transpose();
  }
  if (!(mass > 0)) return 0;
  first /= mass;
  const Eigen::Matrix3d covariance = second / mass - first * first.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()[0]));
}

}  // namespace

std::vector<double> size_by_deviation(const InterfaceMesh& dense,
                                      const Strata& strata,
                                      double vertices,
                                      double voxel_mm) {
  if (dense.facets.empty()) return std::vector<double>(dense.points.size(), voxel_mm);
  const double area_mm2 = deterministic_reduce(
      0, dense.facets.size(), 0.0,
      [&](std::size_t f) {
        const auto& [a, b, c] = dense.facets[f];
        return norm(area_vector2(dense.points[a], dense.points[b], dense.points[c])) / 2;
      },
      std::plus<>());
  // a vertex at spacing h owns a hexagon
  const double mean_edge_mm = std::sqrt(area_mm2 / (std::sqrt(3.0) / 2 * vertices));
  const double reach_mm = std::max(kReach * mean_edge_mm, voxel_mm);
  const Clusters clusters = find_clusters(dense, strata, kCell * reach_mm);

  const auto patches = sort_by_patch(clusters, strata.patches.size());
  std::vector<double> deviation(clusters.list.size());
  constexpr std::size_t kGrain = 256;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, deviation.size(), kGrain),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      std::vector<std::int32_t> around;
                      for (std::size_t n = range.begin(); n != range.end(); ++n) {
                        patches[static_cast<std::size_t>(clusters.list[n].patch)]->within(
                            clusters.centroid[n], reach_mm, around);
                        deviation[n] = deviation_around(clusters, n, around);
                      }
                    });

  const double usual = std::max(median(deviation), 1e-6 * voxel_mm);
  std::vector<double> edge_mm(dense.points.size(), std::numeric_limits<double>::infinity());
  for (std::size_t f = 0; f < dense.facets.size(); ++f) {
    const double relative = deviation[static_cast<std::size_t>(clusters.at_facet[f])] / usual;
    // kappa h^4 the same everywhere, kappa as the deviation within one reach
    const double edge = mean_edge_mm * std::pow(std::max(relative, kFlattest), -0.25);
    for (const auto v : dense.facets[f])
      edge_mm[static_cast<std::size_t>(v)] = std::min(edge_mm[static_cast<std::size_t>(v)], edge);
  }
  for (double& edge : edge_mm)
    edge = std::min(edge, mean_edge_mm * std::pow(kFlattest, -0.25));
  return edge_mm;
}

}  // namespace cvmesh
