// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cstdint>

namespace cvmesh {

/// Two doubles in one register of every 64-bit processor; a vector extension that GCC and Clang
/// share. The results are those of the same operations one at a time.
using DoublePair [[gnu::vector_size(16)]] = double;
/// What a comparison of two such pairs gives: all bits of a lane set, or none.
using MaskPair [[gnu::vector_size(16)]] = std::int64_t;

inline DoublePair larger_of(const DoublePair& a, const DoublePair& b) {
  return a > b ? a : b;
}

inline DoublePair smaller_of(const DoublePair& a, const DoublePair& b) {
  return a < b ? a : b;
}

inline DoublePair both(double x) {
  return DoublePair{x, x};
}

/// Two points, a lane each.
struct Vec3Pair {
  Vec3Pair() = default;

  Vec3Pair(const Vec3& a, const Vec3& b) : x{a.x, b.x}, y{a.y, b.y}, z{a.z, b.z} {}

  [[nodiscard]] Vec3 at(int lane) const { return {x[lane], y[lane], z[lane]}; }

  DoublePair x{}, y{}, z{};
};

}  // namespace cvmesh
