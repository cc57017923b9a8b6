// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/mesh/mesh_names.h"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace cvmesh {

/// What to do with a vertex that cannot be removed.
enum class OnDegenerate {
  Keep,  ///< it stays, is counted and located
  Fail,  ///< the run stops, as the paper's does
};

struct DecimateOptions {
  double deviation_vox = 0.5;  ///< distance to the dense surface below which shape rules
  OnDegenerate on_degenerate = OnDegenerate::Keep;
  MeshNames names{};  ///< for messages
};

/// A vertex that had to stay.
struct KeptVertex {
  std::int32_t vertex = -1;
  Vec3 position;       ///< grid mm
  std::string reason;  ///< "intersection", "fold", "topology", "jump"
};

struct DecimateStats {
  std::size_t removed = 0, deferrals = 0;
  int passes = 0;
  double deviation_vox = 0;  ///< the tolerance in use
  std::vector<KeptVertex> kept;
  std::map<std::string, std::size_t> refusals;  ///< reason -> count, over all attempts
};

struct DecimateResult {
  MaterialSurfaces surfaces;
  DecimateStats stats;
};

/// The sparse surfaces: every vertex that is not in `keep` removed, in random order with deferral
/// (paper, §7.4); each hole is closed at once by the triangulation with the least objective.
/// @param keep  one entry per vertex of `surfaces`: true for particles
/// @throws Error StageFailed ("degenerate vertex distribution") for `OnDegenerate::Fail`
DecimateResult decimate(MaterialSurfaces surfaces,
                        const std::vector<bool>& keep,
                        double voxel_mm,
                        const DecimateOptions& options,
                        const StageContext& context);

}  // namespace cvmesh
