// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <filesystem>
#include <string>
#include <vector>

namespace cvmesh {

/// One surface for a file of its own: the boundary of a label, or one interface.
struct SurfacePart {
  /// `label_3`, `interface_3_2` or, on a box face, `interface_3_0_xmin`: the values of the labels,
  /// not their names, which may be anything.
  std::string name;
  std::string description;  ///< one line for people
  InterfaceMesh mesh;       ///< with the points that it uses, in their order
};

/// The closed boundary of every label, seen from that label, and then every interface. Of the two
/// sides of a contact each is an interface of its own.
/// @note  each facet is copied three times
std::vector<SurfacePart> surface_parts(const InterfaceMesh& mesh, const LabelVolume& labels);

/// Whether `file_name` is NAME.`part`.`suffix`, with a part named as in `surface_parts` and the
/// suffix stl, ply or vtp.
bool is_surface_part_file(const std::string& file_name, const std::string& name);

/// Writes one part as binary STL. Its header of 80 bytes begins with "cvmesh SPACE=..." and goes on
/// with the description; coordinates are of single precision, as the format has it.
/// @throws Error Output when the file cannot be written
void write_stl(const std::filesystem::path& path,
               const SurfacePart& part,
               const Affine& mm_to_out,
               Space space);

/// Writes one part as binary PLY, coordinates in double precision; space and description as a
/// comment. Faces have no further properties: not every reader knows them.
/// @throws Error Output when the file cannot be written
void write_ply(const std::filesystem::path& path,
               const SurfacePart& part,
               const Affine& mm_to_out,
               Space space);

}  // namespace cvmesh
