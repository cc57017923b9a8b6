// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/surface_parts.h"

#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/set_names.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <regex>
#include <span>

namespace cvmesh {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie");

constexpr std::size_t kStlHeader = 80;
constexpr std::array<const char*, 7> kWallNames = {"",      "_xmin", "_xmax", "_ymin",
                                                   "_ymax", "_zmin", "_zmax"};

/// A facet seen from its other side.
void turn(std::array<std::int32_t, 3>& facet, PatchKey& patch) {
  std::swap(facet[1], facet[2]);
  std::swap(patch.sides.inside, patch.sides.outside);
}

/// Leaves out the points that no facet uses.
void compact(InterfaceMesh& mesh, const std::vector<Vec3>& points) {
  std::vector<std::int32_t> used;
  for (const auto& facet : mesh.facets)
    used.insert(used.end(), facet.begin(), facet.end());
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  for (const std::int32_t v : used)
    mesh.points.push_back(points[static_cast<std::size_t>(v)]);
  for (auto& facet : mesh.facets)
    for (std::int32_t& v : facet)
      v = static_cast<std::int32_t>(std::lower_bound(used.begin(), used.end(), v) - used.begin());
}

/// The boundary of one material, seen from it. Where an interface is there twice, as the sides of a
/// contact, each facet counts for the material on its inside.
InterfaceMesh boundary_of(const InterfaceMesh& mesh,
                          const InterfaceTable& table,
                          MaterialId material) {
  InterfaceMesh boundary;
  for (std::size_t i = 0; i < mesh.facets.size(); ++i) {
    std::array<std::int32_t, 3> facet = mesh.facets[i];
    PatchKey patch = mesh.patch_of[i];
    if (patch.sides.outside == material) {
      const PatchKey other{{patch.sides.outside, patch.sides.inside}, patch.wall};
      if (std::binary_search(table.patches.begin(), table.patches.end(), other)) continue;
      turn(facet, patch);
    }
    if (patch.sides.inside != material) continue;
    boundary.facets.push_back(facet);
    boundary.patch_of.push_back(patch);
  }
  compact(boundary, mesh.points);
  return boundary;
}

std::string header(const SurfacePart& part, Space space) {
  return std::string("cvmesh SPACE=") + space_name(space) + " mm, " + part.description;
}

template <typename T>
void append_bytes(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

std::vector<SurfacePart> surface_parts(const InterfaceMesh& mesh, const LabelVolume& labels) {
  const InterfaceTable table = interface_table(mesh);
  const std::vector<Label> label_of = output_labels(labels);
  std::vector<SurfacePart> parts;
  for (std::size_t id = 1; id < labels.material_count(); ++id) {
    const std::string value = std::to_string(label_of[id]);
    parts.push_back({"label_" + value,
                     "label " + value + " \"" + one_line(labels.name_of[id]) + "\"",
                     boundary_of(mesh, table, static_cast<MaterialId>(id))});
  }
  std::vector<InterfaceMesh> interfaces(table.patches.size());
  for (std::size_t i = 0; i < mesh.facets.size(); ++i) {
    InterfaceMesh& interface = interfaces[static_cast<std::size_t>(table.index_of[i] - 1)];
    interface.facets.push_back(mesh.facets[i]);
    interface.patch_of.push_back(mesh.patch_of[i]);
  }
  for (std::size_t row = 0; row < interfaces.size(); ++row) {
    const PatchKey& patch = table.patches[row];
    compact(interfaces[row], mesh.points);
    parts.push_back({"interface_" + std::to_string(label_of[patch.sides.inside]) + "_" +
                         std::to_string(label_of[patch.sides.outside]) + kWallNames.at(patch.wall),
                     describe_interface(patch, labels), std::move(interfaces[row])});
  }
  return parts;
}

bool is_surface_part_file(const std::string& file_name, const std::string& name) {
  static const std::regex pattern(
      R"(\.(label_-?\d+|interface_-?\d+_-?\d+(_[xyz](min|max))?)\.(stl|ply|vtp))");
  return file_name.starts_with(name) &&
         std::regex_match(file_name.begin() + static_cast<std::ptrdiff_t>(name.size()),
                          file_name.end(), pattern);
}

void write_stl(const std::filesystem::path& path,
               const SurfacePart& part,
               const Affine& mm_to_out,
               Space space) {
  const Placement place(mm_to_out);
  const InterfaceMesh& mesh = part.mesh;
  AtomicFile file(path);
  std::string bytes = cut_between_characters(header(part, space), kStlHeader);
  bytes.resize(kStlHeader, ' ');
  append_bytes(bytes, static_cast<std::uint32_t>(mesh.facets.size()));
  for (const auto& facet : mesh.facets) {
    std::array<Vec3, 3> corners;
    const auto placed = place(facet);
    std::transform(placed.begin(), placed.end(), corners.begin(),
                   [&](std::int32_t v) { return place(mesh.points[static_cast<std::size_t>(v)]); });
    const Vec3 normal = normalized(area_vector2(corners[0], corners[1], corners[2]));
    for (const Vec3& v : {normal, corners[0], corners[1], corners[2]})
      for (int axis = 0; axis < 3; ++axis)
        append_bytes(bytes, static_cast<float>(v[axis]));
    append_bytes(bytes, std::uint16_t{0});
    file.write(bytes);
    bytes.clear();
  }
  file.write(bytes);
  file.commit();
}

void write_ply(const std::filesystem::path& path,
               const SurfacePart& part,
               const Affine& mm_to_out,
               Space space) {
  const Placement place(mm_to_out);
  const InterfaceMesh& mesh = part.mesh;
  AtomicFile file(path);
  file.write("ply\nformat binary_little_endian 1.0\ncomment " + header(part, space) +
             "\nelement vertex " + std::to_string(mesh.points.size()) +
             "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
             std::to_string(mesh.facets.size()) +
             "\nproperty list uchar int vertex_indices\nend_header\n");
  std::string bytes;
  for (const Vec3& point : mesh.points) {
    const Vec3 p = place(point);
    bytes.clear();
    for (int axis = 0; axis < 3; ++axis)
      append_bytes(bytes, p[axis]);
    file.write(bytes);
  }
  for (const auto& facet : mesh.facets) {
    bytes.assign(1, '\3');
    for (const std::int32_t v : place(facet))
      append_bytes(bytes, v);
    file.write(bytes);
  }
  file.commit();
}

}  // namespace cvmesh
