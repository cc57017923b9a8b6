// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/tet/open_tets.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Tets whose space a new vertex takes over: connected, seen from it through every wall, and with
/// no facet between them.
struct Cavity {
  struct Wall {
    OpenTets::Face face;  ///< seen from inside, so that (face, vertex) is positive
    std::int32_t tet;
    std::size_t k;
    double sine;
  };

  std::vector<std::int32_t> tets;
  std::vector<Wall> walls;
  double worst = -1;  ///< smallest sine of the tets that the vertex would make

  /// The tets that vertex v would make.
  [[nodiscard]] std::vector<OpenTets::Tet> tets_with(std::int32_t v) const;
};

/// Places where a new vertex may help tet t: its centroid, the middle of the tets around it, and
/// off its facets, into the interior, far and near.
std::array<Vec3, 4> insertion_places(const OpenTets& tets, std::int32_t t);

/// The best cavity for a vertex near `p` that holds tet t. It grows from t through its worst wall
/// for as long as that can be opened, and the best state on the way is taken [Klingner 2008]; p
/// moves to where its worst wall is best. No tets where there is none.
Cavity dig_cavity(const OpenTets& tets, std::int32_t t, Vec3& p);

}  // namespace cvmesh
