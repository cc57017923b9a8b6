// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/metrics/distribution.h"

#include <array>
#include <cstddef>
#include <vector>

namespace cvmesh {

/// Shape of one tet.
struct TetShape {
  double radius_ratio = 0;     ///< 3r/R: 1 regular, 0 degenerate or inverted
  double scaled_jacobian = 0;  ///< 1 regular, 0 degenerate, negative inverted [Knupp 2006]
  std::array<double, 6> dihedral_deg{};  ///< at edges 01, 02, 03, 12, 13, 23
};

/// Radius ratio 3r/R (inscribed over circumscribed sphere), scaled Jacobian (sqrt(2) times six
/// volumes over the largest product of three edge lengths at a vertex) and dihedral angles.
TetShape tet_shape(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// Shapes of a set of tets.
struct TetQuality {
  static constexpr int kHistogramBins = 18;

  Distribution radius_ratio;      ///< 3r/R, one per tet
  Distribution scaled_jacobian;   ///< one per tet
  Distribution min_dihedral_deg;  ///< smallest angle of each tet
  Distribution max_dihedral_deg;  ///< largest angle of each tet
  std::array<std::size_t, kHistogramBins>
      dihedral_histogram{};  ///< all six angles, 10 degrees each
  std::size_t below_5_deg = 0, below_10_deg = 0, below_20_deg = 0;  ///< tets by smallest angle
  std::size_t above_165_deg = 0;                                    ///< tets by largest angle
};

/// Shapes of a set of surface triangles.
struct TriangleQuality {
  Distribution radius_ratio;   ///< 2r/R: 1 equilateral, 0 degenerate
  Distribution min_angle_deg;  ///< smallest angle of each triangle
};

/// Quality of a whole mesh; per-material entries are indexed by material id, [0] stays empty.
/// A facet counts for both of its materials.
struct MeshQuality {
  TetQuality tets;
  TriangleQuality triangles;
  std::vector<TetQuality> tets_of;
  std::vector<TriangleQuality> triangles_of;
};

/// Quality of the triangles of a surface: `triangles` and `triangles_of` of the result.
MeshQuality measure_quality(const InterfaceMesh& surface, std::size_t material_count);

/// Quality of the tets and of the surface triangles of `mesh`, in grid mm. O(n log n).
MeshQuality measure_quality(const TetMesh& mesh, std::size_t material_count);

}  // namespace cvmesh
