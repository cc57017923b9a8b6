// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Reads VTK's XML files. Private to io.
namespace cvmesh::detail {

/// The values of a DataArray, as they were or as the nearest double.
struct VtkValues {
  std::vector<std::int64_t> integers;  ///< of integer arrays
  std::vector<double> reals;           ///< of arrays of Float32 and Float64

  [[nodiscard]] std::size_t size() const { return integers.size() + reals.size(); }
};

/// One `<DataArray>` and where it stands.
struct VtkArray {
  std::string section;  ///< the element around it: Points, Cells, CellData, FieldData ...
  std::map<std::string, std::string, std::less<>> attributes;
  std::string_view text;                  ///< between its tags
  std::optional<std::size_t> piece = {};  ///< none in front of the pieces, as field data

  [[nodiscard]] std::string attribute(std::string_view key) const;

  [[nodiscard]] std::string name() const { return attribute("Name"); }
};

/// The parts of a VTK XML file: the attributes of each `<Piece>`, and its arrays, decoded on
/// demand. Ascii, base64 inline, appended raw and appended base64; zlib or no compression; headers
/// of 32 and 64 bit; little endian.
///
/// The text must outlive this object. Sizes are checked against what the file can hold before
/// anything is allocated.
class VtkFile {
 public:
  /// @throws Error BadInput when this is no VTK XML file of `type` ("UnstructuredGrid"), has no
  ///         piece, or is stored in a way that is not supported
  VtkFile(const std::filesystem::path& path, std::string_view text, const std::string& type);

  [[nodiscard]] std::size_t pieces() const { return pieces_.size(); }

  /// A count among the attributes of a piece.
  [[nodiscard]] std::size_t piece_count(std::size_t piece, const std::string& key) const;

  [[nodiscard]] const std::vector<VtkArray>& arrays() const { return arrays_; }

  /// The array of that name in that section of a piece, or in front of them all; null where there
  /// is none. An empty name fits all.
  [[nodiscard]] const VtkArray* find(std::optional<std::size_t> piece,
                                     std::string_view section,
                                     std::string_view name) const;

  /// The values of an array. @throws Error BadInput naming the array, when there are not `count`
  [[nodiscard]] VtkValues values(const VtkArray& array, std::size_t count) const;
  /// The same, of an array of integers.
  [[nodiscard]] std::vector<std::int64_t> integers(const VtkArray& array, std::size_t count) const;

  [[noreturn]] void refuse(const std::string& what) const;

 private:
  [[nodiscard]] std::string bytes_of(const VtkArray& array, std::size_t count) const;

  const std::filesystem::path& path_;
  std::string_view text_, appended_;
  std::map<std::string, std::string, std::less<>> file_;
  std::vector<std::map<std::string, std::string, std::less<>>> pieces_;
  std::vector<VtkArray> arrays_;
  bool is_appended_base64_ = false;
};

}  // namespace cvmesh::detail
