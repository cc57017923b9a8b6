// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/vtk_xml.h"

#include "cvmesh/core/base64.h"
#include "cvmesh/io/output_tables.h"

#include <algorithm>
#include <bit>
#include <utility>

namespace cvmesh::detail {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are written as they lie");

constexpr std::size_t kBlock = 1 << 16;  // values produced at a time

std::size_t bytes_of(const std::string& type) {
  if (type == "UInt8") return 1;
  return type == "Int32" ? 4 : 8;
}

template <typename T>
VtkXml::Writer produced(std::size_t count, const std::function<T(std::size_t)>& at) {
  return [count, at](Base64Array& out) {
    std::vector<T> block;
    block.reserve(std::min(count, kBlock));
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      const std::size_t end = std::min(count, begin + kBlock);
      block.clear();
      for (std::size_t i = begin; i < end; ++i)
        block.push_back(at(i));
      out.write_values(std::span<const T>(block));
    }
  };
}

}  // namespace

std::string escape_xml(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return result;
}

Base64Array::Base64Array(AtomicFile& file, std::uint64_t bytes) : file_(file) {
  write_values(std::span<const std::uint64_t>(&bytes, 1));
}

void Base64Array::write(std::string_view bytes) {
  constexpr std::size_t kPart = 3 * kBlock;
  while (rest_.size() + bytes.size() >= 3) {
    // What was left over comes first, then whole groups straight from the values.
    if (!rest_.empty()) {
      const std::size_t missing = 3 - rest_.size();
      rest_ += bytes.substr(0, missing);
      bytes.remove_prefix(missing);
      end();
      continue;
    }
    const std::size_t whole = std::min(bytes.size() / 3 * 3, kPart);
    std::string text;
    append_base64(bytes.substr(0, whole), text);
    file_.write(text);
    bytes.remove_prefix(whole);
  }
  rest_ += bytes;
}

void Base64Array::end() {
  std::string text;
  append_base64(std::exchange(rest_, ""), text);
  file_.write(text);
}

VtkXml::VtkXml(const std::string& type) : type_(type) {}

void VtkXml::add_field_strings(const std::string& name, const std::vector<std::string>& values) {
  // VTK's own form of a string array: the character codes of each string, each ended by a 0. Meshio
  // refuses any .vtu file with such an array, so there the same codes go into an array of bytes.
  const bool is_grid = type_ == "UnstructuredGrid";
  std::string codes;
  std::size_t count = 0;
  for (const std::string& value : values) {
    for (const char c : one_line(value)) {
      append_number(codes, std::int64_t{static_cast<unsigned char>(c)});
      codes += ' ';
      ++count;
    }
    codes += "0 ";
    ++count;
  }
  const std::string tag = is_grid ? "DataArray" : "Array";
  fields_ += "      <" + tag + " type=\"" + (is_grid ? "UInt8" : "String") + "\" Name=\"" +
             escape_xml(name) + "\" NumberOfTuples=\"" +
             std::to_string(is_grid ? count : values.size()) + "\" format=\"ascii\">\n        " +
             codes + "\n      </" + tag + ">\n";
}

void VtkXml::add_field_integers(const std::string& name, const std::vector<std::int32_t>& values) {
  fields_ += "      <DataArray type=\"Int32\" Name=\"" + escape_xml(name) + "\" NumberOfTuples=\"" +
             std::to_string(values.size()) + "\" format=\"ascii\">\n        ";
  for (const std::int32_t value : values) {
    append_number(fields_, std::int64_t{value});
    fields_ += ' ';
  }
  fields_ += "\n      </DataArray>\n";
}

void VtkXml::add_space(Space space) {
  add_field_strings("SPACE", {space_name(space)});
}

void VtkXml::add_label_fields(const LabelVolume& labels, Space space) {
  add_space(space);
  std::vector<std::int32_t> values;
  std::vector<std::string> names;
  for (std::size_t id = 1; id < labels.material_count(); ++id) {
    values.push_back(labels.label_of[id]);
    names.push_back(labels.name_of[id]);
  }
  add_field_integers("label_values", values);
  add_field_strings("label_names", names);
  add_field_integers("exterior_label", {exterior_label(labels)});
}

void VtkXml::begin_piece(const std::string& counts) {
  piece_ += "    <Piece " + counts + ">\n";
}

void VtkXml::begin_section(const std::string& name, const std::string& attributes) {
  section_ = name;
  piece_ += "      <" + name + attributes + ">\n";
}

void VtkXml::end_section() {
  piece_ += "      </" + section_ + ">\n";
}

void VtkXml::add_array(const std::string& type,
                       const std::string& name,
                       std::size_t components,
                       std::size_t count,
                       Writer write) {
  piece_ += "        <DataArray type=\"" + type + "\" Name=\"" + escape_xml(name) + "\"";
  if (components > 1) piece_ += " NumberOfComponents=\"" + std::to_string(components) + "\"";
  piece_ += " format=\"binary\">";
  const std::uint64_t bytes = std::uint64_t{count} * components * bytes_of(type);
  arrays_.push_back({std::exchange(piece_, "</DataArray>\n"), bytes, std::move(write)});
}

void VtkXml::add_int32(const std::string& name,
                       std::size_t count,
                       const std::function<std::int32_t(std::size_t)>& at) {
  add_array("Int32", name, 1, count, produced<std::int32_t>(count, at));
}

void VtkXml::add_int64(const std::string& name,
                       std::size_t count,
                       const std::function<std::int64_t(std::size_t)>& at) {
  add_array("Int64", name, 1, count, produced<std::int64_t>(count, at));
}

void VtkXml::add_points(std::span<const Vec3> points,
                        const std::function<Vec3(const Vec3&)>& place) {
  using Triple = std::array<double, 3>;
  const std::function<Triple(std::size_t)> at = [points, place](std::size_t i) {
    const Vec3 p = place(points[i]);
    return Triple{p.x, p.y, p.z};
  };
  begin_section("Points");
  add_array("Float64", "Points", 3, points.size(), produced<Triple>(points.size(), at));
  end_section();
}

void VtkXml::write(const std::filesystem::path& path) {
  AtomicFile file(path);
  file.write("<?xml version=\"1.0\"?>\n<VTKFile type=\"" + type_ +
             "\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <" + type_ +
             ">\n    <FieldData>\n" + fields_ + "    </FieldData>\n");
  for (const Array& array : arrays_) {
    file.write(array.before);
    Base64Array values(file, array.bytes);
    array.write(values);
    values.end();
  }
  file.write(piece_ + "    </Piece>\n  </" + type_ + ">\n</VTKFile>\n");
  file.commit();
}

}  // namespace cvmesh::detail
