// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <filesystem>

namespace cvmesh {

/// Writes the tets as a VTK XML unstructured grid: arrays in base64, Float64 points.
///
/// Cell array `labels` (Int32, the scalars) holds the user's label of each tet. Field data: `SPACE`
/// (string), `label_values`, `label_names`, `exterior_label`. A mirroring map swaps two vertices
/// of every tet, so that volumes stay positive. Tets of second order become quadratic tetrahedra.
/// Values sampled onto the tets are further cell arrays (Float64). Where contacts were cut open,
/// the point array `original_point` gives each copy the index of the point that it copies.
///
/// @param mm_to_out  grid millimetres -> file coordinates
/// @param space      what those coordinates are
/// @throws Error Output when the file cannot be written
void write_vtu(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space);

/// Writes tets and surface facets as Medit ASCII (version 2), numbers in their shortest form that
/// reads back as the same double.
///
/// Tet references are the user's labels. Triangle references count the rows of the interface
/// table, which comment lines (#) at the top spell out, after one with the space. Tets of second
/// order are written by their corners: few readers know more.
/// @throws Error Output when the file cannot be written
void write_medit(const std::filesystem::path& path,
                 const TetMesh& mesh,
                 const LabelVolume& labels,
                 const Affine& mm_to_out,
                 Space space);

}  // namespace cvmesh
