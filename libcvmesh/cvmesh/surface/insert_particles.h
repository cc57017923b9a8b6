// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/particles/particle_set.h"

#include <cstdint>
#include <vector>

namespace cvmesh {

struct InsertParticlesStats {
  std::size_t snapped = 0;  ///< a dense vertex moved onto the particle
  std::size_t edge_splits = 0, facet_splits = 0;
  std::size_t shared = 0;        ///< too near to a vertex for one of their own: it stands for both
  std::size_t off_position = 0;  ///< kept on the dense surface: the exact place would fold it
};

struct InsertParticlesResult {
  MaterialSurfaces surfaces;            ///< the augmented surfaces
  std::vector<std::int32_t> vertex_of;  ///< per particle: its vertex in `surfaces`, often its own
  InsertParticlesStats stats;
};

/// The augmented surfaces: every particle is a vertex of every material surface it lies on
/// (paper, §7.4), by moving a dense vertex, splitting an edge or splitting a facet.
/// @throws Error StageFailed when a particle cannot be inserted
InsertParticlesResult insert_particles(MaterialSurfaces surfaces,
                                       const Strata& strata,
                                       const ParticleSet& particles,
                                       double voxel_mm,
                                       const StageContext& context);

}  // namespace cvmesh
