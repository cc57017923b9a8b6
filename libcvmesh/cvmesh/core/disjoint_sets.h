// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

namespace cvmesh {

/// Sets of the numbers 0 to count - 1 that grow together (union-find with path halving). The
/// smallest member is the root of its set, whatever the order in which sets were joined.
class DisjointSets {
 public:
  /// Every number a set of its own.
  explicit DisjointSets(std::size_t count) : parent_(count) { reset(); }

  /// The smallest member of the set that `member` is in.
  std::uint32_t find(std::uint32_t member) {
    while (parent_[member] != member)
      member = parent_[member] = parent_[parent_[member]];
    return member;
  }

  [[nodiscard]] bool is_root(std::uint32_t member) const { return parent_[member] == member; }

  /// Makes one set of those that the two are in; false where they were in one already.
  bool join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    if (a == b) return false;
    if (a > b) std::swap(a, b);
    parent_[b] = a;
    return true;
  }

  void reset() { std::iota(parent_.begin(), parent_.end(), std::uint32_t{0}); }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace cvmesh
