// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/mesh_counts.h"

#include <algorithm>

namespace cvmesh {

MeshCounts count_mesh(const TetMesh& mesh, std::size_t material_count) {
  MeshCounts counts;
  counts.points = mesh.points.size();
  counts.tets = mesh.tets.size();
  counts.surface_triangles = mesh.surface.facets.size();
  counts.tets_of.assign(material_count, 0);
  counts.triangles_of.assign(material_count, 0);
  for (const MaterialId m : mesh.material_of)
    ++counts.tets_of[m];
  std::vector<bool> is_on_surface(mesh.points.size(), false);
  for (std::size_t f = 0; f < mesh.surface.facets.size(); ++f) {
    const PatchKey& patch = mesh.surface.patch_of[f];
    if (patch.wall != 0) ++counts.wall_triangles;
    ++counts.triangles_of[patch.sides.inside];
    ++counts.triangles_of[patch.sides.outside];
    for (const std::int32_t v : mesh.surface.facets[f])
      is_on_surface[v] = true;
  }
  counts.surface_vertices =
      static_cast<std::size_t>(std::count(is_on_surface.begin(), is_on_surface.end(), true));
  counts.interior_points = counts.points - counts.surface_vertices;
  return counts;
}

}  // namespace cvmesh
