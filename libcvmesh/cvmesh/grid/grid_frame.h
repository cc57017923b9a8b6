// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <array>
#include <cstddef>
#include <cstdint>

namespace cvmesh {

/// Which way the world axes of a file point; `Grid` are grid millimetres, `Unknown` a file that
/// does not say.
enum class Space { Ras, Lps, Las, Grid, Unknown };

/// Name of a space as files and reports write it: "RAS", "LPS", "LAS", "grid", "unknown".
const char* space_name(Space space);

/// An affine map x -> A x + b, A row by row.
struct Affine {
  std::array<Vec3, 3> rows{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};
  Vec3 offset{};

  [[nodiscard]] Vec3 linear(const Vec3& v) const {
    return {dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)};
  }

  [[nodiscard]] Vec3 operator()(const Vec3& p) const { return linear(p) + offset; }

  [[nodiscard]] double determinant() const { return dot(cross(rows[0], rows[1]), rows[2]); }

  friend bool operator==(const Affine&, const Affine&) = default;
};

/// The map that undoes an affine map, whose determinant is not 0.
Affine inverse(const Affine& map);

/// Size and place of a voxel grid. Values sit at voxel centres, x fastest.
///
/// Three coordinate systems: *index* (voxel centres at integers), *grid millimetres* (index times
/// spacing; what every stage works in), *world* (the input file's own space, through
/// `index_to_world`). The only type that maps between them.
struct GridFrame {
  std::array<int, 3> dims{0, 0, 0};
  Vec3 spacing_mm{1, 1, 1};
  Affine index_to_world;
  Space space = Space::Unknown;

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(dims[0]) * dims[1] * dims[2];
  }

  [[nodiscard]] std::size_t linear(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * dims[1] + j) * dims[0] + i;
  }

  [[nodiscard]] bool contains(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < dims[0] && j < dims[1] && k < dims[2];
  }

  /// One voxel: the smallest spacing, in mm.
  [[nodiscard]] double voxel_mm() const {
    return std::min(spacing_mm.x, std::min(spacing_mm.y, spacing_mm.z));
  }

  [[nodiscard]] Vec3 index_to_mm(const Vec3& index) const { return scaled_by(index, spacing_mm); }

  [[nodiscard]] Vec3 mm_to_index(const Vec3& mm) const { return divided_by(mm, spacing_mm); }

  [[nodiscard]] Vec3 mm_to_world(const Vec3& mm) const { return index_to_world(mm_to_index(mm)); }
};

/// The frame of the sub-grid of `dims` voxels whose first voxel is `first` of `frame`; same world.
GridFrame cropped(const GridFrame& frame,
                  const std::array<int, 3>& first,
                  const std::array<int, 3>& dims);

/// The map grid millimetres -> `target` space. `Space::Grid` gives the identity; a target equal
/// to the frame's own space (or an unknown space) applies the frame's world affine; RAS, LPS and
/// LAS convert into each other by sign.
/// @throws Error BadParameter when the frame's space is unknown and another one is asked for
Affine mm_to_space(const GridFrame& frame, Space target);

}  // namespace cvmesh
