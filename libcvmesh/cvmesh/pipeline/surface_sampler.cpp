// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/surface_sampler.h"

#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/pipeline/population_law.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/sizing/size_by_deviation.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {
namespace {

constexpr int kEstimateRounds = 12;  ///< of the search on estimates of the expected vertices
constexpr int kExpectedRounds = 4;   ///< of the search on sizing fields, where the estimates end
constexpr int kActualRounds = 6;     ///< of the search on real particles
constexpr double kTargetTolerance = 0.02;

}  // namespace

SurfaceSampler::SurfaceSampler(Run& run,
                               const Dense& dense,
                               const LevelSets& level_sets,
                               MedialAxis medial_axis)
    : run_(run), dense_(dense), level_sets_(level_sets), medial_axis_(std::move(medial_axis)) {}

SizingResult SurfaceSampler::size(const SizingOptions& options, std::span<const double> cap_mm) {
  if (cap_mm.empty() && searched_ && searched_->first == options) {
    SizingResult result = std::move(searched_->second);
    searched_.reset();
    return result;
  }
  return problem().field(options, run_.context, cap_mm);
}

Sampling SurfaceSampler::sample(const SizingOptions& options, std::span<const double> cap_mm) {
  SizingResult sized = run_.stage.run(
      stage_names::kSizingField, [&] { return size(options, cap_mm); },
      [&](const SizingResult& r) {
        return fmt::format("epsilon {:.4g}, edges {:.3g} to {:.3g} mm, {:.0f} vertices expected",
                           options.epsilon, r.stats.h_min_mm, r.stats.h_max_mm,
                           r.stats.expected_vertices);
      });
  std::optional<Sheets> sheets;
  const Parameters& parameters = run_.request.parameters;
  SeedParticlesResult seeded = run_.stage.run(
      stage_names::kSeedParticles,
      [&] {
        sheets.emplace(ParticleDomain{dense_.mesh, dense_.strata, level_sets_, sized.sizing_field});
        return seed_particles(*sheets, parameters.seed_particles, run_.context);
      },
      [](const SeedParticlesResult& r) {
        return fmt::format("{} corners, {} on curves, {} on interfaces", r.stats.corners,
                           r.stats.curve_particles, r.stats.interface_particles);
      });
  DistributeParticlesResult distributed = run_.stage.run(
      stage_names::kParticles,
      [&] {
        return distribute_particles(std::move(seeded.particles), *sheets,
                                    parameters.distribute_particles, run_.context);
      },
      [](const DistributeParticlesResult& r) {
        return fmt::format("{} particles, {} sweeps", r.particles.particles.size(), r.stats.sweeps);
      });
  StageResults& stages = run_.report.stages;
  stages.sizing_field = sized.stats;
  stages.seed_particles = seeded.stats;
  stages.particles = distributed.stats;
  return {std::move(sized.sizing_field), std::move(distributed.particles)};
}

Sampling SurfaceSampler::sample_to_target(const SizingOptions& options, std::size_t target) {
  const double wanted = static_cast<double>(target);
  Sampling best;
  StageResults best_stages;
  EpsilonSearch search{.target = "target_vertices", .wanted = wanted};
  double best_error = std::numeric_limits<double>::infinity();
  PopulationLaw law(wanted, kTargetTolerance);
  while (true) {
    const CountSearchResult sizes = run_.stage.run(
        stage_names::kSizingField, [&] { return search_expected(options, law.to_expect()); },
        [&](const CountSearchResult& r) {
          return fmt::format("{:.0f} vertices expected of {:.0f}, sizes times {:.4g}", r.count,
                             wanted, r.epsilon);
        });
    Sampling sampling = sample(scaled(options, sizes.epsilon));
    ++search.rounds;
    const double count = static_cast<double>(sampling.particles.particles.size());
    const double error = std::abs(count - wanted) / wanted;
    const bool helps = law.learn(run_.report.stages.sizing_field->expected_vertices, count);
    if (error < best_error) {
      best_error = error;
      search.reached = count;
      search.epsilon = epsilon_of(options, sizes.epsilon, sampling.sizing_field);
      best = std::move(sampling);
      best_stages = run_.report.stages;
    }
    if (error <= kTargetTolerance || !helps || search.rounds == kActualRounds) break;
  }
  run_.report.stages = std::move(best_stages);
  run_.report.stages.epsilon_search = search;
  if (best_error > kTargetTolerance)
    run_.context.log->warn(
        "target_vertices ({}) was not reached within {:g} %: {:.0f} surface vertices at epsilon "
        "{:.4g}; curves, corners and small parts need theirs, and edge bounds may forbid more",
        target, 100 * kTargetTolerance, search.reached, search.epsilon);
  return best;
}

// What does not depend on the options is found by the first call.
const SizingProblem& SurfaceSampler::problem() {
  if (!problem_) {
    problem_.emplace(dense_.mesh, dense_.strata,
                     local_feature_size(dense_.mesh, dense_.strata, medial_axis_,
                                        level_sets_.frame().voxel_mm(), run_.context),
                     *level_sets_.labels);
    medial_axis_ = {};
  }
  return *problem_;
}

// Small closed parts have sizes that no epsilon moves, and what grows from these by delta takes
// vertices around them. Where that alone exceeds what is wanted, the sizes forget them: the guards
// among the particles keep their topology with far fewer.
void SurfaceSampler::drop_room_beyond(const SizingOptions& options, double wanted) {
  constexpr double kCoarsest = 1e6;
  is_room_checked_ = true;
  const double least = problem().estimate_vertices(scaled(options, kCoarsest));
  if (least <= wanted) return;
  problem_->drop_room();
  run_.context.log->warn(
      "{}: {:.0f} vertices are wanted, but small closed parts and curves, and edges that grow from "
      "theirs by delta ({:g}), take {:.0f} at any epsilon; now these parts get no more than "
      "their topology needs. min_island_voxels drops small parts; a larger delta or target needs "
      "no such cut",
      stage_names::kSizingField, wanted, options.delta, least);
}

// Epsilon then multiplies the sizes that spend `wanted` vertices where they bring the facets
// nearest to the surface, but nowhere more than `kMostCoarser` times what the feature size would
// give for that number: thin parts keep their shape.
void SurfaceSampler::base_on_deviation(const SizingOptions& options, double wanted) {
  constexpr double kMostCoarser = 2;
  problem();
  const double voxel_mm = level_sets_.frame().voxel_mm();
  std::vector<double> base = size_by_deviation(dense_.mesh, dense_.strata, wanted, voxel_mm);
  const CountSearchResult by_feature_size = find_epsilon(
      [&](double factor) { return problem_->estimate_vertices(scaled(options, factor)); },
      {.target = wanted, .tolerance = kTargetTolerance, .max_rounds = kEstimateRounds});
  const double floor_mm = options.min_feature_vox * voxel_mm;
  for (std::size_t v = 0; v < base.size(); ++v)
    base[v] = std::min(base[v], kMostCoarser * by_feature_size.epsilon *
                                    std::max(problem_->lfs_mm()[v], floor_mm));
  problem_->set_base(std::move(base));
  is_based_on_deviation_ = true;
}

double SurfaceSampler::epsilon_of(const SizingOptions& options,
                                  double factor,
                                  const SizingField& field) const {
  return is_based_on_deviation_ ? field.median_epsilon() : options.epsilon * factor;
}

CountSearchResult SurfaceSampler::search_expected(const SizingOptions& options, double wanted) {
  if (!is_room_checked_) drop_room_beyond(options, wanted);
  if (run_.request.parameters.target_sizes == TargetSizes::Deviation && !is_based_on_deviation_)
    base_on_deviation(options, wanted);
  const auto estimate = [&](double factor) {
    const double count = problem().estimate_vertices(scaled(options, factor));
    report_progress(run_.context, stage_names::kSizingField, 0.5);
    return count;
  };
  const auto expected = [&](double factor) {
    StageContext context = run_.context;
    context.progress = nullptr;  // it would begin anew with every field
    const SizingOptions tried = scaled(options, factor);
    searched_.emplace(tried, problem().field(tried, context));
    return searched_->second.stats.expected_vertices;
  };
  constexpr double kTolerance = kTargetTolerance / 4;
  const CountSearchResult near = find_epsilon(
      estimate, {.target = wanted, .tolerance = kTolerance / 2, .max_rounds = kEstimateRounds});
  return find_epsilon(expected, {.target = wanted,
                                 .start = near.epsilon,
                                 .slope = near.slope,
                                 .tolerance = kTolerance,
                                 .max_rounds = kExpectedRounds});
}

}  // namespace cvmesh
