// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace cvmesh {

/// A kd-tree over points that stay where they are. Queries may run at the same time.
///
/// The points are not copied: they must outlive the tree.
class NeighbourTree {
 public:
  explicit NeighbourTree(const std::vector<Vec3>& points);
  ~NeighbourTree();
  NeighbourTree(NeighbourTree&&) noexcept;
  NeighbourTree& operator=(NeighbourTree&&) noexcept;

  /// Indices of the points within `radius` of `p`, ascending.
  void within(const Vec3& p, double radius, std::vector<std::int32_t>& found) const;
  /// Indices of the `count` points nearest to `p` (all, if there are fewer), ascending.
  void nearest(const Vec3& p, std::size_t count, std::vector<std::int32_t>& found) const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace cvmesh
