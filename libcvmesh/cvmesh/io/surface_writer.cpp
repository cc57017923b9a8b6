// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/surface_writer.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/vtk_xml.h"

namespace cvmesh {
namespace {

using detail::VtkXml;

void begin_piece(VtkXml& xml, std::size_t points, std::size_t verts, std::size_t polys) {
  xml.begin_piece("NumberOfPoints=\"" + std::to_string(points) + "\" NumberOfVerts=\"" +
                  std::to_string(verts) + "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" " +
                  "NumberOfPolys=\"" + std::to_string(polys) + "\"");
}

void add_point_arrays(VtkXml& xml, std::size_t count, const PointArrays& arrays) {
  const auto check = [&](const std::string& name, std::size_t size) {
    require(size == count, ErrorCode::Internal, "write",
            "array '" + name + "' has " + std::to_string(size) + " values for " +
                std::to_string(count) + " points");
  };
  const std::string first = arrays.doubles.empty() ? "" : arrays.doubles.front().name;
  xml.begin_section("PointData",
                    first.empty() ? "" : " Scalars=\"" + detail::escape_xml(first) + "\"");
  for (const auto& array : arrays.doubles) {
    check(array.name, array.values.size());
    xml.add_values(array.name, array.values);
  }
  for (const auto& array : arrays.integers) {
    check(array.name, array.values.size());
    xml.add_values(array.name, array.values);
  }
  xml.end_section();
}

void add_facets(VtkXml& xml, const InterfaceMesh& mesh, const Placement& place) {
  xml.begin_section("Polys");
  xml.add_int64("connectivity", 3 * mesh.facets.size(), [&mesh, place](std::size_t i) {
    return std::int64_t{place(mesh.facets[i / 3])[i % 3]};
  });
  xml.add_int64("offsets", mesh.facets.size(),
                [](std::size_t i) { return static_cast<std::int64_t>(3 * (i + 1)); });
  xml.end_section();
}

}  // namespace

void write_surface_vtp(const std::filesystem::path& path,
                       const InterfaceMesh& mesh,
                       const LabelVolume& labels,
                       const Affine& mm_to_out,
                       Space space) {
  const Placement place(mm_to_out);
  const std::vector<Label> label_of = output_labels(labels);
  const InterfaceTable table = interface_table(mesh);
  std::vector<std::string> names;
  for (const PatchKey& patch : table.patches)
    names.push_back(describe_interface(patch, labels));
  const std::size_t count = mesh.facets.size();
  VtkXml xml("PolyData");
  xml.add_label_fields(labels, space);
  xml.add_field_strings("interface_names", names);
  begin_piece(xml, mesh.points.size(), 0, count);
  xml.begin_section("CellData", " Scalars=\"inside_label\"");
  xml.add_int32("inside_label", count,
                [&](std::size_t i) { return label_of[mesh.patch_of[i].sides.inside]; });
  xml.add_int32("outside_label", count,
                [&](std::size_t i) { return label_of[mesh.patch_of[i].sides.outside]; });
  xml.add_values("interface", std::span<const std::int32_t>(table.index_of));
  xml.end_section();
  xml.add_points(mesh.points, place);
  add_facets(xml, mesh, place);
  xml.write(path);
}

void write_off(const std::filesystem::path& path,
               const InterfaceMesh& mesh,
               const Affine& mm_to_out) {
  const Placement place(mm_to_out);
  AtomicFile file(path);
  std::string line = "OFF\n" + std::to_string(mesh.points.size()) + " " +
                     std::to_string(mesh.facets.size()) + " 0\n";
  file.write(line);
  for (const Vec3& point : mesh.points) {
    const Vec3 p = place(point);
    line.clear();
    for (int axis = 0; axis < 3; ++axis) {
      append_number(line, p[axis]);
      line += axis < 2 ? ' ' : '\n';
    }
    file.write(line);
  }
  for (const auto& facet : mesh.facets) {
    line = "3";
    for (const std::int32_t vertex : place(facet)) {
      line += ' ';
      append_number(line, std::int64_t{vertex});
    }
    line += '\n';
    file.write(line);
  }
  file.commit();
}

void write_points_vtp(const std::filesystem::path& path,
                      std::span<const Vec3> points,
                      const PointArrays& arrays,
                      const Affine& mm_to_out,
                      Space space) {
  VtkXml xml("PolyData");
  xml.add_space(space);
  begin_piece(xml, points.size(), points.size(), 0);
  add_point_arrays(xml, points.size(), arrays);
  xml.add_points(points, Placement(mm_to_out));
  xml.begin_section("Verts");
  xml.add_int64("connectivity", points.size(),
                [](std::size_t i) { return static_cast<std::int64_t>(i); });
  xml.add_int64("offsets", points.size(),
                [](std::size_t i) { return static_cast<std::int64_t>(i + 1); });
  xml.end_section();
  xml.write(path);
}

void write_vertex_field_vtp(const std::filesystem::path& path,
                            const InterfaceMesh& mesh,
                            const PointArrays& arrays,
                            const Affine& mm_to_out,
                            Space space) {
  const Placement place(mm_to_out);
  VtkXml xml("PolyData");
  xml.add_space(space);
  begin_piece(xml, mesh.points.size(), 0, mesh.facets.size());
  add_point_arrays(xml, mesh.points.size(), arrays);
  xml.add_points(mesh.points, place);
  add_facets(xml, mesh, place);
  xml.write(path);
}

}  // namespace cvmesh
