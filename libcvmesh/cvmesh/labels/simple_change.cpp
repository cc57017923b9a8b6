// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/simple_change.h"

#include <bit>
#include <cstdint>
#include <vector>

namespace cvmesh {
namespace {

constexpr int kLinkSize = 14;
// A set of link nodes, one bit each, in the order of kLinkSteps.
using LinkSet = std::uint16_t;
constexpr LinkSet kWholeLink = (1U << kLinkSize) - 1;

// Two nodes are joined when their difference, or its opposite, has components 0 and 1 only.
constexpr bool are_joined(const std::array<int, 3>& a, const std::array<int, 3>& b) {
  bool is_up = true, is_down = true;
  for (int axis = 0; axis < 3; ++axis) {
    const int d = b[axis] - a[axis];
    is_up = is_up && (d == 0 || d == 1);
    is_down = is_down && (d == 0 || d == -1);
  }
  return is_up || is_down;
}

constexpr std::array<LinkSet, kLinkSize> joined_to_each() {
  std::array<LinkSet, kLinkSize> joined{};
  for (int a = 0; a < kLinkSize; ++a)
    for (int b = 0; b < kLinkSize; ++b)
      if (a != b && are_joined(kLinkSteps[a], kLinkSteps[b]))
        joined[a] = static_cast<LinkSet>(joined[a] | 1U << b);
  return joined;
}

constexpr std::array<LinkSet, kLinkSize> kJoined = joined_to_each();

// A non-empty part of the sphere is contractible when it is connected and V - E + F is 1: its
// second Betti number is 0 (only the whole sphere, whose sum is 2, has one), so the first is too.
bool find_contractible(LinkSet set) {
  if (set == 0) return false;
  LinkSet reached = static_cast<LinkSet>(set & (~set + 1U)), front = reached;
  int twice_edges = 0, six_triangles = 0;
  while (front != 0) {
    const int a = std::countr_zero(front);
    front = static_cast<LinkSet>(front & (front - 1U));
    const LinkSet around = kJoined[a] & set;
    twice_edges += std::popcount(around);
    for (LinkSet rest = around; rest != 0; rest = static_cast<LinkSet>(rest & (rest - 1U)))
      six_triangles +=
          std::popcount(static_cast<LinkSet>(kJoined[std::countr_zero(rest)] & around));
    const LinkSet fresh = static_cast<LinkSet>(around & ~reached);
    reached |= fresh;
    front |= fresh;
  }
  return reached == set && std::popcount(set) - twice_edges / 2 + six_triangles / 6 == 1;
}

// The answer for each of the 2^14 parts of the link.
class ContractibleTable {
 public:
  ContractibleTable() : is_contractible_(kWholeLink + 1U) {
    for (unsigned set = 0; set <= kWholeLink; ++set)
      is_contractible_[set] = find_contractible(static_cast<LinkSet>(set)) ? 1 : 0;
  }

  [[nodiscard]] bool operator[](LinkSet set) const { return is_contractible_[set] != 0; }

 private:
  std::vector<std::uint8_t> is_contractible_;
};

const ContractibleTable& contractible() {
  static const ContractibleTable table;
  return table;
}

// Link nodes with a given step along an axis.
LinkSet link_nodes_at(int axis, int step) {
  LinkSet set = 0;
  for (int n = 0; n < kLinkSize; ++n)
    if (kLinkSteps[n][axis] == step) set = static_cast<LinkSet>(set | 1U << n);
  return set;
}

// The faces, edges and corners of the box that hold a border node, as the link nodes that lie in
// them (and the grid itself, first).
struct BorderStrata {
  std::array<LinkSet, 8> links{};
  int count = 0;
};

BorderStrata border_strata(const std::array<int, 3>& dims, const std::array<int, 3>& at) {
  BorderStrata strata;
  LinkSet in_grid = kWholeLink;
  std::array<bool, 3> is_on_face{};
  for (int axis = 0; axis < 3; ++axis) {
    if (at[axis] == 0) in_grid = static_cast<LinkSet>(in_grid & ~link_nodes_at(axis, -1));
    if (at[axis] == dims[axis] - 1)
      in_grid = static_cast<LinkSet>(in_grid & ~link_nodes_at(axis, 1));
    is_on_face[axis] = at[axis] == 0 || at[axis] == dims[axis] - 1;
  }
  for (unsigned axes = 0; axes < 8; ++axes) {
    LinkSet link = in_grid;
    bool is_stratum = true;
    for (int axis = 0; axis < 3; ++axis) {
      if ((axes >> axis & 1U) == 0) continue;
      is_stratum = is_stratum && is_on_face[axis];
      link = static_cast<LinkSet>(link & link_nodes_at(axis, 0));
    }
    if (is_stratum) strata.links[strata.count++] = link;
  }
  return strata;
}

}  // namespace

bool is_simple_change(const Grid<MaterialId>& labels, int i, int j, int k, MaterialId to) {
  const GridFrame& frame = labels.frame;
  const auto& dims = frame.dims;
  const bool is_inner =
      i > 0 && j > 0 && k > 0 && i + 1 < dims[0] && j + 1 < dims[1] && k + 1 < dims[2];
  BorderStrata strata;
  strata.links[0] = kWholeLink;
  strata.count = 1;
  if (!is_inner) strata = border_strata(dims, {i, j, k});

  const MaterialId from = labels(i, j, k);
  std::array<MaterialId, kLinkSize> around{};
  LinkSet from_set = 0, to_set = 0;
  for (int n = 0; n < kLinkSize; ++n) {
    const auto bit = static_cast<LinkSet>(1U << n);
    if ((strata.links[0] & bit) == 0) continue;
    around[n] = labels(i + kLinkSteps[n][0], j + kLinkSteps[n][1], k + kLinkSteps[n][2]);
    if (around[n] == from) from_set |= bit;
    if (around[n] == to) to_set |= bit;
  }
  const ContractibleTable& is_contractible = contractible();
  for (int s = 0; s < strata.count; ++s)
    if (!is_contractible[from_set & strata.links[s]] || !is_contractible[to_set & strata.links[s]])
      return false;

  // `to` comes to touch every third material of the link: it must touch it there already.
  LinkSet beside_to = 0;
  for (LinkSet rest = to_set; rest != 0; rest = static_cast<LinkSet>(rest & (rest - 1U)))
    beside_to |= kJoined[std::countr_zero(rest)];
  LinkSet third = static_cast<LinkSet>(strata.links[0] & ~(from_set | to_set));
  while (third != 0) {
    const MaterialId other = around[std::countr_zero(third)];
    LinkSet same = 0;
    for (LinkSet rest = third; rest != 0; rest = static_cast<LinkSet>(rest & (rest - 1U))) {
      const int n = std::countr_zero(rest);
      if (around[n] == other) same = static_cast<LinkSet>(same | 1U << n);
    }
    if ((same & beside_to) == 0) return false;
    third = static_cast<LinkSet>(third & ~same);
  }
  return true;
}

}  // namespace cvmesh
