// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <functional>

/// Small meshes whose properties are known by hand.
namespace cvmesh::simple_meshes {

/// A square of two facets in the plane z = `z`, from (0, 0) to (side, side); material 1 is below.
InterfaceMesh square(double side, double z);

/// A tetrahedron: corners (0,0,0), (1,0,0), (0,1,0), (0,0,1) times `size`; material 1 inside.
InterfaceMesh corner_tetrahedron(double size = 1);

/// A sphere of `20 * 4^levels` facets with its vertices on the sphere.
InterfaceMesh sphere(const Vec3& centre, double radius, int levels, Sides sides = {1, 0});

/// The cube [0, 1]^3 of six tets around its diagonal (0,0,0)-(1,1,1). The tets with x <= y are of
/// material 1, the others of material 2; the surface holds the outside and the face between them.
TetMesh two_material_cube();

/// The box [0, n]^3 as n^3 cubes of six tets each, in a lattice: `material_at` gives the material
/// of a cube by its centre. The surface holds all faces between different materials and the
/// outside.
TetMesh lattice_box(int n, const std::function<MaterialId(const Vec3&)>& material_at);

/// Both meshes in one, nothing merged.
InterfaceMesh together(const InterfaceMesh& a, const InterfaceMesh& b);

}  // namespace cvmesh::simple_meshes
