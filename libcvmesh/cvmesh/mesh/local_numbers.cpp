// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/local_numbers.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace cvmesh {

LocalNumbers::LocalNumbers(std::span<const std::array<std::int32_t, 3>> facets) {
  constexpr std::size_t kMostSlots = 12;  // of the table, for a facet
  if (facets.empty()) return;
  std::int32_t last = least_ = facets.front().front();
  for (const auto& facet : facets)
    for (const auto v : facet) {
      least_ = std::min(least_, v);
      last = std::max(last, v);
    }
  const auto slots = static_cast<std::size_t>(last - least_) + 1;
  if (slots <= kMostSlots * facets.size()) {
    number_of_.assign(slots, -1);
    for (const auto& facet : facets)
      for (const auto v : facet)
        number_of_[v - least_] = 0;
    for (std::size_t n = 0; n < slots; ++n) {
      if (number_of_[n] < 0) continue;
      number_of_[n] = static_cast<std::int32_t>(vertices_.size());
      vertices_.push_back(least_ + static_cast<std::int32_t>(n));
    }
    return;
  }
  for (const auto& facet : facets)
    vertices_.insert(vertices_.end(), facet.begin(), facet.end());
  std::sort(vertices_.begin(), vertices_.end());
  vertices_.erase(std::unique(vertices_.begin(), vertices_.end()), vertices_.end());
}

std::int32_t LocalNumbers::operator()(std::int32_t vertex) const {
  if (!number_of_.empty()) return number_of_[vertex - least_];
  return static_cast<std::int32_t>(std::lower_bound(vertices_.begin(), vertices_.end(), vertex) -
                                   vertices_.begin());
}

std::vector<FacetSide> sides_by_edge(std::span<const std::array<std::int32_t, 3>> facets,
                                     std::size_t vertex_count) {
  const auto for_each_side = [&](const auto& visit) {
    for (std::size_t f = 0; f < facets.size(); ++f)
      for (std::size_t c = 0; c < 3; ++c) {
        const auto [a, b] = std::minmax(facets[f][c], facets[f][(c + 1) % 3]);
        visit(FacetSide{a, b, static_cast<std::int32_t>(3 * f + c)});
      }
  };
  std::vector<std::size_t> first(vertex_count + 1, 0);
  for_each_side([&](const FacetSide& side) { ++first[side.a + 1]; });
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<FacetSide> sides(first.back());
  auto next = first;
  for_each_side([&](const FacetSide& side) { sides[next[side.a]++] = side; });
  parallel_for_each_index(0, vertex_count, [&](std::size_t v) {
    std::sort(sides.begin() + static_cast<std::ptrdiff_t>(first[v]),
              sides.begin() + static_cast<std::ptrdiff_t>(first[v + 1]),
              [](const FacetSide& s, const FacetSide& t) {
                return std::tie(s.b, s.place) < std::tie(t.b, t.place);
              });
  });
  return sides;
}

}  // namespace cvmesh
