// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cmath>
#include <cstdint>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

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

inline DoublePair square_root(const DoublePair& x) {
#ifdef __SSE2__
  return _mm_sqrt_pd(x);
#else
  return DoublePair{std::sqrt(x[0]), std::sqrt(x[1])};
#endif
}

/// Two points, a lane each.
struct Vec3Pair {
  Vec3Pair() = default;

  Vec3Pair(const Vec3& a, const Vec3& b) : x{a.x, b.x}, y{a.y, b.y}, z{a.z, b.z} {}

  Vec3Pair(const DoublePair& x_of_both, const DoublePair& y_of_both, const DoublePair& z_of_both)
      : x(x_of_both), y(y_of_both), z(z_of_both) {}

  [[nodiscard]] Vec3 at(int lane) const { return {x[lane], y[lane], z[lane]}; }

  DoublePair x{}, y{}, z{};
};

inline Vec3Pair operator+(const Vec3Pair& a, const Vec3Pair& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}

inline Vec3Pair operator-(const Vec3Pair& a, const Vec3Pair& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

inline Vec3Pair operator-(const Vec3Pair& a) {
  return {-a.x, -a.y, -a.z};
}

inline DoublePair dot(const Vec3Pair& a, const Vec3Pair& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline Vec3Pair cross(const Vec3Pair& a, const Vec3Pair& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline DoublePair squared_norm(const Vec3Pair& a) {
  return dot(a, a);
}

}  // namespace cvmesh
