// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/particle_counts.h"

#include <algorithm>

namespace cvmesh {

namespace {

void add_sides(const Sides& sides, std::vector<MaterialId>& materials) {
  materials.push_back(sides.inside);
  materials.push_back(sides.outside);
}

/// The materials that meet at a particle, ascending.
std::vector<MaterialId> materials_at(const Particle& particle,
                                     const InterfaceMesh& dense,
                                     const Strata& strata,
                                     const VertexStars& stars) {
  std::vector<MaterialId> materials;
  const auto stratum = static_cast<std::size_t>(particle.stratum);
  if (particle.dimension == 2) {
    add_sides(strata.patches[stratum].sides, materials);
  } else if (particle.dimension == 1) {
    for (const PatchKey& patch : strata.curves[stratum].patches)
      add_sides(patch.sides, materials);
  } else {
    for (std::int32_t i = stars.first[stratum]; i < stars.first[stratum + 1]; ++i)
      add_sides(
          dense.patch_of[static_cast<std::size_t>(stars.facet[static_cast<std::size_t>(i)])].sides,
          materials);
  }
  std::sort(materials.begin(), materials.end());
  materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
  return materials;
}

}  // namespace

ParticleCounts count_particles(const ParticleSet& particles,
                               const InterfaceMesh& dense,
                               const Strata& strata,
                               std::size_t material_count) {
  ParticleCounts counts;
  counts.total = particles.particles.size();
  counts.patches = strata.patches;
  counts.on_patch.assign(strata.patches.size(), 0);
  counts.of_material.assign(material_count, 0);
  const VertexStars stars = find_vertex_stars(dense);
  for (const Particle& particle : particles.particles) {
    if (particle.dimension == 0) ++counts.corners;
    if (particle.dimension == 1) ++counts.on_curves;
    if (particle.dimension == 2) {
      ++counts.on_interfaces;
      ++counts.on_patch[static_cast<std::size_t>(particle.stratum)];
    }
    if (particle.origin == ParticleOrigin::Guard) ++counts.guards;
    for (const MaterialId m : materials_at(particle, dense, strata, stars))
      ++counts.of_material[m];
  }
  return counts;
}

}  // namespace cvmesh
