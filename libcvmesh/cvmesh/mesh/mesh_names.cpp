// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/mesh_names.h"

#include <spdlog/fmt/fmt.h>

namespace cvmesh {

std::string MeshNames::material(MaterialId m) const {
  return material_name ? material_name(m) : fmt::format("material {}", m);
}

std::string MeshNames::place(const Vec3& p) const {
  if (place_name) return place_name(p);
  return fmt::format("({:.4g}, {:.4g}, {:.4g}) mm", p.x, p.y, p.z);
}

std::string MeshNames::facet(const InterfaceMesh& surface, std::int32_t facet) const {
  Vec3 centroid;
  for (const std::int32_t v : surface.facets[facet])
    centroid += surface.points[v] / 3;
  const Sides sides = surface.patch_of[facet].sides;
  return fmt::format("facet {} ({} and {}, near {})", facet, material(sides.inside),
                     material(sides.outside), place(centroid));
}

}  // namespace cvmesh
