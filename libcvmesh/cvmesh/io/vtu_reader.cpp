// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/vtk_arrays.h"

#include <algorithm>
#include <array>
#include <limits>

namespace cvmesh::detail {
namespace {

constexpr std::int64_t kVtkTetra = 10, kVtkQuadraticTetra = 24;
constexpr std::array<const char*, 6> kLabelArrays = {
    "labels", "material", "ref", "medit:ref", "gmsh:physical", "gmsh:geometrical"};

const VtkArray& array_of(const VtkFile& file, const char* section, const char* name) {
  const VtkArray* array = file.find(section, name);
  if (array == nullptr)
    file.refuse(std::string("has no array '") + name + "' in <" + section + ">");
  return *array;
}

const VtkArray& label_array(const VtkFile& file) {
  for (const char* name : kLabelArrays)
    if (const VtkArray* array = file.find("CellData", name)) return *array;
  std::string names, others;
  for (const char* name : kLabelArrays)
    names += std::string(names.empty() ? "" : ", ") + name;
  for (const VtkArray& array : file.arrays())
    if (array.section == "CellData") others += (others.empty() ? "" : ", ") + array.name();
  file.refuse("has no cell array of labels (" + names + "); it has " +
              (others.empty() ? "none" : others.substr(0, 200)));
}

/// SPACE, as cvmesh states it: the character codes of a word.
std::optional<Space> space_of(const VtkFile& file) {
  constexpr std::size_t kMostCharacters = 16;
  const VtkArray* array = file.find("FieldData", "SPACE");
  if (array == nullptr || array->attribute("type") != "UInt8") return std::nullopt;
  const std::string tuples = array->attribute("NumberOfTuples");
  if (tuples.empty() || tuples.size() > 2 ||
      !std::all_of(tuples.begin(), tuples.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return std::nullopt;
  std::string name;
  for (const std::int64_t code :
       file.integers(*array, std::min<std::size_t>(kMostCharacters, std::stoul(tuples))))
    if (code > 0 && code < 0x7f) name += static_cast<char>(code);
  return space_of_name(name);
}

std::vector<Vec3> read_points(const VtkFile& file) {
  const std::size_t count = file.piece_count("NumberOfPoints");
  const VtkArray* array = file.find("Points", "");
  if (array == nullptr) file.refuse("has no points");
  const VtkValues values = file.values(*array, 3 * count);
  std::vector<Vec3> points(count);
  for (std::size_t i = 0; i < count; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t at = 3 * i + static_cast<std::size_t>(axis);
      points[i][axis] =
          values.reals.empty() ? static_cast<double>(values.integers[at]) : values.reals[at];
    }
  return points;
}

}  // namespace

TetFile read_vtu(const std::filesystem::path& path, const std::string& content) {
  const VtkFile file(path, content, "UnstructuredGrid");
  TetFile result;
  result.space = space_of(file);
  result.points = read_points(file);
  const std::size_t cells = file.piece_count("NumberOfCells");
  const auto types = file.integers(array_of(file, "Cells", "types"), cells);
  const auto offsets = file.integers(array_of(file, "Cells", "offsets"), cells);
  for (std::size_t c = 0; c < cells; ++c)
    if (offsets[c] < (c > 0 ? offsets[c - 1] : 0))
      file.refuse("the offset of cell " + std::to_string(c) + " (" + std::to_string(offsets[c]) +
                  ") is below the one before");
  const std::size_t nodes = cells > 0 ? static_cast<std::size_t>(offsets.back()) : 0;
  if (nodes > content.size() * kMaxDeflateRatio)
    file.refuse("the last offset (" + std::to_string(nodes) + ") is more than the file can hold");
  const auto connectivity = file.integers(array_of(file, "Cells", "connectivity"), nodes);
  const VtkArray& labels = label_array(file);
  result.label_source = labels.name();
  const auto label_of = file.integers(labels, cells);
  for (std::size_t c = 0; c < cells; ++c) {
    const std::int64_t first = c > 0 ? offsets[c - 1] : 0, size = offsets[c] - first;
    if (types[c] != kVtkTetra && types[c] != kVtkQuadraticTetra) {
      ++result.other_elements;
      continue;
    }
    if (size != (types[c] == kVtkTetra ? 4 : 10))
      file.refuse("cell " + std::to_string(c) + ", a tetrahedron, has " + std::to_string(size) +
                  " nodes");
    std::array<std::int32_t, 4> tet;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int64_t v = connectivity[static_cast<std::size_t>(first) + k];
      if (v < 0 || v >= std::ssize(result.points))
        file.refuse("cell " + std::to_string(c) + " has the point " + std::to_string(v) +
                    ", but there are " + std::to_string(result.points.size()));
      tet[k] = static_cast<std::int32_t>(v);
    }
    if (label_of[c] < std::numeric_limits<Label>::min() ||
        label_of[c] > std::numeric_limits<Label>::max())
      file.refuse("cell " + std::to_string(c) + " has the label " + std::to_string(label_of[c]) +
                  ", which does not fit into 32 bit");
    result.tets.push_back(tet);
    result.label_of.push_back(static_cast<Label>(label_of[c]));
  }
  return result;
}

}  // namespace cvmesh::detail
