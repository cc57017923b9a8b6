// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/tet/improve_tets.h"

#include <vector>

namespace cvmesh {

/// Splits edges of the surface at tets that `improve_tets` left poor, and improves what is around
/// them, in rounds. A round that does not help on the whole is made once more only where it does;
/// if that is no better either, up to five more rounds go on from it (one, where no tet is poor by
/// what is reported). What counts is the state in which the tets lack least. What stays poor even
/// so gets moves of vertices of the surface that go as far as the rest of it lets them
/// (`GapOpener::Barred`), and the rounds once more.
///
/// Only a part of the mesh takes part, eight rings of vertices around the poor tets (`TetPart`): a
/// round costs what is around them, not what the mesh is. Holds up to four copies of that part.
///
/// @param home   where the surface's vertices were at first
/// @param stats  of the improvement before; what is done here is added to it
/// @throws Error Limit when `context.cancel` is set; `mesh` is as it was then
void refine_surface(TetMesh& mesh,
                    const std::vector<Vec3>& home,
                    const ImproveTetsOptions& options,
                    const StageContext& context,
                    ImproveTetsStats& stats);

}  // namespace cvmesh
