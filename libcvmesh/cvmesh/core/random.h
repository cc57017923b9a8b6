// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstdint>
#include <numeric>
#include <string_view>
#include <vector>

namespace cvmesh {

/// Random numbers as a function of (seed, stage, element, draw), never of a thread or of call
/// order. The mixing function is SplitMix64's finaliser [Steele 2014].
class CounterRandom {
 public:
  CounterRandom(std::uint64_t seed, std::string_view stage) : key_(mix(seed)) {
    for (const char c : stage)
      key_ = mix(key_ ^ static_cast<unsigned char>(c));
  }

  [[nodiscard]] std::uint64_t bits(std::uint64_t element, std::uint64_t draw = 0) const {
    return mix(mix(key_ + element * 0x9e3779b97f4a7c15ULL) ^ mix(draw + 0x632be59bd9b4e019ULL));
  }

  /// Uniform in [0, 1).
  [[nodiscard]] double uniform(std::uint64_t element, std::uint64_t draw = 0) const {
    return static_cast<double>(bits(element, draw) >> 11) * 0x1.0p-53;
  }

  /// A random permutation of 0..count-1 (Fisher-Yates).
  [[nodiscard]] std::vector<std::int32_t> permutation(std::size_t count) const {
    std::vector<std::int32_t> order(count);
    std::iota(order.begin(), order.end(), 0);
    for (std::size_t i = count; i > 1; --i)
      std::swap(order[i - 1], order[bits(i) % i]);
    return order;
  }

 private:
  static std::uint64_t mix(std::uint64_t z) {
    z += 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }

  std::uint64_t key_;
};

}  // namespace cvmesh
