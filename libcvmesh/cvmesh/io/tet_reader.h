// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid_frame.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

/// The tetrahedra of a mesh file, of whatever program: nothing is assumed of their shape or of how
/// they fit together. Indices are in range and points are finite.
struct TetFile {
  std::vector<Vec3> points;                       ///< in the coordinates of the file
  std::vector<std::array<std::int32_t, 4>> tets;  ///< corners only, where the file has more nodes
  std::vector<Label> label_of;                    ///< one per tet
  std::string label_source;                       ///< the array or field that the labels come from
  std::optional<Space> space;                     ///< where the file states it
  std::size_t other_elements = 0;                 ///< triangles, edges and so on, passed over
};

/// Reads the tets of a file by its suffix:
/// - `.vtu`, VTK XML, little endian: ascii, base64 inline, appended raw or base64, zlib or not. Of
///   several pieces, points in the same place are one. Labels are the cell array `labels`, else
///   `material`, `ref`, `medit:ref`, `gmsh:physical`, `gmsh:geometrical`, in this order.
/// - `.mesh`, Medit ASCII: labels are the references.
/// - `.msh`, Gmsh 2.2 and 4.1, text or binary (little endian): labels are the physical groups, else
/// the entities' numbers.
///
/// @throws Error BadInput naming file, line or array, and value, when the file is damaged, of
///         another kind, or has no tets or no labels
TetFile read_tet_file(const std::filesystem::path& path);

namespace detail {
TetFile read_vtu(const std::filesystem::path& path, const std::string& content);
TetFile read_medit(const std::filesystem::path& path, const std::string& content);
TetFile read_gmsh(const std::filesystem::path& path, const std::string& content);

/// The space with this name, as files state it; empty for "unknown" and for other words.
std::optional<Space> space_of_name(const std::string& name);
}  // namespace detail

}  // namespace cvmesh
