// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <filesystem>

namespace cvmesh {

/// A comment of every file of `write_feb`.
inline constexpr char kFebMark[] = "cvmesh: mesh for FEBio";

/// Writes the tets as an FEBio model, format 4.0: the mesh, and as much more as FEBio needs to open
/// it; no steps, no loads.
///
/// One part (`Elements`, tet4 or tet10) and solid domain per label, named by `plain_label_names`;
/// one `Surface` (tri3 or tri6, turned from inside to outside) and one `NodeSet` per interface,
/// named by `plain_interface_names`; at contacts a `SurfacePair` of the two sides. Every part has a
/// neo-Hookean material of E = 1, v = 0.3: a placeholder, as a comment says. The label values are
/// in comments, too. Numbers as in `write_msh`.
///
/// @param mm_to_out  grid millimetres -> file coordinates
/// @param space      what those coordinates are
/// @throws Error Output when the file cannot be written
void write_feb(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space);

}  // namespace cvmesh
