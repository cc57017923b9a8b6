// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <functional>
#include <optional>

/// Dense surfaces against the truth, for the tests and the benchmark of level sets.
namespace cvmesh::label_grids {

/// A level set and its dense surface.
struct Smooth {
  LevelSets level_sets;
  InterfaceMesh mesh;
};

/// What is known of the true surface at a point: its signed distance from it, voxels, and the
/// outward normal there.
struct TruthAt {
  double distance;
  Vec3 normal;
};

/// Errors of dense vertices between materials 0 and 1, added up.
class SurfaceError {
 public:
  /// Adds the vertices of which `truth` knows something.
  void add(const Smooth& s, const std::function<std::optional<TruthAt>(const Vec3&)>& truth);

  [[nodiscard]] double rms() const;         ///< of the distances, voxels
  [[nodiscard]] double bias() const;        ///< mean signed distance, voxels
  [[nodiscard]] double normal_deg() const;  ///< mean angle of the field's gradient, by area

 private:
  double sum_ = 0, sum2_ = 0, count_ = 0;
  double angle_times_area_ = 0, area_ = 0;
};

/// Volume inside the boundary of a material, mm^3.
double volume_inside(const InterfaceMesh& mesh, MaterialId m);

}  // namespace cvmesh::label_grids
