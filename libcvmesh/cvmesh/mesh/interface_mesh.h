// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Which part of the multi-material boundary a facet belongs to: the pair of materials and, where
/// the volume was cut off by the border of the image, the box face (1..6: x-, x+, y-, y+, z-, z+;
/// 0 for a true interface). Edges between facets of different patches are curves.
struct PatchKey {
  Sides sides;
  std::uint16_t wall = 0;
  friend bool operator==(const PatchKey&, const PatchKey&) = default;
  friend auto operator<=>(const PatchKey&, const PatchKey&) = default;
};

/// A flat triangle mesh of all interfaces: each facet once, seen from its inside material the
/// vertices run counter-clockwise around the normal that points to the outside material.
///
/// Points are in grid millimetres. Every material's boundary (facets that have it on either side)
/// is a closed 2-manifold; no two facets share all three vertices.
struct InterfaceMesh {
  std::vector<Vec3> points;
  std::vector<std::array<std::int32_t, 3>> facets;
  std::vector<PatchKey> patch_of;  ///< one per facet
};

/// Strata of an interface mesh: vertices by dimension, curves as vertex chains.
///
/// A vertex with no curve edge is of dimension 2 (inside a patch), one with exactly two curve
/// edges is of dimension 1, any other is a corner (dimension 0). Derived data: `find_strata`.
struct Strata {
  struct Curve {
    std::vector<std::int32_t> vertices;  ///< in order; a closed curve does not repeat its first
    bool is_closed = false;              ///< open curves start and end at corners
    std::vector<PatchKey> patches;       ///< sorted keys of the patches that meet along it
  };

  std::vector<std::uint8_t> dimension;  ///< per vertex: 0 corner, 1 curve, 2 interface
  std::vector<Curve> curves;
  std::vector<std::int32_t> curve_of;  ///< per vertex: its curve for dimension 1, else -1
  std::vector<PatchKey> patches;       ///< sorted distinct keys
  std::vector<std::int32_t> patch_of;  ///< per facet: index into `patches`
};

/// Classifies vertices, facets and curves of `mesh`. Deterministic: curves are ordered by their
/// smallest vertex. O(facets log facets).
Strata find_strata(const InterfaceMesh& mesh);

/// Facets around each vertex, as one flat list: those of vertex v are
/// `facet[first[v]] .. facet[first[v + 1] - 1]`, in ascending order.
struct VertexStars {
  std::vector<std::int32_t> first, facet;
};

VertexStars find_vertex_stars(const InterfaceMesh& mesh);

}  // namespace cvmesh
