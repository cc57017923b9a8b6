// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace cvmesh {

/// The two sides of an interface that was cut open: its nodes as pairs {on the inside, on the
/// outside} that lie in one place. On the rim, where the cut ends, both are the same node. Nodes
/// count `TetMesh::points` first, then `TetMesh::mid_points`.
struct Contact {
  Sides sides;
  std::vector<std::array<std::int32_t, 2>> pairs;  ///< ascending by the first
};

/// Named values, one per tet.
struct TetArray {
  std::string name;
  std::vector<double> values;
};

/// Tets that share one elastic material.
struct ElasticBin {
  double modulus_mpa = 0, poisson_ratio = 0;
  std::vector<std::int32_t> tets;
};

/// A conformal tetrahedral mesh of all materials. Tets have positive volume (`volume6 > 0` in
/// grid mm); the first `surface.points.size()` points are the surface's, unchanged and in order;
/// every facet of `surface` is a face of a tet.
struct TetMesh {
  std::vector<Vec3> points;  ///< grid mm
  std::vector<std::array<std::int32_t, 4>> tets;
  std::vector<MaterialId> material_of;  ///< per tet, never the exterior
  InterfaceMesh surface;                ///< interfaces and outer boundary

  /// Of second order: the nodes on the edges, none where the mesh is of first order.
  std::vector<Vec3> mid_points;  ///< grid mm
  /// Per tet, indices into `mid_points`, on the edges 01, 12, 20, 03, 13, 23 (the order of VTK,
  /// Abaqus and CalculiX).
  std::vector<std::array<std::int32_t, 6>> mid_of;

  /// Where interfaces were cut open (`split_contacts`): each of their facets is in `surface` twice,
  /// the second time with its sides swapped and the nodes of the outer material.
  std::vector<Contact> contacts{};
  /// Per node the one that it is a copy of, or itself; empty where nothing was cut.
  std::vector<std::int32_t> original_of{};

  std::vector<TetArray> arrays{};  ///< sampled from another image
  std::vector<ElasticBin> bins{};  ///< elastic materials made from it, ascending by modulus
};

}  // namespace cvmesh
