// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/volume_error.h"

namespace cvmesh {

std::vector<VolumeError> measure_volume_error(const TetMesh& mesh, const LabelVolume& labels) {
  std::vector<VolumeError> result(labels.material_count());
  std::vector<std::size_t> voxels(labels.material_count(), 0);
  for (const MaterialId id : labels.ids.values)
    ++voxels[id];
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    result[mesh.material_of[t]].mesh_mm3 +=
        volume6(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]) / 6;
  }
  const Vec3& spacing = labels.frame().spacing_mm;
  for (std::size_t m = 1; m < result.size(); ++m) {
    VolumeError& error = result[m];
    error.voxels_mm3 = static_cast<double>(voxels[m]) * spacing.x * spacing.y * spacing.z;
    if (voxels[m] > 0)
      error.relative_error = (error.mesh_mm3 - error.voxels_mm3) / error.voxels_mm3;
  }
  return result;
}

}  // namespace cvmesh
