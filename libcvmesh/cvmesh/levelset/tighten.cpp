// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/tighten.h"

#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/smooth_level_sets.h"

#include <algorithm>
#include <utility>

namespace cvmesh {
namespace {

// Part of the stage's progress that the flow reports where there is one.
constexpr double kFlowShare = 0.75;

}  // namespace

TightenResult tighten(LevelSets level_sets,
                      const TightenOptions& options,
                      const StageContext& context) {
  TightenResult result;
  result.level_sets = std::move(level_sets);
  const std::size_t materials = result.level_sets.material_count();
  SmoothLevelSetsOptions smoothing{.r_vox = std::vector<double>(materials, options.r_vox),
                                   .sweeps = options.smoothing_sweeps,
                                   .margin_vox = options.margin};
  for (const auto& [material, r] : options.r_vox_of)
    smoothing.r_vox.at(material) = r;
  const double largest = *std::max_element(smoothing.r_vox.begin(), smoothing.r_vox.end());

  if (largest >= 1) {
    GuardedFlowResult flow = guarded_flow(*result.level_sets.labels, smoothing.r_vox,
                                          options.max_iterations, context, kFlowShare);
    result.stats.iterations = flow.iterations;
    result.stats.nodes_changed = flow.nodes_changed;
    result.stats.nodes_guarded = flow.nodes_guarded;
    result.stats.guarded = std::move(flow.guarded);
    if (flow.nodes_changed > 0) {
      StageContext quiet = context;  // this stage's progress is not that of the one before
      quiet.progress = nullptr;
      quiet.cancel = nullptr;
      result.level_sets = {};
      result.level_sets =
          build_level_sets(std::make_shared<Grid<MaterialId>>(std::move(flow.labels)), materials,
                           quiet)
              .level_sets;
    }
  }
  if (largest > 0) {
    result.level_sets = smooth_level_sets(std::move(result.level_sets), smoothing, context,
                                          largest >= 1 ? kFlowShare : 0);
    result.stats.sweeps = options.smoothing_sweeps;
  }
  return result;
}

}  // namespace cvmesh
