// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Particles by the stratum they live on and by the materials that they bound.
struct ParticleCounts {
  std::size_t total = 0, corners = 0, on_curves = 0, on_interfaces = 0;
  std::size_t guards = 0;                ///< added so that small parts stay surfaces
  std::vector<PatchKey> patches;         ///< the interfaces of the dense surface, sorted
  std::vector<std::size_t> on_patch;     ///< per interface: particles strictly inside it
  std::vector<std::size_t> of_material;  ///< per material: particles on its boundary
};

/// @param dense, strata  the surface whose strata the particles name
ParticleCounts count_particles(const ParticleSet& particles,
                               const InterfaceMesh& dense,
                               const Strata& strata,
                               std::size_t material_count);

}  // namespace cvmesh
