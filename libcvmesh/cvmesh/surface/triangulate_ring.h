// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/surface/surface_objective.h"

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace cvmesh {

/// A polygon in space that is to be filled with triangles.
struct RingProblem {
  /// Longest ring that is tried; longer ones wait until their neighbours are gone.
  static constexpr int kMaxRing = 48;

  std::vector<Vec3> ring;           ///< counter-clockwise seen along -normal
  Vec3 normal;                      ///< mean unit normal of what was there
  std::vector<Vec3> outer_normals;  ///< across side i, i + 1: unit, zero for no fold test
  bool is_disk = true;              ///< false: side n - 1, 0 is new (a curve edge)
  std::vector<std::uint64_t> forbidden_edges;  ///< bit j of entry i: edge i-j exists elsewhere
  std::vector<std::array<std::uint8_t, 3>> forbidden_triangles;
  std::vector<Vec3> samples;  ///< dense points that the triangles should stay near
  double spacing_mm = 0;      ///< of the samples: how far the nearest one may be without meaning

  /// Empties the problem for a ring of n vertices, keeping its memory.
  void clear(std::size_t n) {
    ring.clear();
    outer_normals.assign(n, Vec3{});
    forbidden_edges.assign(n, 0);
    forbidden_triangles.clear();
    samples.clear();
    spacing_mm = 0;
  }
};

/// Hard limits; the decimation loosens them pass by pass.
struct RingLimits {
  double min_quality = 0.1;
  double min_normal_cosine = 0.26;  ///< against the mean normal
  double min_fold_cosine = -0.5;    ///< between neighbouring triangles
};

/// The triangulation of the ring with the least objective, over all triangulations that respect
/// the limits [Barequet 1995]: dynamic programming, O(n^3 (1 + samples)).
///
/// Fold terms couple a triangle with the best partner found so far across each diagonal, as in
/// [Liepa 2003]. Nothing is returned when no triangulation respects the limits.
std::optional<MaterialSurfaces::Triangulation> triangulate_ring(const RingProblem& problem,
                                                                const RingLimits& limits,
                                                                const SurfaceObjective& objective);

}  // namespace cvmesh
