// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/vtk_arrays.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <map>
#include <numeric>

namespace cvmesh::detail {
namespace {

constexpr std::int64_t kVtkTetra = 10, kVtkQuadraticTetra = 24;
// vtkDataSetAttributes::DUPLICATECELL: a cell that another piece has, too.
constexpr std::int64_t kGhostCell = 1;
constexpr std::array<const char*, 6> kLabelArrays = {
    "labels", "material", "ref", "medit:ref", "gmsh:physical", "gmsh:geometrical"};

const VtkArray& array_of(const VtkFile& file,
                         std::size_t piece,
                         const char* section,
                         const std::string& name) {
  const VtkArray* array = file.find(piece, section, name);
  if (array == nullptr) file.refuse("has no array '" + name + "' in <" + section + ">");
  return *array;
}

/// Of the first piece that has cells.
std::string label_array_name(const VtkFile& file, std::size_t piece) {
  for (const char* name : kLabelArrays)
    if (file.find(piece, "CellData", name) != nullptr) return name;
  std::string names, others;
  for (const char* name : kLabelArrays)
    names += std::string(names.empty() ? "" : ", ") + name;
  for (const VtkArray& array : file.arrays())
    if (array.piece == piece && array.section == "CellData")
      others += (others.empty() ? "" : ", ") + array.name();
  file.refuse("has no cell array of labels (" + names + "); it has " +
              (others.empty() ? "none" : others.substr(0, 200)));
}

/// SPACE, as cvmesh states it: the character codes of a word.
std::optional<Space> space_of(const VtkFile& file) {
  constexpr std::size_t kMostCharacters = 16;
  const VtkArray* array = file.find(std::nullopt, "FieldData", "SPACE");
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

std::vector<Vec3> read_points(const VtkFile& file, std::size_t piece) {
  const std::size_t count = file.piece_count(piece, "NumberOfPoints");
  const VtkArray* array = file.find(piece, "Points", "");
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

/// Pieces have the points of their common faces once each: what lies in exactly the same place is
/// one point. Where a piece has several points in a place (those of a cut interface), the first
/// joins the first of the pieces before, the second the second, and so on.
class PointJoiner {
 public:
  /// Adds the points of a piece to `all`; the index there of each.
  std::vector<std::int32_t> add(const std::vector<Vec3>& points, std::vector<Vec3>& all) {
    std::map<Place, std::size_t> seen_here;
    std::vector<std::int32_t> index_of;
    index_of.reserve(points.size());
    for (const Vec3& p : points) {
      const Place place = place_of(p);
      const std::size_t turn = seen_here[place]++;
      std::vector<std::int32_t>& known = at_[place];
      if (turn == known.size()) {
        known.push_back(static_cast<std::int32_t>(all.size()));
        all.push_back(p);
      }
      index_of.push_back(known[turn]);
    }
    return index_of;
  }

 private:
  // The bits, since numbers that are none cannot be sorted; -0 is 0.
  using Place = std::array<std::uint64_t, 3>;

  static Place place_of(const Vec3& p) {
    return {std::bit_cast<std::uint64_t>(p.x + 0.0), std::bit_cast<std::uint64_t>(p.y + 0.0),
            std::bit_cast<std::uint64_t>(p.z + 0.0)};
  }

  std::map<Place, std::vector<std::int32_t>> at_;
};

void append_cells(const VtkFile& file,
                  std::size_t piece,
                  const std::string& content,
                  const std::vector<std::int32_t>& index_of,
                  TetFile& result) {
  const std::size_t cells = file.piece_count(piece, "NumberOfCells");
  const auto types = file.integers(array_of(file, piece, "Cells", "types"), cells);
  const auto offsets = file.integers(array_of(file, piece, "Cells", "offsets"), cells);
  for (std::size_t c = 0; c < cells; ++c)
    if (offsets[c] < (c > 0 ? offsets[c - 1] : 0))
      file.refuse("the offset of cell " + std::to_string(c) + " (" + std::to_string(offsets[c]) +
                  ") is below the one before");
  const std::size_t nodes = cells > 0 ? static_cast<std::size_t>(offsets.back()) : 0;
  if (nodes > content.size() * kMaxDeflateRatio)
    file.refuse("the last offset (" + std::to_string(nodes) + ") is more than the file can hold");
  const auto connectivity = file.integers(array_of(file, piece, "Cells", "connectivity"), nodes);
  const auto label_of =
      file.integers(array_of(file, piece, "CellData", result.label_source), cells);
  const VtkArray* ghosts = file.find(piece, "CellData", "vtkGhostType");
  const auto ghost_type_of =
      ghosts == nullptr ? std::vector<std::int64_t>(cells) : file.integers(*ghosts, cells);
  for (std::size_t c = 0; c < cells; ++c) {
    if ((ghost_type_of[c] & kGhostCell) != 0) continue;
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
      if (v < 0 || v >= std::ssize(index_of))
        file.refuse("cell " + std::to_string(c) + " has the point " + std::to_string(v) +
                    ", but there are " + std::to_string(index_of.size()));
      tet[k] = index_of[static_cast<std::size_t>(v)];
    }
    if (label_of[c] < std::numeric_limits<Label>::min() ||
        label_of[c] > std::numeric_limits<Label>::max())
      file.refuse("cell " + std::to_string(c) + " has the label " + std::to_string(label_of[c]) +
                  ", which does not fit into 32 bit");
    result.tets.push_back(tet);
    result.label_of.push_back(static_cast<Label>(label_of[c]));
  }
}

}  // namespace

TetFile read_vtu(const std::filesystem::path& path, const std::string& content) {
  const VtkFile file(path, content, "UnstructuredGrid");
  TetFile result;
  result.space = space_of(file);
  PointJoiner joiner;
  for (std::size_t piece = 0; piece < file.pieces(); ++piece) {
    // One without cells may lack arrays, too.
    if (file.pieces() > 1 && file.piece_count(piece, "NumberOfCells") == 0) continue;
    if (result.label_source.empty()) result.label_source = label_array_name(file, piece);
    std::vector<Vec3> points = read_points(file, piece);
    if (points.size() + result.points.size() > std::numeric_limits<std::int32_t>::max())
      file.refuse("has more than 2147483647 points in all");
    std::vector<std::int32_t> index_of(points.size());
    if (file.pieces() > 1) {
      index_of = joiner.add(points, result.points);
    } else {
      std::iota(index_of.begin(), index_of.end(), 0);
      result.points = std::move(points);
    }
    append_cells(file, piece, content, index_of, result);
  }
  return result;
}

}  // namespace cvmesh::detail
