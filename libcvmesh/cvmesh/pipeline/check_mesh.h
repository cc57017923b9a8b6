// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/mesh_names.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/report/report.h"

#include <cstddef>
#include <string>
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
                  const TetMesh* tets,
                  const MeshNames& names);

/// The same checks, told and not demanded: for the mesh of a baseline. Of pairs of facets that
/// intersect at most `kMostIntersections` are counted.
Checks inspect_mesh(const LabelVolume& labels,
                    const std::vector<MaterialTopology>& topology,
                    const InterfaceMesh& surface,
                    const TetMesh* tets);

/// Tets may be so flat that the rounding of a file's coordinates turns them over.
/// @param to_file  from grid mm to the coordinates of the file, of the given space
/// @throws Error StageFailed where one does
void require_positive(const TetMesh& tets, const Affine& to_file, Space space);

inline constexpr std::size_t kMostIntersections = 1000;

/// How the boundary of a material in the mesh differs from its voxels, in words; empty where it
/// does not.
std::string topology_fault(const MaterialTopology& topology);

}  // namespace cvmesh
