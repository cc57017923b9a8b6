// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/report/report.h"

#include <optional>
#include <vector>

namespace cvmesh {

/// Topology of every material: of its voxels, its dense boundary and its final boundary.
std::vector<MaterialTopology> measure_topology(const LabelVolume& labels,
                                               const InterfaceMesh& dense,
                                               const InterfaceMesh& surface);

/// All checks on the finished mesh, passed.
/// @param tets  null when only the surfaces were asked for
/// @throws Error StageFailed naming the label, when a label or component is missing or has another
///         topology than its voxels; naming the fault, when surface or tets are not valid
Checks check_mesh(const LabelVolume& labels,
                  const std::vector<MaterialTopology>& topology,
                  const InterfaceMesh& surface,
                  const TetMesh* tets);

}  // namespace cvmesh
