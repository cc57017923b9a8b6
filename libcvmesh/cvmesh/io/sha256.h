// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

namespace cvmesh {

/// SHA-256 [FIPS 180-4] of bytes that come in parts.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void update(std::span<const std::byte> bytes);
  /// The digest as 64 hexadecimal digits; nothing may be added after it.
  std::string hex();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// The digest of a whole file as it is stored: what `sha256sum` prints.
/// @throws Error BadInput when it cannot be read
std::string sha256_of_file(const std::filesystem::path& path);

/// The digest of values as they lie in memory; on the little-endian machines that cvmesh runs on,
/// that of the little-endian values.
template <typename T>
std::string sha256_of_values(std::span<const T> values) {
  Sha256 hash;
  hash.update(std::as_bytes(values));
  return hash.hex();
}

}  // namespace cvmesh
