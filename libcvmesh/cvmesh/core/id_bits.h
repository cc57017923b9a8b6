// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstdint>
#include <span>

namespace cvmesh {

/// One bit of 64 for each of a few ids: of most others it is seen at once that they are not among
/// them [Bloom 1970].
class IdBits {
 public:
  IdBits() = default;

  explicit IdBits(std::span<const std::int32_t> ids) {
    for (const std::int32_t id : ids)
      add(id);
  }

  void add(std::int32_t id) { bits_ |= bit_of(id); }

  /// False only where `id` is not among the ids.
  [[nodiscard]] bool may_hold(std::int32_t id) const { return (bits_ & bit_of(id)) != 0; }

 private:
  static std::uint64_t bit_of(std::int32_t id) {
    return std::uint64_t{1} << (static_cast<std::uint32_t>(id) & 63U);
  }

  std::uint64_t bits_ = 0;
};

}  // namespace cvmesh
