// SPDX-License-Identifier: AGPL-3.0-or-later
#include "io/writer_meshes.h"

#include "metrics/simple_meshes.h"
#include <algorithm>
#include <map>

namespace cvmesh::writer_meshes {

TetMesh cube(bool is_second_order) {
  TetMesh mesh = simple_meshes::two_material_cube();
  for (std::size_t i = 0; i < mesh.surface.facets.size(); ++i) {
    const auto& facet = mesh.surface.facets[i];
    const bool is_wall = std::all_of(facet.begin(), facet.end(), [&](std::int32_t v) {
      return mesh.points[static_cast<std::size_t>(v)].x == 0;
    });
    if (is_wall) mesh.surface.patch_of[i].wall = 1;
  }
  for (Vec3& p : mesh.points)
    p = Vec3{1.0 / 3, 0.7, 1e-7} + Vec3{p.x * 0.1, p.y + 0.01 * p.x, p.z * 12.3456789};
  mesh.surface.points = mesh.points;
  if (!is_second_order) return mesh;
  std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> mid_on;
  for (const auto& tet : mesh.tets) {
    auto& mids = mesh.mid_of.emplace_back();
    for (std::size_t e = 0; e < kEdges.size(); ++e) {
      const std::int32_t a = tet[kEdges[e][0]], b = tet[kEdges[e][1]];
      const auto [entry, is_new] =
          mid_on.try_emplace(std::minmax(a, b), static_cast<std::int32_t>(mesh.mid_points.size()));
      if (is_new)
        mesh.mid_points.push_back(0.5 * (mesh.points[static_cast<std::size_t>(a)] +
                                         mesh.points[static_cast<std::size_t>(b)]));
      mids[e] = entry->second;
    }
  }
  return mesh;
}

LabelVolume named(const std::string& first, const std::string& second) {
  LabelVolume labels;
  labels.label_of = {0, -7, 300};
  labels.name_of = {"exterior", first, second};
  return labels;
}

Affine oblique(bool is_mirrored) {
  Affine map;
  map.rows = {Vec3{0.8, -0.6, 0}, Vec3{0.6, 0.8, 0}, Vec3{0, 0, is_mirrored ? -1.0 : 1.0}};
  map.offset = {10.125, -20, 1e3 / 7};
  return map;
}

}  // namespace cvmesh::writer_meshes
