// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/interfaces/compact_interfaces.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <vector>

namespace cvmesh {

/// The dense surfaces and what was derived from them.
struct Dense {
  InterfaceMesh mesh;
  Strata strata;
  std::vector<FacetSample> samples;  ///< of the surfaces before vertices were merged
  CompactionStats compaction;
};

/// The interfaces of all materials, compact.
Dense make_dense_surfaces(const LevelSets& level_sets, const StageContext& context);

}  // namespace cvmesh
