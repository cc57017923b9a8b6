// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <cstdint>
#include <vector>

namespace cvmesh {

/// Why a particle is there.
enum class ParticleOrigin : std::uint8_t {
  Optimised,  ///< from the distribution itself
  Guard,      ///< added so that a small or closed part keeps enough vertices to be a surface
  Bend,       ///< added where a junction curve bends too much for the chord between two others
};

/// The vertices-to-be of the sparse mesh: corners, then junction curves, then interfaces.
///
/// Each particle knows the stratum it lives on and its place on the dense surface: a dense vertex
/// (corners), a dense edge given by its two end vertices (curves), or a dense facet (interfaces).
/// Its position lies within half a voxel of that carrier.
struct Particle {
  Vec3 position;               ///< grid mm
  double h_mm = 0;             ///< target edge length here
  std::uint8_t dimension = 2;  ///< 0 corner, 1 curve, 2 interface
  ParticleOrigin origin = ParticleOrigin::Optimised;
  bool is_on_stratum = true;           ///< on the smooth stratum itself, not just on its carrier
  std::int32_t stratum = -1;           ///< dense vertex (0), curve (1) or patch (2) of `Strata`
  std::int32_t carrier[2] = {-1, -1};  ///< dense vertex | two dense vertices of an edge | facet
};

struct ParticleSet {
  std::vector<Particle> particles;  ///< sorted by dimension, then stratum
};

}  // namespace cvmesh
