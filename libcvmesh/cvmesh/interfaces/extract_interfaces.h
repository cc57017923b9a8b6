// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"

namespace cvmesh {

/// The dense surfaces: the interfaces of all materials by label marching tetrahedra on the
/// Freudenthal lattice [Bloomenthal 1995, Nielson 1997].
///
/// The combinatorics depend on the node labels only, so each material boundary is a closed
/// 2-manifold with the topology of its voxels on the 14-neighbour lattice, and conformity is by
/// construction. The box of the grid (half a voxel outside the outermost nodes) closes materials
/// that reach it, exactly: its faces are planes with their own patches (`PatchKey::wall`).
/// Points are in grid mm; points and facets are numbered along a curve (`sort_along_curve`). Linear
/// in the number of voxels but for that order.
InterfaceMesh extract_interfaces(const LevelSets& level_sets, const StageContext& context);

}  // namespace cvmesh
