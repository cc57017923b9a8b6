// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace cvmesh {

/// Splits edges of the surface in their middles, with all facets and tets around them: the longest
/// edge of each of some tets, those first that come first. The surface stays where it is.
///
/// Of two edges of one tet only the first is split, so every tet becomes two at most. The new
/// vertices are the last of the surface's; vertices of the interior get higher numbers.
///
/// @param tets       wanted to have shorter edges; those without an edge of the surface stay
/// @param is_frozen  vertices of the surface; edges between two of them stay
/// @param least_mm   shorter edges stay
/// @param most       edges to split
/// @return the new vertices and those of the tets around them, ascending; empty where none was
///         split, with nothing changed
std::vector<std::int32_t> split_surface_edges(TetMesh& mesh,
                                              std::span<const std::int32_t> tets,
                                              const std::vector<bool>& is_frozen,
                                              double least_mm,
                                              std::size_t most);

}  // namespace cvmesh
