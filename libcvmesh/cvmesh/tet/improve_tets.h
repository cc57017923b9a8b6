// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>

namespace cvmesh {

/// Hill-climbing improvement of the interior of a tetrahedral mesh, the surface frozen
/// [Freitag 1997, Klingner 2008].
///
/// The quality of a tet is the smallest sine of its six dihedral angles. Each pass removes interior
/// edges by the best retriangulation of their ring (the 3-2 and 4-4 flips and their general form),
/// flips faces 2-3, moves interior vertices to where the worst tet around them is best, and puts a
/// new vertex where tets stay poor: between the walls of a sparse surface TetGen adds none. A
/// change is made only if the worst quality of the tets it touches rises, so the worst quality of
/// the mesh never falls. Points and facets of `surface` never change, so a tet between two facets
/// that meet at a small angle keeps that angle. Interior vertices may go, and indices above those
/// of the surface may change.
struct ImproveTetsOptions {
  int passes = 8;                        ///< upper bound; stops earlier once a pass changes little
  double flip_below_deg = 40;            ///< only tets with an angle below this (or above 180 - it)
  double smooth_below_deg = 45;          ///< only vertices with such a tet
  double insert_below_deg = 20;          ///< a new vertex only for such a tet; 0: none
  double max_insertions_per_vertex = 1;  ///< bound on new vertices, over those of the mesh
  int max_ring = 8;                      ///< most tets around an edge that is removed
};

struct ImproveTetsStats {
  int passes = 0;
  std::size_t moves = 0, edge_removals = 0, face_flips = 0, insertions = 0;
  double min_dihedral_before_deg = 0, min_dihedral_after_deg = 0;
  double max_dihedral_before_deg = 0, max_dihedral_after_deg = 0;
  std::size_t below_10_deg_before = 0, below_10_deg_after = 0;  ///< tets by smallest dihedral angle
  std::size_t wedges_below_10_deg = 0;  ///< of them after: between two facets, so bound to stay
};

/// Smallest sine of the dihedral angles of tet abcd, negative when the tet is inverted, 0 when it
/// is flat.
double min_dihedral_sine(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// Improves `mesh` in place and says what was done. Deterministic; sequential.
/// Time about 5 microseconds per tet and pass, memory about 150 bytes per tet.
///
/// @throws Error Limit when `context.cancel` is set
ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context);

}  // namespace cvmesh
