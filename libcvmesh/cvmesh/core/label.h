// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <compare>
#include <cstdint>

namespace cvmesh {

/// The user's value of a material, as in the input file. Lives in `io`, reports and names only.
using Label = std::int32_t;

/// Compact id of a material inside a run: 0 is the exterior, 1..n the meshed labels in ascending
/// order of their values.
using MaterialId = std::uint16_t;

inline constexpr MaterialId kExterior = 0;

/// The two materials of an interface facet, `inside > outside`; the facet normal points from
/// inside to outside.
struct Sides {
  MaterialId inside = 0, outside = 0;
  friend bool operator==(const Sides&, const Sides&) = default;
  friend auto operator<=>(const Sides&, const Sides&) = default;
};

}  // namespace cvmesh
