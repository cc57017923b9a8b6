// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstdint>
#include <functional>
#include <string>

namespace cvmesh {

/// What messages call materials and places.
struct MeshNames {
  std::function<std::string(MaterialId)> material_name;  ///< empty: "material 3"
  std::function<std::string(const Vec3&)> place_name;    ///< of grid mm; empty: "(1, 2, 3) mm"

  [[nodiscard]] std::string material(MaterialId m) const;
  [[nodiscard]] std::string place(const Vec3& p) const;
  /// A facet so that its place can be found: its number, the materials on both sides and a point.
  [[nodiscard]] std::string facet(const InterfaceMesh& surface, std::int32_t facet) const;
};

}  // namespace cvmesh
