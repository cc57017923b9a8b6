// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace cvmesh {

/// Numbers the vertices of some facets from 0 on, in ascending order: through a table where they
/// lie close together, by searching where they are scattered. Linear, but for the latter.
class LocalNumbers {
 public:
  explicit LocalNumbers(std::span<const std::array<std::int32_t, 3>> facets);

  /// The number of a vertex of one of the facets.
  [[nodiscard]] std::int32_t operator()(std::int32_t vertex) const;

  /// The vertex of each number.
  [[nodiscard]] const std::vector<std::int32_t>& vertices() const { return vertices_; }

 private:
  std::vector<std::int32_t> vertices_;
  std::int32_t least_ = 0;
  std::vector<std::int32_t> number_of_;  // by vertex, from the least one on; empty: search
};

/// A side of a facet.
struct FacetSide {
  std::int32_t a, b;   ///< its ends, a < b
  std::int32_t place;  ///< three times the facet, plus the corner that the side starts from
};

/// The sides of all facets in the order of (a, b, place), so that those of an edge stand together.
/// Linear: they are counted by a, and those of one vertex are few.
/// @param facets  by vertices from 0 to `vertex_count` - 1
std::vector<FacetSide> sides_by_edge(std::span<const std::array<std::int32_t, 3>> facets,
                                     std::size_t vertex_count);

}  // namespace cvmesh
