// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/sizing/sizing_field.h"

#include <cstddef>
#include <vector>

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
  double expected_interface_particles = 0;  ///< from the integral of dA / h^2, rims subtracted
};

struct SeedParticlesResult {
  ParticleSet particles;
  SeedParticlesStats stats;
};

/// The first places of all particles: corners and curves for good, interfaces as a Poisson-disk
/// sample by h (or uniform and dense) that still has to relax.
///
/// A closed component of an interface gets at least `min_component_particles` (never more than it
/// has dense vertices); a component with a rim at least one inner particle where it would have
/// none and its rim has only three, or where another component has the same rim.
/// @throws Error BadParameter for `min_component_particles` below 4
/// @throws Error Internal when the sizing field does not belong to the dense surface
SeedParticlesResult seed_particles(const ParticleDomain& domain,
                                   const SeedParticlesOptions& options,
                                   const StageContext& context);

struct DistributeParticlesOptions {
  int max_sweeps = 30;
};

struct DistributeParticlesStats {
  int sweeps = 0;  ///< thinning rounds of dense seeds not counted
  int thinning_rounds = 0;
  std::vector<double> energy;  ///< total energy after each sweep
  std::size_t split = 0, deleted = 0;
  std::size_t on_dense_facet = 0;  ///< could not be projected within half a voxel
  double edge_over_h_mean = 0, edge_over_h_sd = 0;
  double nearest_over_h_mean = 0;
  double six_neighbour_share = 0;  ///< of the interface particles
};

struct DistributeParticlesResult {
  ParticleSet particles;
  DistributeParticlesStats stats;
};

/// The particles after relaxation: on every interface at distances of about h, six neighbours each
/// where the surface allows it [Meyer 2005, Meyer 2007].
///
/// Particles of an interface move one after the other (in parallel where they do not feel each
/// other) by damped Newton steps of Meyer's radial energy in the tangent plane, and are projected
/// back onto the zero set after each. Corner and curve particles stay and act as neighbours. Only
/// particles on one sheet, with normals less than 90 degrees apart, see each other: at large
/// epsilon the opposite wall of a thin part is nearer than the next particle. Crowded particles
/// are deleted and gaps filled until the count of each component is that of its sizing field.
/// Same result at any number of threads.
DistributeParticlesResult distribute_particles(ParticleSet particles,
                                               const ParticleDomain& domain,
                                               const DistributeParticlesOptions& options,
                                               const StageContext& context);

}  // namespace cvmesh
