// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/set_names.h"

#include "cvmesh/io/output_tables.h"

#include <algorithm>
#include <array>
#include <map>

namespace cvmesh {
namespace {

/// The longest set name: Abaqus and CalculiX allow 80 characters, older readers 64. Two are for a
/// prefix such as "N_".
constexpr std::size_t kMaxPlainInterface = 62;
/// Two of them, an underscore and "_XMIN" are kMaxPlainInterface.
constexpr std::size_t kMaxPlainLabel = 28;
/// Gmsh reads names of physical groups into 128 bytes.
constexpr std::size_t kMaxQuotableInterface = 127;
/// Two of them, " | " and ", x-" are kMaxQuotableInterface.
constexpr std::size_t kMaxQuotableLabel = 60;
constexpr std::array<const char*, 7> kWallSuffixes = {"",      "_XMIN", "_XMAX", "_YMIN",
                                                      "_YMAX", "_ZMIN", "_ZMAX"};
constexpr std::array<const char*, 7> kQuotableWalls = {"",     ", x-", ", x+", ", y-",
                                                       ", y+", ", z-", ", z+"};

std::string plain_name(const std::string& name) {
  std::string legal;
  for (const char c : name) {
    // Not std::toupper: the locale must not decide.
    if (c >= 'a' && c <= 'z')
      legal += static_cast<char>(c - 'a' + 'A');
    else if ((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'))
      legal += c;
    else if (!legal.empty() && legal.back() != '_')
      legal += '_';
  }
  legal.resize(std::min(legal.size(), kMaxPlainLabel));
  while (!legal.empty() && legal.back() == '_')
    legal.pop_back();
  return legal;
}

std::string quotable_name(const std::string& name) {
  std::string text = one_line(name);
  std::replace(text.begin(), text.end(), '"', '\'');
  return cut_between_characters(text, kMaxQuotableLabel);
}

std::string with_suffix(const std::string& name, const std::string& suffix, std::size_t max_size) {
  std::string text = cut_between_characters(name, max_size - suffix.size());
  if (text.back() == '_') text.pop_back();
  return text + suffix;
}

/// Gives every name that is not alone its suffix. Suffixes begin with a character that separates
/// and are all different, so names that have theirs are different, and every round gives one to
/// names that had none: it ends. Names with an empty suffix stay as they are.
void make_unique(std::vector<std::string>& names,
                 const std::vector<std::string>& suffixes,
                 std::size_t max_size) {
  for (bool is_unique = false; !is_unique;) {
    is_unique = true;
    std::map<std::string, int> uses;
    for (const std::string& name : names)
      ++uses[name];
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (uses[names[i]] == 1 || suffixes[i].empty()) continue;
      names[i] = with_suffix(names[i], suffixes[i], max_size);
      is_unique = false;
    }
  }
}

std::string plain_suffix(Label label) {
  std::string text = "_" + std::to_string(label);
  std::replace(text.begin(), text.end(), '-', 'M');
  return text;
}

template <typename Compose>
std::vector<std::string> interface_names(const std::vector<PatchKey>& patches,
                                         const Compose& compose,
                                         const std::string& separator,
                                         std::size_t max_size) {
  std::vector<std::string> names, suffixes;
  for (const PatchKey& patch : patches) {
    names.push_back(compose(patch));
    suffixes.push_back(separator + std::to_string(names.size()));
  }
  make_unique(names, suffixes, max_size);
  return names;
}

}  // namespace

std::vector<std::string> plain_label_names(const LabelVolume& labels) {
  std::vector<std::string> names, suffixes;
  for (std::size_t id = 0; id < labels.material_count(); ++id) {
    const bool is_exterior = id == kExterior;
    suffixes.push_back(is_exterior ? "" : plain_suffix(labels.label_of[id]));
    names.push_back(is_exterior ? "EXTERIOR" : plain_name(labels.name_of[id]));
    if (names.back().empty()) names.back() = "LABEL" + suffixes.back();
  }
  make_unique(names, suffixes, kMaxPlainLabel);
  return names;
}

std::vector<std::string> plain_interface_names(const std::vector<PatchKey>& patches,
                                               const std::vector<std::string>& name_of) {
  const auto compose = [&](const PatchKey& patch) {
    return name_of[patch.sides.inside] + "_" + name_of[patch.sides.outside] +
           kWallSuffixes.at(patch.wall);
  };
  return interface_names(patches, compose, "_", kMaxPlainInterface);
}

std::vector<std::string> quotable_label_names(const LabelVolume& labels) {
  std::vector<std::string> names, suffixes;
  for (std::size_t id = 0; id < labels.material_count(); ++id) {
    const bool is_exterior = id == kExterior;
    const std::string value = std::to_string(labels.label_of[id]);
    suffixes.push_back(is_exterior ? "" : " (" + value + ")");
    names.push_back(is_exterior ? "exterior" : quotable_name(labels.name_of[id]));
    const bool is_blank = names.back().find_first_not_of(' ') == std::string::npos;
    if (is_blank) names.back() = "label " + value;
  }
  make_unique(names, suffixes, kMaxQuotableLabel);
  return names;
}

std::vector<std::string> quotable_interface_names(const std::vector<PatchKey>& patches,
                                                  const std::vector<std::string>& name_of) {
  const auto compose = [&](const PatchKey& patch) {
    return name_of[patch.sides.inside] + " | " + name_of[patch.sides.outside] +
           kQuotableWalls.at(patch.wall);
  };
  return interface_names(patches, compose, " #", kMaxQuotableInterface);
}

std::string cut_between_characters(std::string text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  std::size_t end = max_bytes;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U)
    --end;
  text.resize(end);
  return text;
}

}  // namespace cvmesh
