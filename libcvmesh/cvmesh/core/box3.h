// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <algorithm>
#include <limits>

namespace cvmesh {

/// Axis-aligned box; empty (lo > hi) when default constructed.
struct Box3 {
  Vec3 lo{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
          std::numeric_limits<double>::infinity()};
  Vec3 hi{-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
          -std::numeric_limits<double>::infinity()};

  void add(const Vec3& p) {
    for (int k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], p[k]);
      hi[k] = std::max(hi[k], p[k]);
    }
  }

  [[nodiscard]] bool is_empty() const { return lo.x > hi.x; }

  [[nodiscard]] bool contains(const Vec3& p) const {
    return p.x >= lo.x && p.x <= hi.x && p.y >= lo.y && p.y <= hi.y && p.z >= lo.z && p.z <= hi.z;
  }

  [[nodiscard]] bool overlaps(const Box3& b) const {
    return lo.x <= b.hi.x && b.lo.x <= hi.x && lo.y <= b.hi.y && b.lo.y <= hi.y && lo.z <= b.hi.z &&
           b.lo.z <= hi.z;
  }

  [[nodiscard]] Vec3 extent() const { return is_empty() ? Vec3{} : hi - lo; }

  [[nodiscard]] double diagonal() const { return norm(extent()); }

  friend bool operator==(const Box3&, const Box3&) = default;
};

}  // namespace cvmesh
