// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/tet_writer.h"

#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/vtk_xml.h"

#include <string>
#include <vector>

namespace cvmesh {
namespace {

constexpr std::uint8_t kVtkTetra = 10, kVtkQuadraticTetra = 24;

template <std::size_t N>
void append_line(std::string& line,
                 const std::array<std::int32_t, N>& vertices,
                 std::int64_t reference) {
  for (const std::int32_t vertex : vertices) {
    append_number(line, std::int64_t{vertex} + 1);
    line += ' ';
  }
  append_number(line, reference);
  line += '\n';
}

}  // namespace

void write_vtu(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space) {
  const Placement place(mm_to_out);
  const std::vector<Label> label_of = output_labels(labels);
  const std::size_t count = mesh.tets.size();
  detail::VtkXml xml("UnstructuredGrid");
  xml.add_label_fields(labels, space);
  const bool is_quadratic = !mesh.mid_of.empty();
  std::vector<Vec3> points = mesh.points;
  points.insert(points.end(), mesh.mid_points.begin(), mesh.mid_points.end());
  xml.begin_piece("NumberOfPoints=\"" + std::to_string(points.size()) + "\" NumberOfCells=\"" +
                  std::to_string(count) + "\"");
  xml.begin_section("CellData", " Scalars=\"labels\"");
  xml.add_int32("labels", count, [&](std::size_t i) { return label_of[mesh.material_of[i]]; });
  for (const TetArray& array : mesh.arrays)
    xml.add_values(array.name, std::span<const double>(array.values));
  xml.end_section();
  if (!mesh.original_of.empty()) {
    xml.begin_section("PointData");
    xml.add_values("original_point", std::span<const std::int32_t>(mesh.original_of));
    xml.end_section();
  }
  xml.add_points(points, place);
  xml.begin_section("Cells");
  const std::size_t nodes = is_quadratic ? 10 : 4;
  const auto mids_from = static_cast<std::int64_t>(mesh.points.size());
  xml.add_int64("connectivity", nodes * count, [&](std::size_t i) {
    const std::size_t t = i / nodes, k = i % nodes;
    return k < 4 ? std::int64_t{place(mesh.tets[t])[k]}
                 : mids_from + std::int64_t{place(mesh.mid_of[t])[k - 4]};
  });
  xml.add_int64("offsets", count,
                [&](std::size_t i) { return static_cast<std::int64_t>(nodes * (i + 1)); });
  const std::vector<std::uint8_t> types(count, is_quadratic ? kVtkQuadraticTetra : kVtkTetra);
  xml.add_values("types", std::span<const std::uint8_t>(types));
  xml.end_section();
  xml.write(path);
}

void write_medit(const std::filesystem::path& path,
                 const TetMesh& mesh,
                 const LabelVolume& labels,
                 const Affine& mm_to_out,
                 Space space) {
  const Placement place(mm_to_out);
  const std::vector<Label> label_of = output_labels(labels);
  const InterfaceTable table = interface_table(mesh.surface);
  AtomicFile file(path);
  // Readers that know comments at all know them between sections, not before the first keyword.
  std::string text = "MeshVersionFormatted 2\nDimension 3\n# SPACE=";
  text += space_name(space);
  text += "\n# Tetrahedra: reference = label\n";
  for (std::size_t id = 1; id < labels.material_count(); ++id)
    text += "# label " + std::to_string(labels.label_of[id]) + ": \"" +
            one_line(labels.name_of[id]) + "\"\n";
  text += "# Triangles: reference = interface\n";
  for (std::size_t row = 0; row < table.patches.size(); ++row)
    text += "# " + std::to_string(row + 1) + ": " + describe_interface(table.patches[row], labels) +
            "\n";
  text += "Vertices\n" + std::to_string(mesh.points.size()) + "\n";
  file.write(text);

  for (const Vec3& point : mesh.points) {
    const Vec3 p = place(point);
    text.clear();
    for (int axis = 0; axis < 3; ++axis) {
      append_number(text, p[axis]);
      text += ' ';
    }
    text += "0\n";
    file.write(text);
  }
  file.write("Tetrahedra\n" + std::to_string(mesh.tets.size()) + "\n");
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    text.clear();
    append_line(text, place(mesh.tets[i]), label_of[mesh.material_of[i]]);
    file.write(text);
  }
  file.write("Triangles\n" + std::to_string(mesh.surface.facets.size()) + "\n");
  for (std::size_t i = 0; i < mesh.surface.facets.size(); ++i) {
    text.clear();
    append_line(text, place(mesh.surface.facets[i]), table.index_of[i]);
    file.write(text);
  }
  file.write("End\n");
  file.commit();
}

}  // namespace cvmesh
