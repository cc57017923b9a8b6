// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/particles/particle_set.h"

#include <cstddef>

namespace cvmesh {

struct DelaunayTetsStats {
  std::size_t particles = 0;         ///< at distinct places
  std::size_t unused_particles = 0;  ///< in no tet of a material
  std::size_t delaunay_tets = 0;     ///< those of the exterior among them
  std::size_t flat_tets = 0;         ///< of a material, without a volume in floating point
};

struct DelaunayTetsResult {
  TetMesh tets;
  DelaunayTetsStats stats;
};

/// The Delaunay reconstruction from particles [Boissonnat 1984, Meyer 2008]: all tets of their
/// Delaunay tetrahedralization, each of the material in which its circumcentre lies; the surface
/// is the faces between materials.
///
/// The baseline that the paper compares itself with. Where the particles are dense enough for the
/// local feature size the surface has the topology of the level sets; elsewhere it need not even
/// be a manifold, and materials may be lost. So the result keeps the invariants of `TetMesh` but
/// for positive volumes (slivers of four particles on one circle stay), and none of
/// `InterfaceMesh`'s; walls of the box are not told from other facets.
///
/// A material's side of a circumcentre is that of the largest level set there; beyond the grid it
/// is the exterior. O(n log n) expected.
DelaunayTetsResult delaunay_tets(const ParticleSet& particles,
                                 const LevelSets& level_sets,
                                 const StageContext& context);

}  // namespace cvmesh
