// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

namespace cvmesh::detail {

/// @throws Error BadInput "read: 'PATH' what"; `what` tells the value, the bound and the way out
[[noreturn]] void refuse_file(const std::filesystem::path& path, const std::string& what);

/// How bytes are stored in a file.
enum class Storage {
  Raw,
  Gzip,  ///< one or more gzip members, each with its CRC and length
  Zlib,  ///< a zlib stream (or a gzip member) with its checksum
};

/// The bytes of a part of a file, decompressed on the fly with every checksum verified.
class ByteSource {
 public:
  /// The part starts at `first` and is `count` bytes long as stored (to the end by default).
  /// @throws Error BadInput when the file is missing, no regular file, or cannot be opened
  explicit ByteSource(const std::filesystem::path& path,
                      Storage storage,
                      std::uint64_t first = 0,
                      std::uint64_t count = UINT64_MAX);
  ~ByteSource();
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;

  /// Fills `target` with the next `count` bytes; fewer only where the data ends.
  /// @throws Error BadInput on a damaged stream
  std::size_t read(void* target, std::size_t count);
  /// Reads to the end, so that the checksums that follow the data are verified too.
  /// @throws Error BadInput on a damaged stream, or when more than `most` bytes were left
  void finish(std::uint64_t most);

  /// Bytes of the part as stored; an upper bound of what can be inflated follows from it.
  [[nodiscard]] std::uint64_t stored_bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// The whole file as it is stored. @throws Error BadInput as the constructor of `ByteSource`
std::string read_content(const std::filesystem::path& path);

/// Whether the file starts with the two bytes of a gzip member.
bool is_gzip(const std::filesystem::path& path);

/// Deflate cannot shrink data by more than this factor (RFC 1951: 258 bytes in two bits).
inline constexpr std::uint64_t kMaxDeflateRatio = 1032;

}  // namespace cvmesh::detail
