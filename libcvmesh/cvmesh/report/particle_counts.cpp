// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/particle_counts.h"

#include "cvmesh/labels/lattice_components.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

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

/// The specks of a label volume, those of the exterior included.
class Specks {
 public:
  explicit Specks(const Grid<MaterialId>& ids)
      : dims_(ids.frame.dims), spacing_(ids.frame.spacing_mm) {
    // `find_lattice_components` leaves the exterior out; here it is a material like others.
    Grid<MaterialId> shifted = ids;
    for (MaterialId& id : shifted.values)
      ++id;
    components_ = find_lattice_components(shifted);
  }

  /// True where one of the eight voxels around `position` (grid mm) is of a speck of `material`.
  [[nodiscard]] bool touch(const Vec3& position, MaterialId material) const {
    std::array<int, 3> first{}, last{};
    for (int axis = 0; axis < 3; ++axis) {
      const double x = position[axis] / spacing_[axis];
      const auto a = static_cast<std::size_t>(axis);
      first[a] = std::max(0, static_cast<int>(std::floor(x)));
      last[a] = std::min(dims_[a] - 1, static_cast<int>(std::ceil(x)));
    }
    for (int k = first[2]; k <= last[2]; ++k)
      for (int j = first[1]; j <= last[1]; ++j)
        for (int i = first[0]; i <= last[0]; ++i)
          if (is_speck_of(material + 1, i, j, k)) return true;
    return false;
  }

 private:
  [[nodiscard]] bool is_speck_of(int shifted, int i, int j, int k) const {
    const auto run = static_cast<std::size_t>(
        components_.run_at(static_cast<std::size_t>(k) * static_cast<std::size_t>(dims_[1]) +
                               static_cast<std::size_t>(j),
                           i));
    return components_.runs[run].material == shifted &&
           components_.voxels_of[components_.component_of[run]] < kSpeckVoxels;
  }

  std::array<int, 3> dims_;
  Vec3 spacing_;
  LatticeComponents components_;
};

}  // namespace

ParticleCounts count_particles(const ParticleSet& particles,
                               const InterfaceMesh& dense,
                               const Strata& strata,
                               const LabelVolume& labels) {
  ParticleCounts counts;
  counts.total = particles.particles.size();
  counts.patches = strata.patches;
  counts.on_patch.assign(strata.patches.size(), 0);
  counts.of_material.assign(labels.material_count(), 0);
  std::optional<Specks> specks;
  const VertexStars stars = find_vertex_stars(dense);
  for (const Particle& particle : particles.particles) {
    if (particle.dimension == 0) ++counts.corners;
    if (particle.dimension == 1) ++counts.on_curves;
    if (particle.dimension == 2) {
      ++counts.on_interfaces;
      ++counts.on_patch[static_cast<std::size_t>(particle.stratum)];
    }
    const std::vector<MaterialId> materials = materials_at(particle, dense, strata, stars);
    for (const MaterialId m : materials)
      ++counts.of_material[m];
    if (particle.origin == ParticleOrigin::Optimised) continue;
    ++counts.guards;
    if (!specks) specks.emplace(labels.ids);
    counts.guards_of_specks += std::any_of(materials.begin(), materials.end(), [&](MaterialId m) {
      return specks->touch(particle.position, m);
    });
  }
  return counts;
}

}  // namespace cvmesh
