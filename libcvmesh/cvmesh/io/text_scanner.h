// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

// Private to io.
namespace cvmesh::detail {

/// Reads words and numbers, apart by white space, from a text in memory. Everything after a '#' to
/// the end of its line is a comment. Every fault is an `Error` BadInput that names file, line and
/// what stands there.
class TextScanner {
 public:
  TextScanner(const std::filesystem::path& path, std::string_view text);

  /// The next word; empty at the end.
  std::string_view word();
  double real(const char* what);
  std::int64_t integer(const char* what);
  std::int64_t integer(const char* what, std::int64_t least, std::int64_t most);
  /// A number of things of which each takes `least_bytes` of text or more: no larger than the text
  /// can hold, so that it may be allocated.
  std::size_t count(const char* what, std::size_t least_bytes);
  /// The rest of the line.
  std::string_view line();
  /// The last comment that starts with `key`, without it; empty where there is none.
  [[nodiscard]] static std::string_view comment(std::string_view text, std::string_view key);

  [[nodiscard]] std::size_t position() const { return at_; }

  void seek(std::size_t position) { at_ = position; }

  [[noreturn]] void refuse(const std::string& what) const;

 private:
  void skip_space();

  const std::filesystem::path& path_;
  std::string_view text_;
  std::size_t at_ = 0, word_at_ = 0;
};

}  // namespace cvmesh::detail
