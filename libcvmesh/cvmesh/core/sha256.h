// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace cvmesh {

/// SHA-256 of bytes that come in pieces [FIPS 180-4].
class Sha256 {
 public:
  void add(std::string_view bytes);
  /// The 64 hexadecimal digits; nothing may be added afterwards.
  std::string hex();

 private:
  void add_block(const unsigned char* block);

  static constexpr std::size_t kBlock = 64;
  std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<unsigned char, kBlock> rest_{};  ///< bytes that do not fill a block yet
  std::size_t rest_count_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace cvmesh
