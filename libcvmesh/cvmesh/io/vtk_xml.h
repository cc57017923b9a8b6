// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/labels/label_volume.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

// VTK's XML format (version 1.0) with appended raw data, little endian, UInt64 block headers.
// Private to io.
namespace cvmesh::detail {

/// The XML part is built first, with the offset of every array; the arrays follow in that order,
/// each one written straight from where it lies (or is produced block by block).
class VtkXml {
 public:
  /// `type` is "UnstructuredGrid" or "PolyData".
  explicit VtkXml(const std::string& type);

  /// Field data comes before the piece. In an unstructured grid strings are bytes (UTF-8), each
  /// string ended by a 0: meshio cannot read VTK's string arrays.
  void add_field_strings(const std::string& name, const std::vector<std::string>& values);
  void add_field_integers(const std::string& name, const std::vector<std::int32_t>& values);
  /// `SPACE`, the label values and names, and the label of the exterior.
  void add_label_fields(const LabelVolume& labels, Space space);
  void add_space(Space space);

  /// `counts`: the piece's attributes, such as `NumberOfPoints="3"`.
  void begin_piece(const std::string& counts);
  /// A section of the piece ("Points", "Cells", "CellData" ...), `attributes` with leading blank.
  void begin_section(const std::string& name, const std::string& attributes = "");
  void end_section();

  using Writer = std::function<void(AtomicFile&)>;
  /// An array of `count` values of `bytes` bytes, which `write` puts out.
  void add_array(const std::string& type,
                 const std::string& name,
                 std::size_t components,
                 std::size_t count,
                 Writer write);

  template <typename T>
  void add_values(const std::string& name, std::span<const T> values) {
    add_array(type_name(T{}), name, 1, values.size(),
              [values](AtomicFile& file) { file.write_values(values); });
  }

  /// An array of integers, `at(i)` for i < count, one component.
  void add_int32(const std::string& name,
                 std::size_t count,
                 const std::function<std::int32_t(std::size_t)>& at);
  void add_int64(const std::string& name,
                 std::size_t count,
                 const std::function<std::int64_t(std::size_t)>& at);
  void add_points(std::span<const Vec3> points, const std::function<Vec3(const Vec3&)>& place);

  void write(const std::filesystem::path& path);

 private:
  static const char* type_name(double) { return "Float64"; }

  static const char* type_name(std::int32_t) { return "Int32"; }

  static const char* type_name(std::int64_t) { return "Int64"; }

  static const char* type_name(std::uint8_t) { return "UInt8"; }

  struct Block {
    std::uint64_t bytes;
    Writer write;
  };

  std::string type_, fields_, piece_, section_;
  std::vector<Block> blocks_;
  std::uint64_t offset_ = 0;
};

/// `text` for an XML attribute.
std::string escape_xml(const std::string& text);

}  // namespace cvmesh::detail
