// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <filesystem>

namespace cvmesh {

/// A comment of every file of `write_msh` and `write_msh22`.
inline constexpr char kMshMark[] = "cvmesh: mesh for Gmsh";

/// Writes tets and interfaces as Gmsh MSH 4.1 (ASCII).
///
/// Physical volumes are the labels, by name, with the label's value as tag; labels of 0 and less,
/// which Gmsh takes for none, get tags above the largest label, as comments say. Physical surfaces
/// are the interfaces, their tags the rows of the interface table above the tags of all volumes,
/// their triangles turned from inside to outside. Nodes are the mesh's points, then its mid nodes;
/// numbers are in their shortest form that reads back as the same double. Tets of second order are
/// 10-node tets whose last two nodes stand in Gmsh's order. Copies of nodes at contacts are told
/// by the node data `original_point`, values sampled onto the tets are element data.
///
/// @param mm_to_out  grid millimetres -> file coordinates
/// @param space      what those coordinates are
/// @throws Error Output when the file cannot be written
void write_msh(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space);

/// The same as MSH 2.2 (ASCII), for readers that know no other.
void write_msh22(const std::filesystem::path& path,
                 const TetMesh& mesh,
                 const LabelVolume& labels,
                 const Affine& mm_to_out,
                 Space space);

}  // namespace cvmesh
