// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/mesh_names.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <string>
#include <vector>

namespace cvmesh {

/// Outcome of a check: empty means valid, otherwise one sentence per fault found (the first ten
/// of each kind), naming facet, vertex or material, and where it is.
struct Validation {
  std::vector<std::string> faults;

  [[nodiscard]] bool is_valid() const { return faults.empty(); }

  [[nodiscard]] std::string summary() const;  ///< all faults, one per line
};

/// Topology of one material's boundary surface.
struct BoundaryTopology {
  std::size_t components = 0;
  long long euler = 0;                   ///< V - E + F
  bool is_closed_manifold = false;       ///< every edge in two facets, every vertex link one cycle
  std::size_t nonmanifold_edges = 0;     ///< not in exactly two facets
  std::size_t nonmanifold_vertices = 0;  ///< two parts of the surface meet in the vertex only
};

/// One entry per material id.
std::vector<BoundaryTopology> boundary_topology(const InterfaceMesh& mesh,
                                                std::size_t material_count);

/// Every material's boundary closed, oriented, edge- and vertex-manifold; no repeated facet, no
/// repeated or non-finite point, no facet of zero area, `inside > outside`.
Validation validate(const InterfaceMesh& mesh,
                    std::size_t material_count,
                    const MeshNames& names = {});

/// Pairs of facets that intersect other than in shared vertices or edges, with exact predicates;
/// at most `max_pairs` are collected. O(n log n) expected.
std::vector<std::pair<std::int32_t, std::int32_t>> find_intersections(const InterfaceMesh& mesh,
                                                                      std::size_t max_pairs = 10);

/// Tets positive, faces in at most two tets, every surface facet a tet face with its materials on
/// the right sides, no other face between different materials or on the outside, volumes of the
/// materials equal to their surface integrals (relative 1e-9).
Validation validate(const TetMesh& mesh, std::size_t material_count, const MeshNames& names = {});

}  // namespace cvmesh
