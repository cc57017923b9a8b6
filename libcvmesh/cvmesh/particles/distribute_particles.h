// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <vector>

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/sizing/sizing_field.h"

namespace cvmesh {

/// Everything the particle stages read.
struct ParticleDomain {
  const InterfaceMesh& dense;
  const Strata& strata;
  const LevelSets& level_sets;
  const SizingField& sizing_field;
};

enum class Seeding {
  Poisson,  ///< Poisson-disk on the dense surface by h: 10 to 30 sweeps are enough
  Dense,    ///< the paper's: uniform and dense, thinned by the optimisation
};

struct SeedParticlesOptions {
  Seeding seeding = Seeding::Poisson;
  int min_component_particles = 12;  ///< on each closed component of an interface
};

struct SeedParticlesStats {
  std::size_t corners = 0, curve_particles = 0, interface_particles = 0, guard_particles = 0;
};

struct SeedParticlesResult {
  ParticleSet particles;
  SeedParticlesStats stats;
};

SeedParticlesResult seed_particles(const ParticleDomain& domain,
                                   const SeedParticlesOptions& options,
                                   const StageContext& context);

struct DistributeParticlesOptions {
  int max_sweeps = 30;
};

struct DistributeParticlesStats {
  int sweeps = 0;
  std::vector<double> energy;            ///< total energy after each sweep
  std::size_t split = 0, deleted = 0;
  std::size_t on_dense_facet = 0;        ///< could not be projected within half a voxel
  double edge_over_h_mean = 0, edge_over_h_sd = 0;
  double six_neighbour_share = 0;
};

struct DistributeParticlesResult {
  ParticleSet particles;
  DistributeParticlesStats stats;
};

DistributeParticlesResult distribute_particles(ParticleSet particles, const ParticleDomain& domain,
                                               const DistributeParticlesOptions& options,
                                               const StageContext& context);

}  // namespace cvmesh
