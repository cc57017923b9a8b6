// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstdint>

namespace cvmesh {

/// How good the tets on the facets of a surface can be, whatever is done inside.
///
/// A tet whose dihedral angles at the three edges of its face are all above theta holds the pyramid
/// that rises from the face with theta at each of them. The surface does not pass through a tet, so
/// where it enters that pyramid there is no such tet: the smallest angle of the tet on a facet is
/// at most the theta at which the rising pyramid meets the surface. A narrow wedge at an edge of
/// the facet is a special case of it, as is a sheet of the surface near above the facet.
class AngleBounds {
 public:
  /// @param surface  is referred to, and must not change
  explicit AngleBounds(const InterfaceMesh& surface);

  /// No tet on the facet `corners`, on the side from which they run counter-clockwise, has a
  /// smallest dihedral angle above this, in degrees; `most_deg` where there is no lower bound.
  /// @param most_deg  below 90
  [[nodiscard]] double of_tet_on(const std::array<std::int32_t, 3>& corners, double most_deg) const;

 private:
  const InterfaceMesh& surface_;
  FacetIndex index_;
};

}  // namespace cvmesh
