// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/sizing/sizing_field.h"

#include <array>
#include <functional>
#include <utility>
#include <vector>

/// Closed surfaces with known volumes, made by subdivision, for the tests of the tet stage.
namespace cvmesh::shapes {

/// The sphere with `4^levels * 20` facets: a subdivided icosahedron, vertices on the sphere.
InterfaceMesh sphere(const Vec3& centre, double radius, int levels, Sides sides);

/// The box [lo, hi] with n x n x n quads a side, each cut in two.
InterfaceMesh box(const Vec3& lo, const Vec3& hi, int n, Sides sides);

/// A torus around the z axis with `around` x `across` quads, each cut in two.
InterfaceMesh torus(double major, double minor, int around, int across, Sides sides);

/// One tet with corners at the origin and on the axes at `size`.
InterfaceMesh single_tet(double size, Sides sides);

/// Both meshes in one; points that agree to the last bit become one, and a facet that both have
/// becomes one facet between the two insides.
InterfaceMesh join(const InterfaceMesh& a, const InterfaceMesh& b);

/// Volume on the inside of the facets whose sides are exactly `sides`.
double enclosed_volume(const InterfaceMesh& mesh, Sides sides);

/// h given by a function on a grid of 33^3 nodes over [lo, hi], which must start at the origin of
/// grid millimetres.
SizingField sizing(const Vec3& hi, const std::function<double(const Vec3&)>& h);

/// The tets that TetGen fills a surface of two materials with, inside (0, 0, 0) to (40, 40, 40),
/// not improved.
TetMesh filled(const InterfaceMesh& surface);

/// Such tets of two spheres, one a little smaller than the other: the material between them is
/// thinner than its facets are long.
TetMesh thin_wall();

/// Every tet by the places of its corners, whatever their numbers are, and its material; in an
/// order that depends on these alone.
std::vector<std::pair<std::array<Vec3, 4>, MaterialId>> places(const TetMesh& mesh);

/// Of the tets of the exterior (none) and of materials 1 and 2.
std::vector<double> volumes(const TetMesh& mesh);

/// Requires what `validate` asks of a mesh of two materials.
void require_valid(const TetMesh& mesh);

/// Points the library to the helper program unless the environment already does.
void find_helper();

}  // namespace cvmesh::shapes
