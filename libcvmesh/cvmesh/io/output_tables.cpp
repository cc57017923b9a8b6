// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/output_tables.h"

#include <algorithm>
#include <charconv>

namespace cvmesh {
namespace {

constexpr std::array<const char*, 7> kWallNames = {"", "x-", "x+", "y-", "y+", "z-", "z+"};

std::string describe_side(const LabelVolume& labels, MaterialId material) {
  const Label label = material == kExterior ? exterior_label(labels) : labels.label_of[material];
  const std::string text = "label " + std::to_string(label);
  if (material == kExterior) return text + " (exterior)";
  return text + " \"" + one_line(labels.name_of[material]) + "\"";
}

}  // namespace

Label exterior_label(const LabelVolume& labels) {
  const auto& used = labels.label_of;
  if (used.empty()) return 0;
  Label candidate = 0;
  while (std::find(used.begin() + 1, used.end(), candidate) != used.end())
    --candidate;
  return candidate;
}

std::vector<Label> output_labels(const LabelVolume& labels) {
  std::vector<Label> result = labels.label_of;
  if (!result.empty()) result[kExterior] = exterior_label(labels);
  return result;
}

InterfaceTable interface_table(const InterfaceMesh& mesh) {
  InterfaceTable table;
  table.patches = mesh.patch_of;
  std::sort(table.patches.begin(), table.patches.end());
  table.patches.erase(std::unique(table.patches.begin(), table.patches.end()), table.patches.end());
  table.index_of.reserve(mesh.patch_of.size());
  for (const PatchKey& patch : mesh.patch_of) {
    const auto row = std::lower_bound(table.patches.begin(), table.patches.end(), patch);
    table.index_of.push_back(static_cast<std::int32_t>(row - table.patches.begin()) + 1);
  }
  return table;
}

std::string describe_interface(const PatchKey& patch, const LabelVolume& labels) {
  std::string text = "inside " + describe_side(labels, patch.sides.inside) + " | outside " +
                     describe_side(labels, patch.sides.outside);
  if (patch.wall > 0 && patch.wall < kWallNames.size())
    text += std::string(", box face ") + kWallNames[patch.wall];
  return text;
}

void append_number(std::string& text, double value) {
  char digits[32];
  const auto result = std::to_chars(digits, digits + sizeof digits, value);
  text.append(digits, result.ptr);
}

void append_number(std::string& text, std::int64_t value) {
  char digits[24];
  const auto result = std::to_chars(digits, digits + sizeof digits, value);
  text.append(digits, result.ptr);
}

void append_point(std::string& text, const Vec3& p, char separator) {
  for (int axis = 0; axis < 3; ++axis) {
    if (axis > 0) text += separator;
    append_number(text, p[axis]);
  }
}

std::string one_line(const std::string& name) {
  std::string text = name;
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return text;
}

}  // namespace cvmesh
