// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/label_names.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/utf8.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/volume_header.h"

#include <charconv>
#include <fstream>
#include <string_view>
#include <system_error>
#include <vector>

namespace cvmesh {
namespace {

constexpr char kForms[] =
    "give lines like '2 0 255 0 1 1 1 \"cement\"' (ITK-SNAP label descriptions) or "
    "'2 cement 0 255 0 255' (3D Slicer colour table)";
constexpr std::size_t kSnapNumbers = 7;
constexpr std::size_t kSlicerWords = 6;

struct Place {
  const std::filesystem::path& path;
  std::size_t line;
};

[[noreturn]] void refuse(const Place& place, const std::string& message) {
  throw Error(ErrorCode::BadParameter, "label names",
              "'" + place.path.string() + "', line " + std::to_string(place.line) + ": " + message);
}

template <typename Number>
bool is_number(std::string_view word, Number& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc{} && end == word.data() + word.size();
}

void check_numbers(const Place& place,
                   const std::vector<std::string>& words,
                   std::size_t first,
                   std::size_t count) {
  for (std::size_t i = first; i < first + count; ++i) {
    double ignored = 0;
    if (!is_number(words[i], ignored))
      refuse(place, detail::in_quotes(words[i]) + " is no number; " + kForms);
  }
}

Label label_of(const Place& place, const std::string& word) {
  Label label = 0;
  if (!is_number(word, label))
    refuse(place, detail::in_quotes(word) + " is no label value; " + kForms);
  return label;
}

std::pair<Label, std::string> read_snap_entry(const Place& place, std::string_view line) {
  const std::size_t first = line.find('"'), last = line.rfind('"');
  if (first == std::string_view::npos || first == last)
    refuse(place, std::string("the name has no quotes around it; ") + kForms);
  const std::vector<std::string> words = detail::split_words(line.substr(0, first));
  if (words.size() != kSnapNumbers || !detail::trimmed(line.substr(last + 1)).empty())
    refuse(place, std::to_string(words.size()) + " numbers before the name rather than " +
                      std::to_string(kSnapNumbers) + ", or text after it; " + kForms);
  check_numbers(place, words, 1, kSnapNumbers - 1);
  return {label_of(place, words[0]), std::string(line.substr(first + 1, last - first - 1))};
}

std::pair<Label, std::string> read_slicer_entry(const Place& place, std::string_view line) {
  const std::vector<std::string> words = detail::split_words(line);
  if (words.size() != kSlicerWords)
    refuse(place, std::to_string(words.size()) + " words rather than " +
                      std::to_string(kSlicerWords) + "; " + kForms);
  check_numbers(place, words, 2, kSlicerWords - 2);
  return {label_of(place, words[0]), words[1]};
}

}  // namespace

std::map<Label, std::string> read_label_names(const std::filesystem::path& path) {
  std::error_code ignored;
  require(std::filesystem::is_regular_file(path, ignored), ErrorCode::BadParameter, "label names",
          "'" + path.string() + "' is no file; check the path");
  std::ifstream stream(path);
  require(stream.good(), ErrorCode::BadParameter, "label names",
          "'" + path.string() + "' cannot be read; check the path");
  std::map<Label, std::string> names;
  bool is_snap = false;
  std::string text;
  for (std::size_t number = 1; std::getline(stream, text); ++number) {
    const std::string_view line = detail::trimmed(text);
    if (line.empty() || line[0] == '#') continue;
    const Place place{path, number};
    // Other encodings would make files that no XML reader takes.
    if (!is_utf8(line)) refuse(place, "the name is no UTF-8; save the file as UTF-8");
    if (names.empty()) is_snap = line.find('"') != std::string_view::npos;
    auto [label, name] = is_snap ? read_snap_entry(place, line) : read_slicer_entry(place, line);
    name = one_line(name);
    if (detail::trimmed(name).empty())
      refuse(place, "label " + std::to_string(label) + " has an empty name; give it one");
    if (!names.emplace(label, name).second)
      refuse(place, "label " + std::to_string(label) + " was named before; keep one of the two");
  }
  require(!stream.bad(), ErrorCode::BadParameter, "label names",
          "'" + path.string() + "' cannot be read to its end; copy it again");
  require(!names.empty(), ErrorCode::BadParameter, "label names",
          "'" + path.string() + "' has no entry; " + kForms);
  return names;
}

}  // namespace cvmesh
