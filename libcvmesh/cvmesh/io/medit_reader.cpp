// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/text_scanner.h"

#include <limits>
#include <map>

namespace cvmesh::detail {
namespace {

/// Numbers per entry of the sections that are passed over.
const std::map<std::string_view, std::size_t>& skipped_sections() {
  static const std::map<std::string_view, std::size_t> sections = {{"Edges", 3},
                                                                   {"Triangles", 4},
                                                                   {"Quadrilaterals", 5},
                                                                   {"Hexahedra", 9},
                                                                   {"Prisms", 7},
                                                                   {"Pyramids", 6},
                                                                   {"Corners", 1},
                                                                   {"Ridges", 1},
                                                                   {"RequiredVertices", 1},
                                                                   {"RequiredEdges", 1},
                                                                   {"RequiredTriangles", 1},
                                                                   {"RequiredTetrahedra", 1},
                                                                   {"ParallelEdges", 1},
                                                                   {"ParallelTriangles", 1},
                                                                   {"Normals", 3},
                                                                   {"NormalAtVertices", 2},
                                                                   {"Tangents", 3},
                                                                   {"TangentAtVertices", 2}};
  return sections;
}

void read_vertices(TextScanner& scanner, TetFile& file) {
  const std::size_t count = scanner.count("the number of vertices", 8);  // "0 0 0 0\n"
  file.points.reserve(file.points.size() + count);
  for (std::size_t i = 0; i < count; ++i) {
    const double x = scanner.real("x"), y = scanner.real("y"), z = scanner.real("z");
    file.points.push_back({x, y, z});
    scanner.real("the reference of a vertex");
  }
}

void read_tets(TextScanner& scanner, TetFile& file) {
  const std::size_t count = scanner.count("the number of tetrahedra", 10);  // "1 1 1 1 1\n"
  file.tets.reserve(file.tets.size() + count);
  for (std::size_t i = 0; i < count; ++i) {
    std::array<std::int32_t, 4> tet;
    for (std::int32_t& v : tet)
      v = static_cast<std::int32_t>(scanner.integer("the vertex of a tetrahedron", 1,
                                                    std::numeric_limits<std::int32_t>::max()) -
                                    1);
    file.tets.push_back(tet);
    file.label_of.push_back(static_cast<Label>(scanner.integer("the reference of a tetrahedron",
                                                               std::numeric_limits<Label>::min(),
                                                               std::numeric_limits<Label>::max())));
  }
}

}  // namespace

TetFile read_medit(const std::filesystem::path& path, const std::string& content) {
  TextScanner scanner(path, content);
  if (scanner.word() != "MeshVersionFormatted")
    scanner.refuse("a Medit text file starts with MeshVersionFormatted");
  scanner.integer("the version");
  TetFile file;
  file.label_source = "reference";
  file.space = space_of_name(std::string(TextScanner::comment(content, "SPACE=")));
  for (std::string_view section = scanner.word(); !section.empty() && section != "End";
       section = scanner.word()) {
    if (section == "Dimension") {
      scanner.integer("the dimension", 3, 3);
    } else if (section == "Vertices") {
      read_vertices(scanner, file);
    } else if (section == "Tetrahedra") {
      read_tets(scanner, file);
    } else {
      const auto skipped = skipped_sections().find(section);
      if (skipped == skipped_sections().end())
        scanner.refuse("the section '" + std::string(section.substr(0, 40)) + "' is not known");
      const std::size_t count = scanner.count("the number of entries", 2 * skipped->second);
      for (std::size_t i = 0; i < count * skipped->second; ++i)
        scanner.real("an entry");
      if (skipped->second > 1) file.other_elements += count;
    }
  }
  return file;
}

}  // namespace cvmesh::detail
