// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A part of a tet mesh, to be worked on alone and put back: what is done around a few tets then
/// costs what is around them, however large the mesh is.
///
/// The part is a tet mesh of its own. Vertices on its border with the rest are frozen: their tets
/// are not all here. They are among the first vertices of the part, as those of the surface are,
/// so that nobody takes them for vertices of the interior. Facets on the exterior that lie near,
/// with tets of the rest or none, are in the surface of the part, too: to keep away from.
class TetPart {
 public:
  TetMesh mesh;
  std::vector<bool> is_frozen;  ///< per vertex of the part's surface

  /// @param tets      in the middle of the part
  /// @param rings     of vertices around them that may change
  /// @param reach_mm  how near facets on the exterior are that the part has to know
  TetPart(const TetMesh& whole, const std::vector<std::int32_t>& tets, int rings, double reach_mm);

  /// Values of the vertices of the whole surface, for those of the part; its own places for frozen
  /// ones of the interior.
  [[nodiscard]] std::vector<Vec3> of_surface(const std::vector<Vec3>& of_whole) const;

  /// Puts the part in the place of what it was cut from. New vertices of its surface become the
  /// last of the whole surface's; tets of the part, and vertices of its interior, come last.
  /// @param whole  as it was
  void put_back(TetMesh& whole) const;

 private:
  void choose_tets(const TetMesh& whole, const std::vector<std::int32_t>& tets, int rings);
  void choose_facets(const TetMesh& whole, double reach_mm);
  void number_vertices(const TetMesh& whole);

  std::vector<bool> is_here_;          // per tet of the whole
  std::vector<std::uint8_t> role_of_;  // per vertex of the whole
  std::vector<std::int32_t> facets_;   // of the whole: its own, then those to keep away from
  std::size_t own_facets_ = 0;
  std::vector<std::int32_t> whole_of_;  // per vertex of the part
};

}  // namespace cvmesh
