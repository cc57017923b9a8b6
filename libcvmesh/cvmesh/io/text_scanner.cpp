// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/text_scanner.h"

#include "cvmesh/io/byte_source.h"

#include <algorithm>
#include <charconv>

namespace cvmesh::detail {
namespace {

constexpr std::size_t kShownCharacters = 40;

bool is_space(char c) {
  return c == ' ' || (c >= '\t' && c <= '\r');
}

/// What stands in the file, for a message: short, and printable.
std::string shown(std::string_view word) {
  if (word.empty()) return "the end of the file";
  std::string text = "'";
  for (const char c : word.substr(0, kShownCharacters))
    text += c >= 0x20 && c < 0x7f ? c : '?';
  return text + (word.size() > kShownCharacters ? "...'" : "'");
}

}  // namespace

TextScanner::TextScanner(const std::filesystem::path& path, std::string_view text)
    : path_(path), text_(text) {}

void TextScanner::refuse(const std::string& what) const {
  const auto lines =
      std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(word_at_), '\n');
  refuse_file(path_, "line " + std::to_string(lines + 1) + ": " + what);
}

void TextScanner::skip_space() {
  while (at_ < text_.size()) {
    if (text_[at_] == '#')
      at_ = std::min(text_.find('\n', at_), text_.size());
    else if (is_space(text_[at_]))
      ++at_;
    else
      return;
  }
}

std::string_view TextScanner::word() {
  skip_space();
  word_at_ = at_;
  while (at_ < text_.size() && !is_space(text_[at_]))
    ++at_;
  return text_.substr(word_at_, at_ - word_at_);
}

std::string_view TextScanner::line() {
  word_at_ = at_;
  const std::size_t end = std::min(text_.find('\n', at_), text_.size());
  const std::string_view result = text_.substr(at_, end - at_);
  at_ = std::min(end + 1, text_.size());
  return result;
}

double TextScanner::real(const char* what) {
  std::string_view text = word();
  if (text.substr(0, 1) == "+") text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size())
    refuse(std::string("expected ") + what + ", a number, found " + shown(text));
  return value;
}

std::int64_t TextScanner::integer(const char* what) {
  const std::string_view text = word();
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size())
    refuse(std::string("expected ") + what + ", an integer, found " + shown(text));
  return value;
}

std::int64_t TextScanner::integer(const char* what, std::int64_t least, std::int64_t most) {
  const std::int64_t value = integer(what);
  if (value < least || value > most)
    refuse(std::string(what) + " (" + std::to_string(value) + ") must be " + std::to_string(least) +
           " to " + std::to_string(most));
  return value;
}

std::size_t TextScanner::count(const char* what, std::size_t least_bytes) {
  // Indices are 32 bit; and one thing needs so many bytes that a file cannot announce more of them
  // than it holds.
  const std::size_t room = (text_.size() - at_) / least_bytes + 1;
  return static_cast<std::size_t>(
      integer(what, 0, static_cast<std::int64_t>(std::min<std::size_t>(room, INT32_MAX))));
}

std::string_view TextScanner::comment(std::string_view text, std::string_view key) {
  std::string_view result;
  for (std::size_t at = text.find('#'); at != std::string_view::npos; at = text.find('#', at + 1)) {
    std::size_t begin = at + 1;
    while (begin < text.size() && text[begin] == ' ')
      ++begin;
    if (text.substr(begin, key.size()) != key) continue;
    begin += key.size();
    std::size_t end = begin;
    while (end < text.size() && !is_space(text[end]))
      ++end;
    result = text.substr(begin, end - begin);
  }
  return result;
}

}  // namespace cvmesh::detail
