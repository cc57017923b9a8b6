// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <unordered_map>
#include <vector>

namespace cvmesh {

/// A hash grid of points that each have a size, for sets that grow: one level of cubic cells per
/// power of two of the size, so that a search looks at few cells wherever the sizes vary.
class SizeGrid {
 public:
  void add(std::int32_t index, const Vec3& p, double size) {
    const int level = level_of(size);
    Level& cells = levels_[level];
    cells[key(p, edge_of(level))].push_back(index);
  }

  /// Calls `visit(index)` for every point of at least `least_size` in the cells that the cube of
  /// half edge `radius` around p touches. The order is that of levels, cells and additions: the
  /// same for the same calls.
  template <typename Visit>
  void visit_near(const Vec3& p, double radius, double least_size, const Visit& visit) const {
    if (levels_.empty()) return;
    const auto first = least_size > 0 ? levels_.lower_bound(level_of(least_size)) : levels_.begin();
    for (auto level = first; level != levels_.end(); ++level) {
      const double edge = edge_of(level->first);
      const Cell lo = cell(p - Vec3{radius, radius, radius}, edge);
      const Cell hi = cell(p + Vec3{radius, radius, radius}, edge);
      for (std::int32_t k = lo.k; k <= hi.k; ++k)
        for (std::int32_t j = lo.j; j <= hi.j; ++j)
          for (std::int32_t i = lo.i; i <= hi.i; ++i) {
            const auto found = level->second.find(pack({i, j, k}));
            if (found == level->second.end()) continue;
            for (const std::int32_t index : found->second)
              visit(index);
          }
    }
  }

 private:
  struct Cell {
    std::int32_t i, j, k;
  };

  using Level = std::unordered_map<std::uint64_t, std::vector<std::int32_t>>;

  static int level_of(double size) { return static_cast<int>(std::floor(std::log2(size))); }

  // Two to four sizes: a search for neighbours touches few cells, with few points each.
  static double edge_of(int level) { return std::ldexp(1.0, level + 2); }

  static Cell cell(const Vec3& p, double edge) {
    return {static_cast<std::int32_t>(std::floor(p.x / edge)),
            static_cast<std::int32_t>(std::floor(p.y / edge)),
            static_cast<std::int32_t>(std::floor(p.z / edge))};
  }

  // 21 bits per axis; cells 2^21 apart share a key, which costs a longer list and nothing else.
  static std::uint64_t pack(const Cell& c) {
    constexpr std::uint64_t kMask = (1ULL << 21) - 1;
    return (static_cast<std::uint64_t>(c.i) & kMask) |
           (static_cast<std::uint64_t>(c.j) & kMask) << 21 |
           (static_cast<std::uint64_t>(c.k) & kMask) << 42;
  }

  static std::uint64_t key(const Vec3& p, double edge) { return pack(cell(p, edge)); }

  std::map<int, Level> levels_;
};

}  // namespace cvmesh
