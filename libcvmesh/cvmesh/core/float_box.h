// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cvmesh {

/// A float on one side of x (sign -1: below, 1: above), two units in the last place away at most;
/// std::nextafter is a call. Infinities, which stand for no box, stay.
inline float rounded_outwards(double x, float sign) {
  using Limits = std::numeric_limits<float>;
  const auto rounded = static_cast<float>(x);
  const float unit = std::min(std::abs(rounded), Limits::max()) * Limits::epsilon();
  return rounded + sign * (unit + Limits::min());
}

/// A box rounded outwards to floats, for searches: half the memory, and what overlaps as `Box3`
/// overlaps here, too. The other way round boxes may differ by rounding.
struct FloatBox {
  FloatBox() = default;

  explicit FloatBox(const Box3& box) {
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = rounded_outwards(box.lo[axis], -1);
      hi[axis] = rounded_outwards(box.hi[axis], 1);
    }
  }

  /// Without branches: of the boxes in the cell of a search one in four overlaps, and no processor
  /// guesses which.
  [[nodiscard]] bool overlaps(const FloatBox& b) const {
    unsigned is_apart = 0;
    for (int axis = 0; axis < 3; ++axis)
      is_apart |= static_cast<unsigned>(lo[axis] > b.hi[axis]) |
                  static_cast<unsigned>(b.lo[axis] > hi[axis]);
    return is_apart == 0;
  }

  std::array<float, 3> lo{}, hi{};
};

}  // namespace cvmesh
