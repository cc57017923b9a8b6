// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// A connected component with fewer voxels is a speck: no sizing field resolves it, so it lives by
/// its guards.
inline constexpr std::size_t kSpeckVoxels = 30;

/// Particles by the stratum they live on and by the materials that they bound.
struct ParticleCounts {
  std::size_t total = 0, corners = 0, on_curves = 0, on_interfaces = 0;
  std::size_t guards = 0;                ///< added so that small parts stay surfaces
  std::size_t guards_of_specks = 0;      ///< of them on components below `kSpeckVoxels` voxels
  std::vector<PatchKey> patches;         ///< the interfaces of the dense surface, sorted
  std::vector<std::size_t> on_patch;     ///< per interface: particles strictly inside it
  std::vector<std::size_t> of_material;  ///< per material: particles on its boundary
};

/// @param dense, strata  the surface whose strata the particles name, made from `labels`
ParticleCounts count_particles(const ParticleSet& particles,
                               const InterfaceMesh& dense,
                               const Strata& strata,
                               const LabelVolume& labels);

}  // namespace cvmesh
