// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <array>
#include <string>

/// What the tests of the finite-element writers write.
namespace cvmesh::writer_meshes {

/// Corners of the edges of a tet, in the order of `TetMesh::mid_of`.
inline constexpr std::array<std::array<std::size_t, 2>, 6> kEdges = {
    {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}};

/// The cube of two materials, inconvenient in its numbers; its side at x = 0 is a box face.
TetMesh cube(bool is_second_order);

/// Labels -7 and 300 with these names.
LabelVolume named(const std::string& first, const std::string& second);

Affine oblique(bool is_mirrored);

}  // namespace cvmesh::writer_meshes
