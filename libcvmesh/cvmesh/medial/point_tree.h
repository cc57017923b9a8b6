// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

namespace cvmesh {

/// A search tree over fixed points; queries may run in parallel.
///
/// Built once in O(n log n) on one thread, so that the same points give the same tree.
class PointTree {
 public:
  struct Hit {
    std::int32_t index = -1;  ///< -1: no point within the limit
    double distance = std::numeric_limits<double>::infinity();
  };

  PointTree();
  explicit PointTree(std::vector<Vec3> points);
  ~PointTree();
  PointTree(PointTree&&) noexcept;
  PointTree& operator=(PointTree&&) noexcept;

  [[nodiscard]] bool is_empty() const;
  [[nodiscard]] const std::vector<Vec3>& points() const;

  /// The point nearest to p.
  [[nodiscard]] Hit nearest(const Vec3& p) const;
  /// The nearest point closer than `limit` that `accept(index)` lets through. Looks at every point
  /// that is nearer than the result, so a selective `accept` wants a tight limit.
  [[nodiscard]] Hit nearest_if(const Vec3& p,
                               double limit,
                               const std::function<bool(std::int32_t)>& accept) const;

 private:
  struct Index;
  std::unique_ptr<Index> index_;
};

}  // namespace cvmesh
