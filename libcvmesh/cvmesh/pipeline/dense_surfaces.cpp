// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/dense_surfaces.h"

#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/surface/embedding_guard.h"

#include <utility>

namespace cvmesh {

Dense make_dense_surfaces(const LevelSets& level_sets, const StageContext& context) {
  const GridFrame& frame = level_sets.frame();
  CompactInterfaces compact = compact_interfaces(extract_interfaces(level_sets, context), frame,
                                                 kClearanceVox * frame.voxel_mm(), context);
  Strata strata = find_strata(compact.mesh);
  return {std::move(compact.mesh), std::move(strata), std::move(compact.samples), compact.stats};
}

}  // namespace cvmesh
