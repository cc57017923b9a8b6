// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace cvmesh {

/// A search tree over many small shapes that do not move: four boxes to a node, every level full
/// but for its end, so that there are no pointers; built by halving at the median of the longest
/// axis, a level at a time, in parallel.
///
/// `Shapes` has `size()` and `box(i)`, for `nearest` also `squared_distance(i, p)`; the tree keeps
/// a reference to it. About 36 bytes a shape; O(n log n).
template <typename Shapes>
class ShapeTree {
 public:
  struct Hit {
    double squared_distance = std::numeric_limits<double>::infinity();
    std::int64_t shape = -1;  ///< -1: none
  };

  explicit ShapeTree(const Shapes& shapes) : shapes_(shapes), order_(shapes.size()) {
    sort_into_place();
    build_levels();
  }

  /// The shape nearest to p among those that `is_wanted(i)`; the distance is exact, among equally
  /// near shapes the choice depends on the guess. `guess`, the answer for a point nearby, or -1,
  /// must be one that is wanted; it saves most of the work.
  template <typename IsWanted>
  [[nodiscard]] Hit nearest(const Vec3& p, std::int64_t guess, const IsWanted& is_wanted) const {
    Hit best;
    if (guess >= 0) best = {shapes_.squared_distance(guess, p), guess};
    if (levels_.empty()) return best;
    std::array<Entry, kStack> stack;
    std::size_t top = 0;
    stack[top++] = {0, static_cast<std::uint32_t>(levels_.size() - 1), 0};
    while (top > 0) {
      const Entry entry = stack[--top];
      if (entry.squared_distance >= best.squared_distance) continue;
      const Lanes near = distances(levels_[entry.level][entry.node], p);
      if (entry.level > 0) {
        push_far_first(near, entry, best.squared_distance, stack, top);
        continue;
      }
      for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
        if (!(near[lane] < best.squared_distance)) continue;
        const std::uint32_t shape = order_[entry.node * std::size_t{kWidth} + lane];
        if (!is_wanted(shape)) continue;
        const double d = shapes_.squared_distance(shape, p);
        if (d < best.squared_distance) best = {d, shape};
      }
    }
    return best;
  }

  /// Into `found`, sorted by distance and index: the wanted shapes that are at most `slack` farther
  /// from p than the nearest of them. They hold the nearest shape of every point within slack / 2
  /// of p. `guess` as for `nearest`.
  template <typename IsWanted>
  void collect_nearest(const Vec3& p,
                       double slack,
                       std::int64_t guess,
                       const IsWanted& is_wanted,
                       std::vector<Hit>& found) const {
    found.clear();
    double nearest2 = std::numeric_limits<double>::infinity(), limit2 = nearest2;
    const auto tighten = [&](double squared_distance) {
      if (!(squared_distance < nearest2)) return;
      nearest2 = squared_distance;
      const double limit = std::sqrt(squared_distance) + slack;
      limit2 = limit * limit;
    };
    if (guess >= 0) tighten(shapes_.squared_distance(guess, p));
    if (levels_.empty()) return;
    std::array<Entry, kStack> stack;
    std::size_t top = 0;
    stack[top++] = {0, static_cast<std::uint32_t>(levels_.size() - 1), 0};
    while (top > 0) {
      const Entry entry = stack[--top];
      if (entry.squared_distance > limit2) continue;
      const Lanes near = distances(levels_[entry.level][entry.node], p);
      if (entry.level > 0) {
        push_far_first(near, entry, std::nextafter(limit2, kFar), stack, top);
        continue;
      }
      for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
        if (!(near[lane] <= limit2)) continue;
        const std::size_t place = entry.node * std::size_t{kWidth} + lane;
        if (place >= order_.size() || !is_wanted(order_[place])) continue;
        const double d = shapes_.squared_distance(order_[place], p);
        if (d > limit2) continue;
        found.push_back({d, order_[place]});
        tighten(d);
      }
    }
    std::erase_if(found, [&](const Hit& hit) { return hit.squared_distance > limit2; });
    std::sort(found.begin(), found.end(), [](const Hit& a, const Hit& b) {
      return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance
                                                      : a.shape < b.shape;
    });
  }

  /// Calls visit(i) for every shape whose box overlaps or touches `box`, in an order that depends
  /// only on the shapes.
  template <typename Visit>
  void for_each_overlap(const Box3& box, const Visit& visit) const {
    if (levels_.empty()) return;
    std::array<Entry, kStack> stack;
    std::size_t top = 0;
    stack[top++] = {0, static_cast<std::uint32_t>(levels_.size() - 1), 0};
    while (top > 0) {
      const Entry entry = stack[--top];
      const Node& node = levels_[entry.level][entry.node];
      for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
        if (!overlaps(node, lane, box)) continue;
        const std::uint32_t child = entry.node * kWidth + lane;
        if (entry.level > 0) {
          stack[top++] = {0, entry.level - 1, child};
        } else if (shapes_.box(order_[child]).overlaps(box)) {
          visit(order_[child]);
        }
      }
    }
  }

 private:
  static constexpr std::uint32_t kWidth = 4;
  // 16 levels of four lanes cover 4^16 shapes; on each, all lanes but one may wait.
  static constexpr std::size_t kStack = 64;
  static constexpr double kFar = std::numeric_limits<double>::infinity();
  using Lanes = std::array<double, kWidth>;

  // Boxes rounded outwards to floats: half the memory, and no box becomes too small. Lanes without
  // a box are empty (lo > hi): infinitely far, overlapping nothing.
  struct Node {
    std::array<std::array<float, kWidth>, 3> lo, hi;
  };

  struct Entry {
    double squared_distance;
    std::uint32_t level, node;
  };

  [[nodiscard]] Vec3 centre_of(std::size_t i) const {
    const Box3 box = shapes_.box(i);
    return 0.5 * (box.lo + box.hi);
  }

  struct Item {
    std::array<float, 3> centre;
    std::uint32_t shape;
  };

  // Orders the shapes so that every aligned run of 4^k of them is compact: from the top down, each
  // run is halved along the longest axis of its centres, twice to a level.
  void sort_into_place() {
    const std::size_t n = order_.size();
    std::vector<Item> items(n);
    parallel_for_each_index(0, n, [&](std::size_t i) {
      const Vec3 c = centre_of(i);
      items[i] = {{static_cast<float>(c.x), static_cast<float>(c.y), static_cast<float>(c.z)},
                  static_cast<std::uint32_t>(i)};
    });
    std::size_t run = 1;
    while (run < n)
      run *= 2;
    if (std::bit_width(run) % 2 == 0) run *= 2;  // a power of four
    for (; run > 1; run /= 2) {
      parallel_for_each_index(
          0, (n + run - 1) / run,
          [&](std::size_t r) {
            halve(items.data() + r * run, std::min(run, n - r * run), run / 2);
          },
          std::max<std::size_t>(1, 4096 / run));
    }
    parallel_for_each_index(0, n, [&](std::size_t i) { order_[i] = items[i].shape; });
  }

  static void halve(Item* items, std::size_t count, std::size_t half) {
    if (count <= half) return;
    int axis = 0;
    float longest = -1;
    for (int a = 0; a < 3; ++a) {
      const auto [lo, hi] = std::minmax_element(
          items, items + count,
          [a](const Item& x, const Item& y) { return x.centre[a] < y.centre[a]; });
      if (hi->centre[a] - lo->centre[a] > longest) {
        longest = hi->centre[a] - lo->centre[a];
        axis = a;
      }
    }
    std::nth_element(items, items + half, items + count, [axis](const Item& x, const Item& y) {
      return x.centre[axis] != y.centre[axis] ? x.centre[axis] < y.centre[axis] : x.shape < y.shape;
    });
  }

  void build_levels() {
    std::vector<Box3> boxes(order_.size());
    parallel_for_each_index(0, boxes.size(),
                            [&](std::size_t i) { boxes[i] = shapes_.box(order_[i]); });
    while (!boxes.empty()) {
      std::vector<Box3> parents((boxes.size() + kWidth - 1) / kWidth);
      std::vector<Node> level(parents.size());
      parallel_for_each_index(0, parents.size(), [&](std::size_t n) {
        for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
          const std::size_t child = n * kWidth + lane;
          const bool is_used = child < boxes.size();
          put(level[n], lane, is_used ? boxes[child] : Box3{});
          if (!is_used) continue;
          parents[n].add(boxes[child].lo);
          parents[n].add(boxes[child].hi);
        }
      });
      levels_.push_back(std::move(level));
      if (parents.size() == 1) break;
      boxes = std::move(parents);
    }
  }

  static void put(Node& node, std::uint32_t lane, const Box3& box) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      auto lo = static_cast<float>(box.lo[axis]), hi = static_cast<float>(box.hi[axis]);
      if (lo > box.lo[axis]) lo = std::nextafter(lo, -kInfinity);
      if (hi < box.hi[axis]) hi = std::nextafter(hi, kInfinity);
      node.lo[axis][lane] = lo;
      node.hi[axis][lane] = hi;
    }
  }

  // Squared distances from p to the boxes of a node.
  static Lanes distances(const Node& node, const Vec3& p) {
    Lanes sum{};
    for (int axis = 0; axis < 3; ++axis) {
      const double x = p[axis];
      for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
        const double below = node.lo[axis][lane] - x, above = x - node.hi[axis][lane];
        double d = below > above ? below : above;
        d = d > 0 ? d : 0;
        sum[lane] += d * d;
      }
    }
    return sum;
  }

  static bool overlaps(const Node& node, std::uint32_t lane, const Box3& box) {
    for (int axis = 0; axis < 3; ++axis) {
      if (node.lo[axis][lane] > box.hi[axis] || node.hi[axis][lane] < box.lo[axis]) return false;
    }
    return true;
  }

  static void push_far_first(const Lanes& near,
                             const Entry& entry,
                             double bound,
                             std::array<Entry, kStack>& stack,
                             std::size_t& top) {
    const std::size_t bottom = top;
    for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
      if (!(near[lane] < bound)) continue;
      const Entry child{near[lane], entry.level - 1, entry.node * kWidth + lane};
      std::size_t at = top++;
      while (at > bottom && stack[at - 1].squared_distance < child.squared_distance) {
        stack[at] = stack[at - 1];
        --at;
      }
      stack[at] = child;
    }
  }

  const Shapes& shapes_;
  std::vector<std::uint32_t> order_;
  std::vector<std::vector<Node>> levels_;  ///< [0] holds the boxes of the shapes
};

}  // namespace cvmesh
