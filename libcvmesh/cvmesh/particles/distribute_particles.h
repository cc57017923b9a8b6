// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/particles/sheets.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

enum class Seeding {
  Front,  ///< an advancing front of points at distances of h: 10 to 30 sweeps are enough
  Dense,  ///< the paper's: uniform and dense, thinned by the optimisation
};

struct SeedParticlesOptions {
  Seeding seeding = Seeding::Front;
  int min_component_particles = 12;  ///< on each closed component of an interface
};

struct SeedParticlesStats {
  std::size_t corners = 0, curve_particles = 0, interface_particles = 0, guard_particles = 0;
  /// Corners and curve particles off the place where their materials meet: on their dense vertex or
  /// edge, because that place is half a voxel away or more, or there is none (box, more materials).
  std::size_t on_dense_corner = 0, on_dense_curve = 0;
  double expected_interface_particles = 0;  ///< from the integral of dA / h^2, rims subtracted
};

struct SeedParticlesResult {
  ParticleSet particles;
  SeedParticlesStats stats;
};

/// The first places of all particles: corners and curves for good, interfaces by an advancing front
/// at distances of h (or uniform and dense), which still have to relax.
///
/// A closed component of an interface gets at least `min_component_particles` (never more than it
/// has dense vertices); a component with a rim at least one inner particle where it would have
/// none and its rim has only three, or where another component has the same rim.
/// @throws Error BadParameter for `min_component_particles` below 4
SeedParticlesResult seed_particles(const Sheets& sheets,
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
  std::size_t loop_guards = 0;     ///< added where a loop passed fewer than three particles
  std::size_t on_dense_facet = 0;  ///< could not be projected within half a voxel
  /// Edges of the local triangulations around the interface particles, over the mean h of their
  /// ends; the smallest is also the smallest distance of nearest neighbours over h.
  double edge_over_h_mean = 0, edge_over_h_sd = 0, edge_over_h_min = 0, edge_over_h_max = 0;
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
                                               const Sheets& sheets,
                                               const DistributeParticlesOptions& options,
                                               const StageContext& context);

}  // namespace cvmesh
