// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <vector>

namespace cvmesh::dense_phantoms {

/// A phantom's dense surfaces as the pipeline makes them.
struct DensePhantom {
  InterfaceMesh mesh;
  Strata strata;
  std::size_t material_count = 0;
  double voxel_mm = 1;
};

DensePhantom make(const InputVolume& volume);

/// Every corner, and of the other vertices a share chosen by `seed` (its square root on curves).
std::vector<bool> random_choice(const Strata& strata, double share, std::uint64_t seed);

/// Fails the running test where `mesh` breaks an invariant: closed manifolds with the topology of
/// the dense surfaces, no two facets intersecting.
void require_same_topology(const InterfaceMesh& mesh, const DensePhantom& dense);

}  // namespace cvmesh::dense_phantoms
