// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/surface_reader.h"

#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/text_scanner.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

using detail::refuse_file;
using detail::TextScanner;

constexpr std::size_t kMostCorners = 1024;  // of a polygon

void add_polygon(const std::vector<std::int64_t>& corners,
                 const std::filesystem::path& path,
                 SurfaceFile& file) {
  const auto points = std::ssize(file.points);
  for (const std::int64_t v : corners)
    if (v < 0 || v >= points)
      refuse_file(path, "face " + std::to_string(file.facets.size()) + " has the vertex " +
                            std::to_string(v) + " (counted from 0), but there are " +
                            std::to_string(points));
  for (std::size_t k = 2; k < corners.size(); ++k)
    file.facets.push_back({static_cast<std::int32_t>(corners[0]),
                           static_cast<std::int32_t>(corners[k - 1]),
                           static_cast<std::int32_t>(corners[k])});
}

Vec3 read_point(TextScanner& scanner) {
  const double x = scanner.real("x"), y = scanner.real("y"), z = scanner.real("z");
  return {x, y, z};
}

// --- OFF -----------------------------------------------------------------------------------------

SurfaceFile read_off(const std::filesystem::path& path, const std::string& content) {
  TextScanner scanner(path, content);
  if (scanner.word() != "OFF") scanner.refuse("an OFF file starts with OFF");
  SurfaceFile file;
  const std::size_t points = scanner.count("the number of vertices", 6);  // "0 0 0\n"
  const std::size_t faces = scanner.count("the number of faces", 2);
  scanner.integer("the number of edges");
  for (std::size_t i = 0; i < points; ++i)
    file.points.push_back(read_point(scanner));
  std::vector<std::int64_t> corners;
  for (std::size_t f = 0; f < faces; ++f) {
    corners.resize(static_cast<std::size_t>(
        scanner.integer("the number of corners", 1, static_cast<std::int64_t>(kMostCorners))));
    for (std::int64_t& v : corners)
      v = scanner.integer("the vertex of a face");
    scanner.line();  // colours
    add_polygon(corners, path, file);
  }
  return file;
}

// --- STL -----------------------------------------------------------------------------------------

void add_triangle(const std::array<Vec3, 3>& corners, SurfaceFile& file) {
  const auto first = static_cast<std::int32_t>(file.points.size());
  file.points.insert(file.points.end(), corners.begin(), corners.end());
  file.facets.push_back({first, first + 1, first + 2});
}

SurfaceFile read_text_stl(const std::filesystem::path& path, const std::string& content) {
  TextScanner scanner(path, content);
  SurfaceFile file;
  std::array<Vec3, 3> corners;
  std::size_t corner = 0;
  for (std::string_view word = scanner.word(); !word.empty(); word = scanner.word()) {
    if (word == "solid" || word == "endsolid") {
      scanner.line();  // its name
    } else if (word == "vertex") {
      if (corner == 3) scanner.refuse("a loop has more than three vertices");
      corners[corner++] = read_point(scanner);
    } else if (word == "endloop") {
      if (corner != 3) scanner.refuse("a loop has fewer than three vertices");
      add_triangle(corners, file);
      corner = 0;
    } else if (word == "normal") {
      read_point(scanner);
    } else if (word != "facet" && word != "outer" && word != "loop" && word != "endfacet") {
      scanner.refuse("'" + std::string(word.substr(0, 40)) + "' is not expected in an STL file");
    }
  }
  return file;
}

SurfaceFile read_stl(const std::filesystem::path& path, const std::string& content) {
  constexpr std::size_t kHeader = 80, kFacet = 50;
  std::uint32_t count = 0;
  if (content.size() >= kHeader + sizeof count)
    std::memcpy(&count, content.data() + kHeader, sizeof count);
  // A text file may start like a binary one, and the other way round: the length tells.
  const bool is_binary = content.size() == kHeader + sizeof count + kFacet * std::size_t{count};
  if (!is_binary) return read_text_stl(path, content);
  if (count > std::numeric_limits<std::int32_t>::max() / 3)
    refuse_file(path, "has " + std::to_string(count) + " facets, more than 715827882");
  SurfaceFile file;
  for (std::size_t f = 0; f < count; ++f) {
    std::array<float, 12> values;  // normal, then corners
    std::memcpy(values.data(), content.data() + kHeader + sizeof count + kFacet * f, sizeof values);
    add_triangle({Vec3{values[3], values[4], values[5]}, Vec3{values[6], values[7], values[8]},
                  Vec3{values[9], values[10], values[11]}},
                 file);
  }
  return file;
}

// --- PLY -----------------------------------------------------------------------------------------

struct PlyProperty {
  std::string name, type, count_type;  // `count_type` of lists only
};

struct PlyElement {
  std::string name;
  std::size_t count = 0;
  std::vector<PlyProperty> properties;
};

std::size_t ply_bytes(const std::string& type) {
  for (const auto& [names, bytes] :
       {std::pair<std::string, std::size_t>{" char uchar int8 uint8 ", 1},
        {" short ushort int16 uint16 ", 2},
        {" int uint float int32 uint32 float32 ", 4},
        {" double float64 ", 8}})
    if (names.find(" " + type + " ") != std::string::npos) return bytes;
  return 0;
}

class PlyFile {
 public:
  PlyFile(const std::filesystem::path& path, const std::string& content)
      : path_(path), content_(content), scanner_(path, content) {}

  SurfaceFile read() {
    read_header();
    for (const PlyElement& element : elements_)
      read_element(element);
    return std::move(file_);
  }

 private:
  void read_header() {
    if (scanner_.word() != "ply") scanner_.refuse("a PLY file starts with ply");
    for (;;) {
      const std::string word(scanner_.word());
      if (word == "end_header") break;
      if (word == "comment" || word == "obj_info") {
        scanner_.line();
      } else if (word == "format") {
        format_ = scanner_.word();
        scanner_.word();  // version
        if (format_ != "ascii" && format_ != "binary_little_endian" &&
            format_ != "binary_big_endian")
          scanner_.refuse("the format '" + format_.substr(0, 40) + "' is not known");
      } else if (word == "element") {
        PlyElement element;
        element.name = scanner_.word();
        element.count = static_cast<std::size_t>(scanner_.integer(
            "the number of elements", 0, std::numeric_limits<std::int32_t>::max()));
        elements_.push_back(element);
      } else if (word == "property") {
        read_property();
      } else {
        scanner_.refuse("'" + word.substr(0, 40) + "' is not expected in the header of a PLY file");
      }
    }
    if (format_.empty()) scanner_.refuse("the header names no format");
    scanner_.line();
    at_ = scanner_.position();
  }

  void read_property() {
    if (elements_.empty()) scanner_.refuse("a property comes before the first element");
    PlyProperty property;
    property.type = scanner_.word();
    if (property.type == "list") {
      property.count_type = scanner_.word();
      property.type = scanner_.word();
    }
    property.name = scanner_.word();
    for (const std::string& type : {property.type, property.count_type})
      if (!(type.empty() && property.count_type.empty()) && ply_bytes(type) == 0)
        scanner_.refuse("the type '" + type.substr(0, 40) + "' of a property is not known");
    elements_.back().properties.push_back(property);
  }

  void read_element(const PlyElement& element) {
    // An element without properties takes no room: its number could not be checked.
    if (element.properties.empty()) return;
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    std::vector<std::int64_t> corners;
    for (std::size_t i = 0; i < element.count; ++i) {
      Vec3 p;
      bool has_corners = false;
      for (const PlyProperty& property : element.properties) {
        if (property.count_type.empty()) {
          const double value = number(property.type);
          if (property.name.size() == 1 && property.name[0] >= 'x' && property.name[0] <= 'z')
            p[property.name[0] - 'x'] = value;
          continue;
        }
        const double count = number(property.count_type);
        if (!(count >= 0 && count <= static_cast<double>(kMostCorners)))
          refuse_file(path_, element.name.substr(0, 40) + " " + std::to_string(i) +
                                 " has a list of " + std::to_string(count) + " values");
        const bool is_corners =
            is_face && (property.name == "vertex_indices" || property.name == "vertex_index");
        if (is_corners) corners.clear();
        for (int k = 0; k < static_cast<int>(count); ++k) {
          const double value = number(property.type);
          if (!is_corners) continue;
          if (!(std::abs(value) < 4294967296.0))
            refuse_file(path_, "face " + std::to_string(i) + " has a vertex out of range");
          corners.push_back(static_cast<std::int64_t>(value));
        }
        has_corners = has_corners || is_corners;
      }
      if (is_vertex) file_.points.push_back(p);
      if (has_corners) add_polygon(corners, path_, file_);
    }
  }

  double number(const std::string& type) {
    if (format_ == "ascii") return scanner_.real("a value");
    const std::size_t bytes = ply_bytes(type);
    if (content_.size() - at_ < bytes)
      refuse_file(path_, "ends early, at byte " + std::to_string(at_));
    std::array<char, 8> raw{};
    std::copy_n(content_.data() + at_, bytes, raw.begin());
    at_ += bytes;
    if (format_ == "binary_big_endian")
      std::reverse(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(bytes));
    return decode(type, raw);
  }

  static double decode(const std::string& type, const std::array<char, 8>& raw) {
    const auto as = [&]<typename T>(T value) {
      std::memcpy(&value, raw.data(), sizeof value);
      return static_cast<double>(value);
    };
    if (type == "double" || type == "float64") return as(double{});
    if (type == "float" || type == "float32") return as(float{});
    if (type == "char" || type == "int8") return as(std::int8_t{});
    if (type == "uchar" || type == "uint8") return as(std::uint8_t{});
    if (type == "short" || type == "int16") return as(std::int16_t{});
    if (type == "ushort" || type == "uint16") return as(std::uint16_t{});
    if (type == "uint" || type == "uint32") return as(std::uint32_t{});
    return as(std::int32_t{});
  }

  const std::filesystem::path& path_;
  const std::string& content_;
  TextScanner scanner_;
  std::string format_;
  std::vector<PlyElement> elements_;
  std::size_t at_ = 0;  // in a binary file
  SurfaceFile file_;
};

SurfaceFile read_ply(const std::filesystem::path& path, const std::string& content) {
  return PlyFile(path, content).read();
}

}  // namespace

SurfaceFile read_surface_file(const std::filesystem::path& path) {
  const std::string suffix = path.extension().string();
  const auto read = suffix == ".off"   ? &read_off
                    : suffix == ".ply" ? &read_ply
                    : suffix == ".stl" ? &read_stl
                                       : nullptr;
  if (read == nullptr)
    refuse_file(path, "has the suffix '" + suffix + "'; give a .off, .ply or .stl file");
  SurfaceFile file = read(path, detail::read_content(path));
  if (file.facets.empty()) refuse_file(path, "has no facets");
  for (std::size_t v = 0; v < file.points.size(); ++v) {
    const Vec3& p = file.points[v];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      refuse_file(path, "point " + std::to_string(v) + " is not finite");
  }
  return file;
}

}  // namespace cvmesh
