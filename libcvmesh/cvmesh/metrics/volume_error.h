// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Volume of one material in the mesh against its voxels.
struct VolumeError {
  double voxels_mm3 = 0;      ///< number of voxels times the volume of one
  double mesh_mm3 = 0;        ///< sum over the material's tets
  double relative_error = 0;  ///< (mesh - voxels) / voxels; 0 where there are no voxels
};

/// One entry per material id; [0] stays empty.
std::vector<VolumeError> measure_volume_error(const TetMesh& mesh, const LabelVolume& labels);

}  // namespace cvmesh
