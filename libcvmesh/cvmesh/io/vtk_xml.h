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
#include <string_view>
#include <vector>

// VTK's XML format (version 1.0), arrays in base64 where they belong ("binary"), little endian,
// UInt64 headers. Not as raw data at the end of the file, which is no XML: VTK finds these by being
// told of a tag before the next byte is looked at, which expat with deferred reparsing (2.6,
// Debian's 2.5.0-1+deb12u5) does not promise: ParaView 5.11 opens no such file there. Private to
// io.
namespace cvmesh::detail {

/// Takes the values of an array, a part at a time, and puts them into a file as base64.
class Base64Array {
 public:
  /// @param bytes  of all values, which the array states at its beginning
  Base64Array(AtomicFile& file, std::uint64_t bytes);
  ~Base64Array() = default;
  Base64Array(const Base64Array&) = delete;
  Base64Array& operator=(const Base64Array&) = delete;

  /// The values as they lie in memory.
  template <typename T>
  void write_values(std::span<const T> values) {
    write({reinterpret_cast<const char*>(values.data()), values.size_bytes()});
  }

  void end();

 private:
  void write(std::string_view bytes);

  AtomicFile& file_;
  std::string rest_;  // fewer than three bytes that wait for the next part
};

/// The text around the arrays is built first; the arrays are written straight from where they lie
/// (or are produced block by block).
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

  using Writer = std::function<void(Base64Array&)>;
  /// An array of `count` values of `components` numbers, which `write` puts out.
  void add_array(const std::string& type,
                 const std::string& name,
                 std::size_t components,
                 std::size_t count,
                 Writer write);

  template <typename T>
  void add_values(const std::string& name, std::span<const T> values) {
    add_array(type_name(T{}), name, 1, values.size(),
              [values](Base64Array& out) { out.write_values(values); });
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

  struct Array {
    std::string before;  // text up to the values
    std::uint64_t bytes;
    Writer write;
  };

  std::string type_, fields_, section_;
  std::vector<Array> arrays_;
  std::string piece_;  // text since the last array
};

/// `text` for an XML attribute.
std::string escape_xml(const std::string& text);

}  // namespace cvmesh::detail
