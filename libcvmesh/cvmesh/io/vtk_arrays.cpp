// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/vtk_arrays.h"

#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/text_scanner.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <limits>
#include <zlib.h>

namespace cvmesh::detail {
namespace {

constexpr std::string_view kBlank = " \t\r\n";

/// A tag of the XML text: `<name a="1" b="2">`, `<name/>` or `</name>`.
struct Tag {
  std::string name;
  std::map<std::string, std::string, std::less<>> attributes;
  bool closes = false, is_empty = false;
  std::size_t end = 0;  // just behind it
};

/// The next tag from `at` on; comments and declarations are passed over. False at the end.
bool next_tag(std::string_view text, std::size_t at, Tag& tag) {
  for (;;) {
    at = text.find('<', at);
    if (at == std::string_view::npos) return false;
    if (text.substr(at, 4) == "<!--")
      at = text.find("-->", at);
    else if (text.substr(at, 2) == "<?" || text.substr(at, 2) == "<!")
      at = text.find('>', at);
    else
      break;
    if (at == std::string_view::npos) return false;
  }
  // The tag ends at the first '>' outside quotes.
  std::size_t end = at + 1;
  char quote = 0;
  for (; end < text.size() && (quote != 0 || text[end] != '>'); ++end) {
    if (quote == 0 && (text[end] == '"' || text[end] == '\''))
      quote = text[end];
    else if (text[end] == quote)
      quote = 0;
  }
  if (end == text.size()) return false;
  std::string_view inner = text.substr(at + 1, end - at - 1);
  tag = {};
  tag.end = end + 1;
  if (inner.substr(0, 1) == "/") {
    tag.closes = true;
    inner.remove_prefix(1);
  }
  if (!inner.empty() && inner.back() == '/') {
    tag.is_empty = true;
    inner.remove_suffix(1);
  }
  std::size_t i = std::min(inner.find_first_of(kBlank), inner.size());
  tag.name = inner.substr(0, i);
  while ((i = inner.find_first_not_of(kBlank, i)) != std::string_view::npos) {
    const std::size_t equals = inner.find('=', i);
    if (equals == std::string_view::npos) break;
    const std::size_t open = inner.find_first_of("\"'", equals);
    if (open == std::string_view::npos) break;
    const std::size_t close = inner.find(inner[open], open + 1);
    if (close == std::string_view::npos) break;
    const std::string_view key = inner.substr(i, equals - i);
    tag.attributes[std::string(key.substr(0, key.find_first_of(kBlank)))] =
        inner.substr(open + 1, close - open - 1);
    i = close + 1;
  }
  return true;
}

int base64_digit(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  if (c == '+') return 62;
  return c == '/' ? 63 : -1;
}

/// Bytes that stand in a text, raw or as base64, taken from the front. Base64 may be padded in
/// between, where a header and its data were encoded apart.
class Bytes {
 public:
  Bytes(std::string_view text, bool is_base64) : text_(text), is_base64_(is_base64) {}

  /// How many there can be at most.
  [[nodiscard]] std::uint64_t at_most() const { return text_.size() - at_ + ready_.size(); }

  /// False where fewer are left.
  bool take(std::size_t count, std::string& result) {
    if (count > at_most()) return false;
    if (!is_base64_) {
      result.assign(text_.substr(at_, count));
      at_ += count;
      return result.size() == count;
    }
    while (ready_.size() < count)
      if (!decode_group()) return false;
    result = ready_.substr(0, count);
    ready_.erase(0, count);
    return true;
  }

 private:
  bool decode_group() {
    std::array<int, 4> digit{};
    int digits = 0, read = 0;
    while (read < 4) {
      at_ = std::min(text_.find_first_not_of(kBlank, at_), text_.size());
      if (at_ == text_.size()) return false;
      const char c = text_[at_++];
      ++read;
      if (c == '=') continue;
      if ((digit[digits] = base64_digit(c)) < 0 || digits + 1 != read) return false;
      ++digits;
    }
    if (digits < 2) return false;
    const int bits = digit[0] << 18 | digit[1] << 12 | digit[2] << 6 | digit[3];
    for (int k = 0; k + 1 < digits; ++k)
      ready_ += static_cast<char>(bits >> (16 - 8 * k) & 0xff);
    return true;
  }

  std::string_view text_;
  bool is_base64_;
  std::size_t at_ = 0;
  std::string ready_;
};

std::size_t bytes_of_type(const std::string& type) {
  if (type == "Int8" || type == "UInt8") return 1;
  if (type == "Int16" || type == "UInt16") return 2;
  if (type == "Int32" || type == "UInt32" || type == "Float32") return 4;
  if (type == "Int64" || type == "UInt64" || type == "Float64") return 8;
  return 0;
}

template <typename From, typename To>
void convert(const std::string& bytes, std::vector<To>& result) {
  result.resize(bytes.size() / sizeof(From));
  for (std::size_t i = 0; i < result.size(); ++i) {
    From value;
    std::memcpy(&value, bytes.data() + i * sizeof(From), sizeof(From));
    result[i] = static_cast<To>(value);
  }
}

VtkValues from_bytes(const std::string& bytes, const std::string& type) {
  VtkValues values;
  if (type == "Float32") convert<float>(bytes, values.reals);
  if (type == "Float64") convert<double>(bytes, values.reals);
  if (type == "Int8") convert<std::int8_t>(bytes, values.integers);
  if (type == "UInt8") convert<std::uint8_t>(bytes, values.integers);
  if (type == "Int16") convert<std::int16_t>(bytes, values.integers);
  if (type == "UInt16") convert<std::uint16_t>(bytes, values.integers);
  if (type == "Int32") convert<std::int32_t>(bytes, values.integers);
  if (type == "UInt32") convert<std::uint32_t>(bytes, values.integers);
  if (type == "Int64" || type == "UInt64") convert<std::int64_t>(bytes, values.integers);
  return values;
}

std::uint64_t number(const std::string& bytes, std::size_t index, std::size_t size) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.data() + index * size, size);  // little endian, as we are
  return value;
}

}  // namespace

std::string VtkArray::attribute(std::string_view key) const {
  const auto found = attributes.find(key);
  return found == attributes.end() ? std::string() : found->second;
}

void VtkFile::refuse(const std::string& what) const {
  refuse_file(path_, what);
}

VtkFile::VtkFile(const std::filesystem::path& path, std::string_view text, const std::string& type)
    : path_(path), text_(text) {
  std::vector<std::string> open;
  std::size_t at = 0;
  bool in_piece = false;
  for (Tag tag; next_tag(text, at, tag); at = tag.end) {
    if (tag.closes) {
      if (open.empty() || open.back() != tag.name)
        refuse("is damaged: </" + tag.name.substr(0, 40) + "> does not close what is open");
      if (tag.name == "Piece") in_piece = false;
      open.pop_back();
      continue;
    }
    if (tag.name == "VTKFile") file_ = tag.attributes;
    if (tag.name == "Piece") {
      pieces_.push_back(tag.attributes);
      in_piece = !tag.is_empty;
    }
    if (tag.name == "DataArray" || tag.name == "Array") {
      VtkArray array{open.empty() ? "" : open.back(), tag.attributes, {}};
      if (in_piece) array.piece = pieces_.size() - 1;
      if (!tag.is_empty) array.text = text.substr(tag.end, text.find('<', tag.end) - tag.end);
      arrays_.push_back(std::move(array));
    }
    if (tag.name == "AppendedData") {
      is_appended_base64_ = tag.attributes["encoding"] == "base64";
      const std::size_t mark = text.find('_', tag.end);
      if (mark == std::string_view::npos) refuse("is damaged: the appended data has no '_'");
      appended_ = text.substr(mark + 1);
      break;  // what follows may be raw bytes
    }
    if (!tag.is_empty) open.push_back(tag.name);
  }
  if (file_["type"] != type) refuse("is no VTK XML file of type " + type);
  if (pieces_.empty()) refuse("has no piece");
  if (!file_["byte_order"].empty() && file_["byte_order"] != "LittleEndian")
    refuse("is stored in the byte order " + file_["byte_order"].substr(0, 20) +
           "; write it as LittleEndian");
  if (!file_["compressor"].empty() && file_["compressor"] != "vtkZLibDataCompressor")
    refuse("is compressed by " + file_["compressor"].substr(0, 40) +
           "; write it with vtkZLibDataCompressor or without compression");
}

std::size_t VtkFile::piece_count(std::size_t piece, const std::string& key) const {
  const auto found = pieces_[piece].find(key);
  const std::string text = found == pieces_[piece].end() ? "" : found->second;
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size() ||
      value > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    refuse(key + " ('" + text.substr(0, 40) + "') must be 0 to 2147483647");
  return value;
}

const VtkArray* VtkFile::find(std::optional<std::size_t> piece,
                              std::string_view section,
                              std::string_view name) const {
  for (const VtkArray& array : arrays_)
    if (array.piece == piece && array.section == section && (name.empty() || array.name() == name))
      return &array;
  return nullptr;
}

std::string VtkFile::bytes_of(const VtkArray& array, std::size_t count) const {
  const std::string where = "the array '" + array.name().substr(0, 40) + "' ";
  const std::size_t wanted = count * bytes_of_type(array.attribute("type"));
  const bool is_appended = array.attribute("format") == "appended";
  std::string_view text = array.text;
  if (is_appended) {
    const std::string offset = array.attribute("offset");
    std::size_t first = 0;
    const auto [end, error] = std::from_chars(offset.data(), offset.data() + offset.size(), first);
    if (error != std::errc() || first > appended_.size())
      refuse(where + "starts at byte '" + offset.substr(0, 40) + "' of " +
             std::to_string(appended_.size()) + " appended ones");
    text = appended_.substr(first);
  }
  Bytes source(text, is_appended ? is_appended_base64_ : true);
  const auto header_type = file_.find("header_type");
  const std::size_t word = header_type != file_.end() && header_type->second == "UInt64" ? 8 : 4;
  const auto take = [&](std::size_t bytes) {
    std::string result;
    if (!source.take(bytes, result)) refuse(where + "ends early, or is no base64");
    return result;
  };
  const auto check_size = [&](std::uint64_t bytes) {
    if (bytes != wanted)
      refuse(where + "has " + std::to_string(bytes) + " bytes instead of " +
             std::to_string(wanted));
  };
  const auto compressor = file_.find("compressor");
  if (compressor == file_.end() || compressor->second.empty()) {
    check_size(number(take(word), 0, word));
    return take(wanted);
  }
  // Number of blocks, bytes of each, bytes of the last if it is shorter, stored bytes of each.
  const std::string header = take(3 * word);
  const std::uint64_t blocks = number(header, 0, word), block_bytes = number(header, 1, word),
                      last_bytes = number(header, 2, word);
  if (blocks > source.at_most() / word)
    refuse(where + "has " + std::to_string(blocks) + " blocks, more than the file can hold");
  const std::uint64_t whole =
      last_bytes == 0 ? blocks : blocks - std::min<std::uint64_t>(blocks, 1);
  if (whole > 0 && block_bytes > wanted / whole)
    refuse(where + "has more bytes than " + std::to_string(wanted));
  check_size(whole * block_bytes + (blocks > 0 ? last_bytes : 0));
  if (wanted > source.at_most() * kMaxDeflateRatio)
    refuse(where + "has more bytes (" + std::to_string(wanted) + ") than its compressed data can");
  const std::string stored = take(blocks * word);
  std::string result(wanted, '\0');
  std::size_t done = 0;
  for (std::uint64_t b = 0; b < blocks; ++b) {
    const std::string packed = take(number(stored, b, word));
    const std::uint64_t bytes = b < whole ? block_bytes : last_bytes;
    uLongf inflated = bytes;
    const int rc = ::uncompress(reinterpret_cast<Bytef*>(result.data() + done), &inflated,
                                reinterpret_cast<const Bytef*>(packed.data()), packed.size());
    if (rc != Z_OK || inflated != bytes)
      refuse(where + "is damaged: block " + std::to_string(b) + " does not inflate");
    done += bytes;
  }
  return result;
}

VtkValues VtkFile::values(const VtkArray& array, std::size_t count) const {
  const std::string type = array.attribute("type"), format = array.attribute("format");
  const std::string where = "the array '" + array.name().substr(0, 40) + "' ";
  if (bytes_of_type(type) == 0) refuse(where + "has the type '" + type.substr(0, 40) + "'");
  if (format == "binary" || format == "appended") return from_bytes(bytes_of(array, count), type);
  VtkValues values;
  if (count > array.text.size())
    refuse(where + "has fewer than " + std::to_string(count) + " values");
  if (count == 0) return values;
  // From the start of the file, so that messages tell its lines, to the end of the array.
  const auto first = static_cast<std::size_t>(array.text.data() - text_.data());
  TextScanner scanner(path_, text_.substr(0, first + array.text.size()));
  scanner.seek(first);
  for (std::size_t i = 0; i < count; ++i) {
    if (type == "Float32" || type == "Float64")
      values.reals.push_back(scanner.real("a value"));
    else
      values.integers.push_back(scanner.integer("a value"));
  }
  return values;
}

std::vector<std::int64_t> VtkFile::integers(const VtkArray& array, std::size_t count) const {
  VtkValues found = values(array, count);
  if (found.reals.empty()) return std::move(found.integers);
  std::vector<std::int64_t> result;
  result.reserve(found.reals.size());
  for (const double value : found.reals) {
    constexpr double kMost = 9007199254740992.0;  // 2^53
    if (!(value >= -kMost && value <= kMost) ||
        value != static_cast<double>(static_cast<std::int64_t>(value)))
      refuse("the array '" + array.name().substr(0, 40) + "' has the value " +
             std::to_string(value) + ", which is no integer");
    result.push_back(static_cast<std::int64_t>(value));
  }
  return result;
}

}  // namespace cvmesh::detail
