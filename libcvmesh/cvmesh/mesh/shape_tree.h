// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/float_box.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace cvmesh {

/// A search tree over many small shapes that do not move: four boxes to a node, every level full
/// but for its end, so that there are no pointers; built by halving at the median of the longest
/// axis, a level at a time, in parallel.
///
/// `Shapes` has `size()` and `box(i)`, for `nearest` also `squared_distance(i, p)`; the tree keeps
/// a reference to it. About 36 bytes a shape, 3 more with kinds; O(n log n).
template <typename Shapes>
class ShapeTree {
 public:
  /// A set of kinds of shapes: a bit for each, or for several that are not told apart.
  using Kinds = std::uint64_t;
  static constexpr Kinds kEveryKind = ~Kinds{0};

  struct Hit {
    double squared_distance = std::numeric_limits<double>::infinity();
    std::int64_t shape = -1;  ///< -1: none
  };

  explicit ShapeTree(const Shapes& shapes) : shapes_(shapes), order_(shapes.size()) {
    sort_into_place();
    build_levels();
  }

  /// With the order of a tree over the same shapes in a space of other axes: saves the sort, and
  /// what is compact in one is in the other, as long as the axes differ by a few times at most.
  ShapeTree(const Shapes& shapes, std::vector<std::uint32_t> order)
      : shapes_(shapes), order_(std::move(order)) {
    build_levels();
  }

  [[nodiscard]] const std::vector<std::uint32_t>& order() const { return order_; }

  /// Notes which kinds of shapes are where, `kinds_of(i)` being those of one shape. Without it all
  /// shapes that are nearer than the nearest of a rare kind are looked at.
  template <typename KindsOf>
  void mark_kinds(const KindsOf& kinds_of) {
    kinds_.clear();
    for (const std::vector<Node>& level : levels_) {
      std::vector<Kinds> kinds(level.size(), 0);
      const std::size_t children = kinds_.empty() ? order_.size() : kinds_.back().size();
      parallel_for_each_index(0, kinds.size(), [&](std::size_t n) {
        for (std::size_t c = n * kWidth; c < std::min(children, (n + 1) * kWidth); ++c)
          kinds[n] |= kinds_.empty() ? kinds_of(order_[c]) : kinds_.back()[c];
      });
      kinds_.push_back(std::move(kinds));
    }
  }

  /// The shape nearest to p among those that `is_wanted(i)`; the distance is exact, among equally
  /// near shapes the choice depends on the guess. `guess`, the answer for a point nearby, or -1,
  /// must be one that is wanted; it saves most of the work.
  /// @param kinds  those that a wanted shape may be of, if kinds are marked
  template <typename IsWanted>
  [[nodiscard]] Hit nearest(const Vec3& p,
                            std::int64_t guess,
                            const IsWanted& is_wanted,
                            Kinds kinds = kEveryKind) const {
    Query query(p, hit_of(guess, p), kinds_.empty() ? kEveryKind : kinds);
    if (!levels_.empty()) search(top_level(), 0, is_wanted, query);
    return query.best;
  }

  /// The part of a tree that holds the shapes near a box.
  class Region;

  /// Calls visit(i) for the shapes of a region that may be within a distance of `box`, as far as
  /// their boxes tell: the square root of `squared_bound` at first, then of what the last call
  /// returned.
  template <typename Visit>
  void for_each_near(const Region& region,
                     const Box3& box,
                     double squared_bound,
                     const Visit& visit) const {
    const FloatBox target(box);
    for (std::size_t b = 0; b < region.boxes_.size(); ++b) {
      const Lanes near = distances(region.boxes_[b], target);
      for (LaneSet set = lanes_within(near, squared_bound); set != 0; set &= set - 1) {
        const std::uint32_t item = region.items_[b * kWidth + first_of(set)];
        if (region.height_ == 0)
          squared_bound = visit(order_[item]);
        else
          squared_bound = visit_near(region.height_ - 1, item, target, squared_bound, visit);
      }
    }
  }

  /// The region of all shapes whose distance to the box is at most `reach`, as finely as a few
  /// dozen boxes can tell.
  void find_region(const Box3& box, double reach, Region& region) const {
    region.clear();
    if (levels_.empty()) return;
    const FloatBox target(box);
    const double squared_reach = reach * reach;
    region.height_ = top_level() + 1;
    region.items_.push_back(0);
    std::vector<std::uint32_t>& below = region.below_;
    while (region.height_ > 0) {
      below.clear();
      for (const std::uint32_t node : region.items_) {
        const Lanes near = distances(levels_[region.height_ - 1][node], target);
        for (LaneSet set = lanes_within(near, squared_reach); set != 0; set &= set - 1)
          below.push_back(node * kWidth + first_of(set));
      }
      if (below.size() > kRegionItems) break;
      --region.height_;
      std::swap(region.items_, below);
    }
    if (region.height_ <= top_level()) copy_boxes(region);
  }

  /// Calls visit(i) for every shape whose box overlaps or touches `box`, in an order that depends
  /// only on the shapes.
  template <typename Visit>
  void for_each_overlap(const Box3& box, const Visit& visit) const {
    if (levels_.empty()) return;
    std::array<Entry, kStack> stack;
    std::size_t top = 0;
    stack[top++] = {0, top_level(), 0};
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
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  // 16 levels of four lanes cover 4^16 shapes; on each, all lanes but one may wait.
  static constexpr std::size_t kStack = 64;
  static constexpr std::size_t kRegionItems = 64;
  // Four floats in one register; a vector extension that GCC and Clang share, since neither makes
  // vectors of the loop over the lanes at -O2.
  using Lanes [[gnu::vector_size(16)]] = float;

  // Boxes rounded outwards to floats: half the memory, and no box becomes too small. Lanes without
  // a box are empty (lo > hi): infinitely far, overlapping nothing.
  struct Node {
    std::array<Lanes, 3> lo, hi;
  };

  // A search for the shape nearest to a point.
  struct Query {
    Query(const Vec3& p, const Hit& guess, Kinds wanted)
        : point(p), rounded(Box3{p, p}), best(guess), kinds(wanted) {}

    Vec3 point;
    FloatBox rounded;
    Hit best;
    Kinds kinds;
  };

  struct Entry {
    double squared_distance;
    std::uint32_t level, node;
  };

  using LaneSet = std::uint32_t;  // a bit for each lane

  [[nodiscard]] std::uint32_t top_level() const {
    return static_cast<std::uint32_t>(levels_.size() - 1);
  }

  [[nodiscard]] Hit hit_of(std::int64_t guess, const Vec3& p) const {
    return guess < 0 ? Hit{} : Hit{shapes_.squared_distance(guess, p), guess};
  }

  // Improves a query by the shapes under a node.
  template <typename IsWanted>
  void search(std::uint32_t level,
              std::uint32_t node,
              const IsWanted& is_wanted,
              Query& query) const {
    std::array<Entry, kStack> stack;
    std::size_t top = 0;
    stack[top++] = {0, level, node};
    while (top > 0) {
      const Entry entry = stack[--top];
      if (entry.squared_distance >= query.best.squared_distance) continue;
      const Lanes near = distances(levels_[entry.level][entry.node], query.rounded);
      if (entry.level > 0) {
        push_far_first(near, entry, query, stack, top);
        continue;
      }
      for (LaneSet set = lanes_within(near, query.best.squared_distance); set != 0; set &= set - 1)
        look_at(order_[entry.node * std::size_t{kWidth} + first_of(set)], is_wanted, query);
    }
  }

  // Visits the shapes under a node; the bound after the last call.
  template <typename Visit>
  double visit_near(std::uint32_t level,
                    std::uint32_t node,
                    const FloatBox& target,
                    double squared_bound,
                    const Visit& visit) const {
    const Lanes near = distances(levels_[level][node], target);
    for (LaneSet set = lanes_within(near, squared_bound); set != 0; set &= set - 1) {
      const std::uint32_t child = node * kWidth + first_of(set);
      squared_bound = level == 0 ? visit(order_[child])
                                 : visit_near(level - 1, child, target, squared_bound, visit);
    }
    return squared_bound;
  }

  // The boxes of a region's items, four to a node.
  void copy_boxes(Region& region) const {
    region.boxes_.resize((region.items_.size() + kWidth - 1) / kWidth);
    for (std::size_t i = 0; i < region.boxes_.size() * kWidth; ++i) {
      Node& to = region.boxes_[i / kWidth];
      const std::uint32_t lane = i % kWidth;
      if (i >= region.items_.size()) {
        put(to, lane, Box3{});
        continue;
      }
      const std::uint32_t item = region.items_[i];
      const Node& from = levels_[region.height_][item / kWidth];
      for (int axis = 0; axis < 3; ++axis) {
        to.lo[axis][lane] = from.lo[axis][item % kWidth];
        to.hi[axis][lane] = from.hi[axis][item % kWidth];
      }
    }
  }

  template <typename IsWanted>
  void look_at(std::uint32_t shape, const IsWanted& is_wanted, Query& query) const {
    if (!is_wanted(shape)) return;
    const double d = shapes_.squared_distance(shape, query.point);
    if (d < query.best.squared_distance) query.best = {d, shape};
  }

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
    const FloatBox rounded(box);
    for (int axis = 0; axis < 3; ++axis) {
      node.lo[axis][lane] = rounded.lo[axis];
      node.hi[axis][lane] = rounded.hi[axis];
    }
  }

  // Squared distances from a box to the boxes of a node, or a little less: the factor covers the
  // rounding of a difference, a product and two sums.
  static Lanes distances(const Node& node, const FloatBox& box) {
    constexpr float kCautious = 1 - 8 * std::numeric_limits<float>::epsilon();
    Lanes sum{};
    for (int axis = 0; axis < 3; ++axis) {
      const Lanes below = node.lo[axis] - box.hi[axis], above = box.lo[axis] - node.hi[axis];
      Lanes d = below > above ? below : above;
      d = d > 0 ? d : Lanes{};
      sum += d * d;
    }
    return kCautious * sum;
  }

  // The lanes whose squared distance is at most a bound; none of those without a box, which are
  // infinitely far.
  static LaneSet lanes_within(const Lanes& near, double squared_bound) {
    const float bound =
        std::min(rounded_outwards(squared_bound, 1), std::numeric_limits<float>::max());
    const auto is_within = near <= bound;
#ifdef __SSE__
    return static_cast<LaneSet>(__builtin_ia32_movmskps(reinterpret_cast<Lanes>(is_within)));
#else
    LaneSet set = 0;
    for (std::uint32_t lane = 0; lane < kWidth; ++lane)
      set |= (is_within[lane] & 1U) << lane;
    return set;
#endif
  }

  static std::uint32_t first_of(LaneSet set) {
    return static_cast<std::uint32_t>(std::countr_zero(set));
  }

  static bool overlaps(const Node& node, std::uint32_t lane, const Box3& box) {
    for (int axis = 0; axis < 3; ++axis) {
      if (node.lo[axis][lane] > box.hi[axis] || node.hi[axis][lane] < box.lo[axis]) return false;
    }
    return true;
  }

  void push_far_first(const Lanes& near,
                      const Entry& entry,
                      const Query& query,
                      std::array<Entry, kStack>& stack,
                      std::size_t& top) const {
    const std::size_t bottom = top;
    for (std::uint32_t lane = 0; lane < kWidth; ++lane) {
      if (!(near[lane] < query.best.squared_distance)) continue;
      const Entry child{near[lane], entry.level - 1, entry.node * kWidth + lane};
      if (query.kinds != kEveryKind && (kinds_[child.level][child.node] & query.kinds) == 0)
        continue;
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
  std::vector<std::vector<Kinds>> kinds_;  ///< under each node; empty while none are marked
};

template <typename Shapes>
class ShapeTree<Shapes>::Region {
 private:
  friend class ShapeTree;

  void clear() {
    items_.clear();
    boxes_.clear();
  }

  std::uint32_t height_ = 0;  // 0: the items are places in `order_`; k: nodes of level k - 1
  std::vector<std::uint32_t> items_, below_;
  std::vector<Node> boxes_;  // of the items, four to a node
};

}  // namespace cvmesh
