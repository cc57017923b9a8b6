// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace cvmesh {

/// Named values, one per point, for a VTK file.
struct PointArrays {
  struct Doubles {
    std::string name;
    std::span<const double> values;
  };

  struct Integers {
    std::string name;
    std::span<const std::int32_t> values;
  };

  std::vector<Doubles> doubles;
  std::vector<Integers> integers;
};

/// Writes the interfaces as VTK XML poly data: arrays in base64, Float64 points.
///
/// Cell arrays, Int32: `inside_label`, `outside_label` (the exterior is `exterior_label`: 0, or
/// the largest negative number that is no label where label 0 is meshed) and `interface`, the
/// 1-based row of `interface_names`, the same numbers as in the Medit file. Field data as in
/// `write_vtu`, and `interface_names`. Normals point from inside to outside in file coordinates.
/// @throws Error Output when the file cannot be written
void write_surface_vtp(const std::filesystem::path& path,
                       const InterfaceMesh& mesh,
                       const LabelVolume& labels,
                       const Affine& mm_to_out,
                       Space space);

/// Writes the facets as a plain OFF file, numbers in their shortest form that reads back as the
/// same double.
/// @throws Error Output when the file cannot be written
void write_off(const std::filesystem::path& path,
               const InterfaceMesh& mesh,
               const Affine& mm_to_out);

/// Writes points with values as VTK XML poly data, one vertex cell per point.
/// @throws Error Output when the file cannot be written; Internal when an array has another length
void write_points_vtp(const std::filesystem::path& path,
                      std::span<const Vec3> points,
                      const PointArrays& arrays,
                      const Affine& mm_to_out,
                      Space space);

/// Writes a triangle mesh with values at its vertices as VTK XML poly data.
/// @throws Error Output when the file cannot be written; Internal when an array has another length
void write_vertex_field_vtp(const std::filesystem::path& path,
                            const InterfaceMesh& mesh,
                            const PointArrays& arrays,
                            const Affine& mm_to_out,
                            Space space);

}  // namespace cvmesh
