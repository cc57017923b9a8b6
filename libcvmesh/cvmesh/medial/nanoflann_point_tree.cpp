// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/medial/point_tree.h"

#include <nanoflann.hpp>

#include <cmath>
#include <utility>

namespace cvmesh {
namespace {

constexpr std::size_t kLeafSize = 12;

struct Cloud {
  std::vector<Vec3> points;

  [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size(); }

  [[nodiscard]] double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points[i][static_cast<int>(axis)];
  }

  template <typename Box>
  bool kdtree_get_bbox(Box& /*box*/) const {
    return false;
  }
};

using Tree = nanoflann::
    KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, 3, std::uint32_t>;

// Keeps the nearest point that is accepted; ties go to the smaller index. The tree reads the worst
// distance once per leaf, so a candidate may be no improvement.
template <typename Accept>
class NearestAccepted {
 public:
  NearestAccepted(double limit_squared, const Accept& accept)
      : squared_(limit_squared), accept_(accept) {}

  [[nodiscard]] bool full() const { return true; }

  [[nodiscard]] double worstDist() const { return squared_; }

  bool addPoint(double squared, std::uint32_t index) {
    const auto i = static_cast<std::int32_t>(index);
    if ((squared < squared_ || (squared == squared_ && i < index_)) && accept_(i)) {
      squared_ = squared;
      index_ = i;
    }
    return true;
  }

  [[nodiscard]] PointTree::Hit hit() const {
    return index_ < 0 ? PointTree::Hit{} : PointTree::Hit{index_, std::sqrt(squared_)};
  }

 private:
  double squared_;
  std::int32_t index_ = -1;
  const Accept& accept_;
};

template <typename Accept>
PointTree::Hit search(const Tree& tree, const Vec3& p, double limit, const Accept& accept) {
  NearestAccepted<Accept> result(limit * limit, accept);
  const double query[3] = {p.x, p.y, p.z};
  tree.findNeighbors(result, query, nanoflann::SearchParams());
  return result.hit();
}

}  // namespace

struct PointTree::Index {
  Cloud cloud;
  Tree tree;

  explicit Index(std::vector<Vec3> points)
      : cloud{std::move(points)},
        tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {
    tree.buildIndex();
  }
};

PointTree::PointTree() : PointTree(std::vector<Vec3>{}) {}

PointTree::PointTree(std::vector<Vec3> points)
    : index_(std::make_unique<Index>(std::move(points))) {}

PointTree::~PointTree() = default;
PointTree::PointTree(PointTree&&) noexcept = default;
PointTree& PointTree::operator=(PointTree&&) noexcept = default;

bool PointTree::is_empty() const {
  return index_->cloud.points.empty();
}

const std::vector<Vec3>& PointTree::points() const {
  return index_->cloud.points;
}

PointTree::Hit PointTree::nearest(const Vec3& p) const {
  if (is_empty()) return {};
  return search(index_->tree, p, std::numeric_limits<double>::infinity(),
                [](std::int32_t) { return true; });
}

PointTree::Hit PointTree::nearest_if(const Vec3& p,
                                     double limit,
                                     const std::function<bool(std::int32_t)>& accept) const {
  if (is_empty()) return {};
  return search(index_->tree, p, limit, accept);
}

}  // namespace cvmesh
