// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/neighbour_tree.h"

#include <nanoflann.hpp>

#include <algorithm>

namespace cvmesh {
namespace {

struct Points {
  const std::vector<Vec3>& points;

  [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size(); }

  [[nodiscard]] double kdtree_get_pt(std::uint32_t i, std::size_t axis) const {
    return points[i][static_cast<int>(axis)];
  }

  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Index =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 3>;

// Collects indices only, in the tree's order.
struct WithinRadius {
  using DistanceType = double;
  double squared_radius;
  std::vector<std::int32_t>& found;

  [[nodiscard]] std::size_t size() const { return found.size(); }

  [[nodiscard]] static bool full() { return true; }

  [[nodiscard]] double worstDist() const { return squared_radius; }

  bool addPoint(double squared_distance, std::uint32_t index) const {
    if (squared_distance <= squared_radius) found.push_back(static_cast<std::int32_t>(index));
    return true;
  }
};

}  // namespace

struct NeighbourTree::Tree {
  Points points;
  Index index;

  explicit Tree(const std::vector<Vec3>& p)
      : points{p}, index(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(8)) {}
};

NeighbourTree::NeighbourTree(const std::vector<Vec3>& points)
    : tree_(std::make_unique<Tree>(points)) {}

NeighbourTree::~NeighbourTree() = default;
NeighbourTree::NeighbourTree(NeighbourTree&&) noexcept = default;
NeighbourTree& NeighbourTree::operator=(NeighbourTree&&) noexcept = default;

void NeighbourTree::within(const Vec3& p, double radius, std::vector<std::int32_t>& found) const {
  found.clear();
  const double query[3] = {p.x, p.y, p.z};
  WithinRadius collector{radius * radius, found};
  tree_->index.findNeighbors(collector, query, nanoflann::SearchParams());
  std::sort(found.begin(), found.end());
}

void NeighbourTree::nearest(const Vec3& p,
                            std::size_t count,
                            std::vector<std::int32_t>& found) const {
  const double query[3] = {p.x, p.y, p.z};
  std::vector<std::uint32_t> indices(count);
  std::vector<double> squared(count);
  indices.resize(tree_->index.knnSearch(query, count, indices.data(), squared.data()));
  found.assign(indices.begin(), indices.end());
  std::sort(found.begin(), found.end());
}

}  // namespace cvmesh
