// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <filesystem>

namespace cvmesh {

/// How every file of `write_inp` begins.
inline constexpr char kInpFirstLine[] = "** cvmesh: mesh for Abaqus and CalculiX";

/// Writes the tets as the mesh part of an Abaqus or CalculiX input deck, for the job's own deck to
/// *INCLUDE: no loads, and no materials but those of the mesh's bins.
///
/// Numbers count from 1. Nodes are the mesh's points, then the mid nodes of a mesh of second order;
/// elements (C3D4, or C3D10) are its tets in their order, one block and ELSET `E_name` per label.
/// Each interface has its nodes as NSET `N_inside_outside` and, as SURFACE `S_inside_outside`, the
/// element faces on its inside; a box face is told by an end such as `_XMIN`. The two sides of a
/// contact are two of them, A_B and B_A, whose node sets list the node pairs in one order. Elastic
/// bins are ELSETs `B_001` with a *MATERIAL `M_B_001` and a *SOLID SECTION each. Comment lines at
/// the top say what is which. A mirroring map swaps two vertices of every tet, and its mid nodes
/// with them, so that volumes stay positive.
///
/// Coordinates read back as the same double where 20 characters do for that: CalculiX reads no
/// more. Else they are rounded to the digits that fit, at least 13.
///
/// @param mm_to_out  grid millimetres -> file coordinates
/// @param space      what those coordinates are
/// @throws Error Output when the file cannot be written
/// @note  O(tets log facets)
void write_inp(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space);

}  // namespace cvmesh
