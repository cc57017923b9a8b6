// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/decimate.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/surface/vertex_remover.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <utility>

namespace cvmesh {
namespace {

// Limits of each pass, strict ones first: an early removal must not spoil the shape of what is
// left, a late one only has to be valid.
constexpr std::array<RingLimits, 4> kPasses{{
    {0.10, 0.26, -0.50},    // normals within 75 degrees of the mean, dihedral angles over 60
    {0.05, 0.00, -0.80},    // 90 and 37 degrees
    {0.01, -0.50, -0.94},   // 120 and 20 degrees
    {1e-3, -1.01, -0.985},  // any direction; dihedral angles over 10 degrees
}};

// The vertices to remove, in a random order that stays in the cache: three quarters of all, chosen
// at random, block by block of neighbouring vertices and at random inside a block; then three
// quarters of what is left, by blocks of four times as many old vertices, and so on. Density never
// differs by more than a factor of four at once, so that no front between dense and sparse parts
// advances, which the random queue is for (paper, section 7.4). Ids follow a curve through space
// (`sort_along_curve`), so a run of them is a block.
std::vector<std::int32_t> random_queue(const MaterialSurfaces& surfaces,
                                       const std::vector<bool>& keep,
                                       std::uint64_t seed) {
  constexpr int kBlockBits = 11;
  constexpr int kMostPhases = 8;

  struct Turn {
    int phase;
    std::size_t block;
    double when;
    std::int32_t vertex;

    auto operator<=>(const Turn&) const = default;
  };

  const CounterRandom random(seed, "decimation");
  std::vector<Turn> turns;
  for (std::size_t n = 0; n < keep.size(); ++n) {
    const auto v = static_cast<std::int32_t>(n);
    if (keep[n] || !surfaces.is_alive(v)) continue;
    const double when = random.uniform(n);
    const int phase = std::min(static_cast<int>(-std::log(1 - when) / std::log(4.0)), kMostPhases);
    turns.push_back({phase, n >> (kBlockBits + 2 * phase), when, v});
  }
  parallel_sort(turns.begin(), turns.end());
  std::vector<std::int32_t> queue;
  queue.reserve(turns.size());
  for (const Turn& turn : turns)
    queue.push_back(turn.vertex);
  return queue;
}

}  // namespace

DecimateResult decimate(MaterialSurfaces surfaces,
                        const std::vector<bool>& keep,
                        double voxel_mm,
                        const DecimateOptions& options,
                        const StageContext& context) {
  DecimateResult result;
  result.stats.deviation_vox = options.deviation_vox;
  std::vector<std::int32_t> queue = random_queue(surfaces, keep, context.seed);
  const std::size_t total = queue.size();
  std::array<std::size_t, kRefusalNames.size()> refusals{};
  std::vector<Refusal> reason(keep.size(), Refusal::None);

  // Tries all that is in the queue; what was refused is in the queue afterwards.
  const auto run_pass = [&](VertexRemover& remover, const RingLimits& limits) {
    std::vector<std::int32_t> deferred;
    std::size_t tried = 0;
    remover.try_each(queue, limits, [&](std::int32_t vertex, Refusal refusal) {
      reason[vertex] = refusal;
      if (refusal == Refusal::None) {
        ++result.stats.removed;
      } else {
        ++refusals[static_cast<std::size_t>(refusal)];
        deferred.push_back(vertex);
      }
      if (tried++ % 4096 == 0)
        report_progress(context, "decimation",
                        static_cast<double>(result.stats.removed) /
                            static_cast<double>(std::max<std::size_t>(total, 1)));
    });
    ++result.stats.passes;
    result.stats.deferrals += deferred.size();
    context.log->debug("decimation: quality of {} and more, {} of {} left, {} plans so far",
                       limits.min_quality, deferred.size(), queue.size(), remover.planned());
    const std::size_t gone = queue.size() - deferred.size();
    queue = std::move(deferred);
    return gone;
  };

  {
    VertexRemover remover(surfaces, voxel_mm, options.deviation_vox * voxel_mm);
    for (const RingLimits& limits : kPasses) {
      // the same limits again while they still help one in fifty
      for (std::size_t before = queue.size();
           before > 0 && run_pass(remover, limits) > before / 50 + 1; before = queue.size()) {
      }
    }
  }
  for (std::size_t r = 1; r < refusals.size(); ++r)
    if (refusals[r] > 0) result.stats.refusals[kRefusalNames[r]] = refusals[r];
  std::sort(queue.begin(), queue.end());
  for (const auto v : queue)
    result.stats.kept.push_back(
        {v, surfaces.points()[v], kRefusalNames[static_cast<std::size_t>(reason[v])]});
  if (options.on_degenerate == OnDegenerate::Fail && !queue.empty())
    throw Error(ErrorCode::StageFailed, "decimation",
                "degenerate vertex distribution: " + std::to_string(queue.size()) +
                    " vertices cannot be removed, the first at " +
                    options.names.place(surfaces.points()[queue.front()]) +
                    "; lower epsilon or raise r, or set on_degenerate to \"keep\"");
  surfaces.drop_removed();
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
