// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace cvmesh {

/// A triangle surface as a file holds it, in the coordinates of the file. Indices are in range and
/// points are finite; nothing else is assumed.
struct SurfaceFile {
  std::vector<Vec3> points;
  std::vector<std::array<std::int32_t, 3>> facets;
};

/// Reads a surface by the file's suffix: `.off` (text), `.ply` (text, or binary of either byte
/// order), `.stl` (text or binary; points are not merged). Polygons of more than three corners are
/// cut into triangles from their first corner.
///
/// @throws Error BadInput naming file, line or face, and value, when the file is damaged or has no
///         facets
SurfaceFile read_surface_file(const std::filesystem::path& path);

}  // namespace cvmesh
