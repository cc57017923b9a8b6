// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/mesh_at_scale.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/median.h"
#include "cvmesh/core/random.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/pipeline/check_mesh.h"
#include "cvmesh/pipeline/decimate_and_conform.h"
#include "cvmesh/pipeline/find_epsilon.h"
#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/pipeline/surface_sampler.h"
#include "cvmesh/pipeline/write_stages.h"
#include "cvmesh/surface/measure_deviation.h"
#include "cvmesh/surface/remove_needles.h"
#include "cvmesh/tet/delaunay_tets.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

constexpr double kTetTolerance = 0.05;
constexpr int kTetRounds = 5;
/// Tets of a graded mesh for each surface vertex, as measured: where the search begins.
constexpr double kTetsPerVertex = 8.5;

constexpr int kDistanceRounds = 8;
/// Spacing of the points of facets whose distance is looked at.
constexpr double kProbesVox = 0.5;
/// Decimations in other orders, where TetGen cannot fill the surfaces of one: it fails where facets
/// nearly coincide, and which facets these are is chance.
constexpr int kMostSurfaces = 3;
/// Flips of surface edges under flat tets move the surface by no more than this.
constexpr double kMostSurfaceShiftVox = 0.05;
/// Vertices of the surface move no farther than this under flat tets, and no farther than what
/// decimation takes for harmless, `deviation_vox`.
constexpr double kMostVertexShiftVox = 0.5;
/// Edges of the surface that are split at poor tets: so many at most, over its vertices, and none
/// that is shorter.
constexpr double kMostSplitsPerVertex = 0.02, kLeastSplitEdgeVox = 0.5;
/// Places beyond this part of the limit are refined: the next round's particles lie elsewhere, and
/// what only just kept the limit may miss it then.
constexpr double kWatched = 0.85;
/// They get the edges that would bring them to this part of the limit, but never less than this
/// part of what they were.
constexpr double kAim = 0.6, kLeastStep = 0.35;
/// Over h: how far around such a place the edges become shorter.
constexpr double kRefinedRadius = 0.7;

/// Over the median edge: `deviation_vox` by default, where it is more than `kLeastDeviationVox`.
/// The middle of a facet with edges h is off a sphere of radius h by h / 6, all of it by half that
/// on average: where no facets can be nearer, their distance must not be all that counts.
constexpr double kDeviationOfEdges = 1.0 / 12;
constexpr double kLeastDeviationVox = 0.5;

/// The tolerance of decimation and flips: `deviation_vox`, or what stands in for it.
double tolerance_vox(const Parameters& parameters, const ParticleSet& particles, double voxel_mm) {
  if (parameters.deviation_vox) return *parameters.deviation_vox;
  std::vector<double> edges_mm;
  edges_mm.reserve(particles.particles.size());
  for (const Particle& particle : particles.particles)
    edges_mm.push_back(particle.h_mm);
  return std::max(kLeastDeviationVox, kDeviationOfEdges * median(std::move(edges_mm)) / voxel_mm);
}

/// Edge flips, and once more where vertices of needles went.
FlipEdgesResult flip_and_free(Run& run,
                              MaterialSurfaces surfaces,
                              double voxel_mm,
                              const FlipEdgesOptions& options) {
  FlipEdgesResult first = flip_edges(std::move(surfaces), voxel_mm, options, run.context);
  RemoveNeedlesResult freed =
      remove_needles(std::move(first.surfaces), voxel_mm, options.deviation_vox, run.context);
  run.report.stages.needles = freed.stats;
  if (freed.stats.removed == 0) return {std::move(freed.surfaces), first.stats};
  FlipEdgesResult second = flip_edges(std::move(freed.surfaces), voxel_mm, options, run.context);
  second.stats.flips += first.stats.flips;
  second.stats.passes += first.stats.passes;
  return second;
}

/// The surfaces after decimation and flips.
struct Sparse {
  InterfaceMesh surface;
  InterfaceMesh augmented;  ///< dense, with the particles; only where stages are kept
  Deviation deviation;      ///< only where a limit was given
};

/// The dense surfaces with the particles as vertices, and nothing but the particles at the end.
/// @param limit_mm  distances to the dense surface that are looked for; infinity for none
/// @param order     another one gives another random order of decimation
Sparse sparsen(Run& run,
               const LabelVolume& labels,
               const Dense& dense,
               const ParticleSet& particles,
               double limit_mm,
               int order = 0) {
  const double voxel_mm = labels.frame().voxel_mm();
  StageContext context = run.context;
  if (order > 0)
    context.seed = CounterRandom(context.seed, "orders").bits(static_cast<std::uint64_t>(order));
  const Parameters& parameters = run.request.parameters;
  DecimateOptions decimate_options = parameters.decimate;
  FlipEdgesOptions flip_options = parameters.flip_edges;
  decimate_options.deviation_vox = flip_options.deviation_vox =
      tolerance_vox(parameters, particles, voxel_mm);
  decimate_options.names = names_in_messages(run);
  InsertParticlesResult inserted = run.stage.run(
      stage_names::kInsertion,
      [&] {
        MaterialSurfaces surfaces(dense.mesh, labels.material_count());
        for (const FacetSample& sample : dense.samples)
          surfaces.add_sample(sample.facet, sample.position);
        return insert_particles(std::move(surfaces), dense.strata, particles, voxel_mm,
                                run.context);
      },
      [](const InsertParticlesResult& r) {
        return fmt::format("{} snapped, {} edges and {} facets split", r.stats.snapped,
                           r.stats.edge_splits, r.stats.facet_splits);
      });
  run.report.stages.insertion = inserted.stats;
  Sparse sparse;
  if (run.request.keep_stages) sparse.augmented = inserted.surfaces.to_interface_mesh();

  std::vector<bool> keep(inserted.surfaces.points().size(), false);
  for (const std::int32_t vertex : inserted.vertex_of)
    keep[static_cast<std::size_t>(vertex)] = true;
  DecimateResult decimated =
      parameters.schedule == Schedule::Sequential
          ? decimate_and_conform(run, labels, std::move(inserted.surfaces), keep, decimate_options)
          : run.stage.run(
                stage_names::kDecimation,
                [&] {
                  return decimate(std::move(inserted.surfaces), keep, voxel_mm, decimate_options,
                                  context);
                },
                [](const DecimateResult& r) {
                  return fmt::format("{} removed, {} left, {} of them could not go",
                                     r.stats.removed, r.surfaces.vertex_count(),
                                     r.stats.kept.size());
                });
  run.report.stages.decimation = decimated.stats;

  FitVerticesResult fitted = run.stage.run(
      stage_names::kVertexFit,
      [&] {
        return fit_vertices(std::move(decimated.surfaces), voxel_mm, parameters.fit_vertices,
                            context);
      },
      [&](const FitVerticesResult& r) {
        return fmt::format(
            "{} vertices moved, by {:.2f} voxel on average; dense vertices are {:.3f} voxel (root "
            "mean square) from the surface instead of {:.3f}",
            r.stats.vertices, r.stats.mean_shift_mm / voxel_mm, r.stats.rms_after_mm / voxel_mm,
            r.stats.rms_before_mm / voxel_mm);
      });
  run.report.stages.vertex_fit = fitted.stats;

  FlipEdgesResult flipped = run.stage.run(
      stage_names::kEdgeFlipping,
      [&] { return flip_and_free(run, std::move(fitted.surfaces), voxel_mm, flip_options); },
      [&](const FlipEdgesResult& r) {
        return fmt::format("{} flips in {} passes, {} vertices of needles removed", r.stats.flips,
                           r.stats.passes, run.report.stages.needles->removed);
      });
  run.report.stages.edge_flipping = flipped.stats;
  sparse.surface = flipped.surfaces.to_interface_mesh();
  if (std::isfinite(limit_mm))
    sparse.deviation = run.stage.run(
        stage_names::kMetrics,
        [&] {
          return measure_deviation(sparse.surface, dense.mesh, limit_mm, kProbesVox * voxel_mm);
        },
        [](const Deviation& d) {
          return fmt::format("at most {:.3g} mm from the dense surface, {} places to refine",
                             d.max_mm, d.above.size());
        });
  return sparse;
}

void warn_of_poor_tets(Run& run, const LabelVolume& labels, const DihedralAngles& angles) {
  if (angles.poor == 0) return;
  const auto place = std::find_if(angles.places.begin(), angles.places.end(),
                                  [](const PoorTet& tet) { return tet.wedge_deg == 0; });
  run.context.log->warn(
      "{}: {} tets have an angle below {:g} or above {:g} degrees, where thin parts are narrower "
      "than the edges of their surface{}; places are in the report; lower epsilon, or set "
      "max_edge_mm for that label",
      stage_names::kTetrahedra, angles.poor, kPoorMinDeg, kPoorMaxDeg,
      place == angles.places.end() ? std::string()
                                   : fmt::format(", the poorest in label {} ({:.2g} degrees)",
                                                 labels.label_of[place->material], place->min_deg));
}

/// How far the surface may move under flat tets.
struct SurfaceShifts {
  double by_flips_vox = 0, of_vertices_vox = 0;
};

TetMesh fill_once(Run& run,
                  const LabelVolume& labels,
                  InterfaceMesh surface,
                  const SizingField& sizing_field,
                  const SurfaceShifts& shifts) {
  if (run.request.surface_only)
    return {.points = surface.points,
            .tets = {},
            .material_of = {},
            .surface = surface,
            .mid_points = {},
            .mid_of = {}};
  TetrahedralizeOptions options = run.request.parameters.tetrahedralize;
  options.max_surface_shift_mm = shifts.by_flips_vox * labels.frame().voxel_mm();
  options.max_vertex_shift_mm = shifts.of_vertices_vox * labels.frame().voxel_mm();
  options.min_split_edge_mm = kLeastSplitEdgeVox * labels.frame().voxel_mm();
  options.max_splits_per_vertex = kMostSplitsPerVertex;
  options.names = names_in_messages(run);
  TetrahedralizeResult filled = run.stage.run(
      stage_names::kTetrahedra,
      [&] {
        return tetrahedralize(surface, labels.material_count(), sizing_field, options, run.context);
      },
      [](const TetrahedralizeResult& r) {
        return fmt::format(
            "{} tets, {} points added, dihedral angles {:.3g} to {:.4g} degrees, "
            "TetGen -{}",
            r.tets.tets.size(), r.stats.steiner_points, r.stats.improvement.after.min_deg,
            r.stats.improvement.after.max_deg, r.stats.switches);
      });
  run.report.stages.tetrahedra = filled.stats;
  return std::move(filled.tets);
}

/// The Delaunay reconstruction from the particles, instead of `sparsen` and `fill_once`.
TetMesh reconstruct(Run& run, const ParticleSet& particles, const LevelSets& level_sets) {
  DelaunayTetsResult result = run.stage.run(
      stage_names::kDelaunay, [&] { return delaunay_tets(particles, level_sets, run.context); },
      [](const DelaunayTetsResult& r) {
        return fmt::format("baseline: {} of {} Delaunay tets are in a label, {} facets",
                           r.tets.tets.size(), r.stats.delaunay_tets, r.tets.surface.facets.size());
      });
  run.report.stages.delaunay_tets = result.stats;
  if (run.request.surface_only) {
    result.tets.points = result.tets.surface.points;
    result.tets.tets.clear();
    result.tets.material_of.clear();
  }
  return std::move(result.tets);
}

/// Everything that one setting of the sizes leads to.
struct Round {
  Sampling sampling;
  Sparse sparse;
  TetMesh tets;
};

/// Fills the round's surfaces; where TetGen cannot, or tets are too flat for files, those of
/// another order of decimation.
void fill_or_reorder(
    Run& run, const LabelVolume& labels, const Dense& dense, double limit_mm, Round& round) {
  SurfaceShifts shifts;
  // A distance that was measured and kept must not grow afterwards.
  if (!std::isfinite(limit_mm))
    shifts = {
        .by_flips_vox = kMostSurfaceShiftVox,
        .of_vertices_vox = std::min(kMostVertexShiftVox,
                                    tolerance_vox(run.request.parameters, round.sampling.particles,
                                                  labels.frame().voxel_mm()))};
  for (int order = 1;; ++order)
    try {
      round.tets =
          fill_once(run, labels, round.sparse.surface, round.sampling.sizing_field, shifts);
      require_positive(round.tets, run.mm_to_out, run.space);
      if (run.report.stages.tetrahedra) run.report.stages.tetrahedra->surfaces_tried = order;
      return;
    } catch (const Error& error) {
      // The sequential schedule has no order of its own that could be another one.
      if (error.code() != ErrorCode::StageFailed || order == kMostSurfaces ||
          run.request.parameters.schedule == Schedule::Sequential)
        throw;
      run.context.log->warn("{}; trying another order of decimation", error.what());
      round.sparse = sparsen(run, labels, dense, round.sampling.particles, limit_mm, order);
    }
}

/// The mesh of the given sizes.
/// @param level_sets  read by the Delaunay reconstruction only
Round mesh_once(Run& run,
                const LabelVolume& labels,
                const Dense& dense,
                const LevelSets& level_sets,
                Sampling sampling) {
  Round round;
  round.sampling = std::move(sampling);
  if (run.request.parameters.surface == SurfaceMethod::Delaunay) {
    round.tets = reconstruct(run, round.sampling.particles, level_sets);
  } else {
    round.sparse = sparsen(run, labels, dense, round.sampling.particles, kInfinity);
    fill_or_reorder(run, labels, dense, kInfinity, round);
  }
  return round;
}

/// The mesh whose tets come nearest to `target`.
Round mesh_to_tets(Run& run,
                   const LabelVolume& labels,
                   const Dense& dense,
                   const LevelSets& level_sets,
                   const SizingOptions& options,
                   SurfaceSampler& sampler,
                   std::size_t target) {
  const double wanted = static_cast<double>(target);
  const CountSearchResult first = run.stage.run(
      stage_names::kSizingField,
      [&] { return sampler.search_expected(options, wanted / kTetsPerVertex); },
      [&](const CountSearchResult& r) {
        return fmt::format("{:.0f} vertices to begin with for {} tets", r.count, target);
      });
  Round best;
  StageResults best_stages;
  double best_error = kInfinity;
  double of_guards = 0;  // tets of the last round, by the share of its vertices that no size rules
  const auto actual = [&](double factor) {
    Round round =
        mesh_once(run, labels, dense, level_sets, sampler.sample(scaled(options, factor)));
    const double count = static_cast<double>(round.tets.tets.size());
    const auto vertices = static_cast<double>(round.sampling.particles.particles.size());
    of_guards = count * (1 - run.report.stages.sizing_field->expected_vertices / vertices);
    const double error = std::abs(count - wanted);
    if (error < best_error) {
      best_error = error;
      best = std::move(round);
      best_stages = run.report.stages;
    }
    return count;
  };
  // Coarser sizes take tets from around guards, too (a ninth of them, where it was measured).
  const auto is_out_of_reach = [&] { return of_guards > 1.5 * wanted; };
  const CountSearchResult found = find_epsilon(actual, {.target = wanted,
                                                        .start = first.epsilon,
                                                        .tolerance = kTetTolerance,
                                                        .max_rounds = kTetRounds,
                                                        .is_out_of_reach = is_out_of_reach});
  run.report.stages = std::move(best_stages);
  run.report.stages.epsilon_search = EpsilonSearch{
      "target_tets", wanted, found.count,
      sampler.epsilon_of(options, found.epsilon, best.sampling.sizing_field), found.rounds};
  if (!found.is_reached)
    run.context.log->warn(
        "target_tets ({}) was not reached within {:g} %: {:.0f} tets at epsilon {:.4g}; small "
        "parts and edge bounds need theirs, interior_growth and tet_radius_edge_ratio rule the "
        "inside",
        target, 100 * kTetTolerance, found.count, run.report.stages.epsilon_search->epsilon);
  return best;
}

/// Lowers the caps around each of the places, but not below the edges that the user allows.
void refine(const InterfaceMesh& dense,
            const SizingField& field,
            const std::vector<DeviationSpot>& above,
            double limit_mm,
            double least_edge_mm,
            std::vector<double>& cap_mm) {
  const NeighbourTree tree(dense.points);
  std::vector<std::int32_t> found;
  for (const DeviationSpot& spot : above) {
    tree.nearest(spot.position, 1, found);
    const double h = field.h_mm[found.front()];
    // The distance goes with the square of the edges.
    const double wanted = std::max(
        least_edge_mm, h * std::max(kLeastStep, std::sqrt(kAim * limit_mm / spot.distance_mm)));
    tree.within(spot.position, kRefinedRadius * h, found);
    for (const auto v : found)
      cap_mm[v] = std::min(cap_mm[v], wanted);
  }
}

/// The mesh that is nowhere farther from the dense surface than `limit_mm`. It begins with what
/// `scaled_to_distance` expects; from there on what is measured rules.
Round mesh_to_distance(Run& run,
                       const LabelVolume& labels,
                       const Dense& dense,
                       const SizingOptions& options,
                       SurfaceSampler& sampler,
                       const std::string& key,
                       double limit_mm,
                       double unit_mm) {
  const SizingOptions first =
      scaled_to_distance(options, sampler.lfs_mm(), labels.frame().voxel_mm(), limit_mm);

  // Each round lays out its particles anew, so that the last one need not be the nearest.
  Round best;
  StageResults best_stages;
  std::vector<double> cap_mm(dense.mesh.points.size(), kInfinity);
  int rounds = 0;
  for (;;) {
    Round round;
    round.sampling = sampler.sample(first, cap_mm);
    round.sparse = sparsen(run, labels, dense, round.sampling.particles, kWatched * limit_mm);
    ++rounds;
    const bool is_last = round.sparse.deviation.max_mm <= limit_mm || rounds == kDistanceRounds;
    if (!is_last)
      refine(dense.mesh, round.sampling.sizing_field, round.sparse.deviation.above, limit_mm,
             options.min_edge_mm.value_or(0), cap_mm);
    if (rounds == 1 || round.sparse.deviation.max_mm < best.sparse.deviation.max_mm) {
      best = std::move(round);
      best_stages = run.report.stages;
    }
    if (is_last) break;
  }
  run.report.stages = std::move(best_stages);
  fill_or_reorder(run, labels, dense, kWatched * limit_mm, best);
  const SizingField& field = best.sampling.sizing_field;
  const double reached = best.sparse.deviation.max_mm;
  run.report.stages.epsilon_search =
      EpsilonSearch{key, limit_mm / unit_mm, reached / unit_mm, field.median_epsilon(), rounds};
  if (reached > limit_mm)
    run.context.log->warn(
        "{} ({:g}) was not reached: {:.3g} is left after {} rounds; min_edge_mm, or parts "
        "finer than the dense surface, may forbid more; raise it or lower min_edge_mm",
        key, limit_mm / unit_mm, reached / unit_mm, rounds);
  return best;
}

void write_stages(Run& run, const Dense& dense, const Round& round) {
  write_sizing_field(run.outputs.add_stage("sizing_field.vtp"), round.sampling.sizing_field,
                     dense.mesh, run.mm_to_out, run.space);
  write_particles(run.outputs.add_stage("particles.vtp"), round.sampling.particles, run.mm_to_out,
                  run.space);
  if (!round.sparse.augmented.facets.empty())
    write_off(run.outputs.add_stage("augmented.off"), round.sparse.augmented, run.mm_to_out);
  write_off(run.outputs.add_stage("sparse.off"), round.tets.surface, run.mm_to_out);
}

}  // namespace

TetMesh mesh_at_scale(Run& run,
                      const LabelVolume& labels,
                      LevelSets level_sets,
                      const Dense& dense,
                      MedialAxis medial_axis) {
  const SizingOptions options =
      sizing_options_of(run.request.parameters, run.report.input.spacing_mm, labels);
  warn_of_idle_sizes(run, labels, dense, options);
  const Parameters& parameters = run.request.parameters;
  std::optional<SurfaceSampler> sampler(std::in_place, run, dense, level_sets,
                                        std::move(medial_axis));
  Round round;
  if (parameters.target_tets) {
    round =
        mesh_to_tets(run, labels, dense, level_sets, options, *sampler, *parameters.target_tets);
  } else if (parameters.max_distance_mm) {
    round = mesh_to_distance(run, labels, dense, options, *sampler, "max_distance_mm",
                             *parameters.max_distance_mm, 1);
  } else if (parameters.max_distance_vox) {
    const double voxel_mm = labels.frame().voxel_mm();
    round = mesh_to_distance(run, labels, dense, options, *sampler, "max_distance_vox",
                             *parameters.max_distance_vox * voxel_mm, voxel_mm);
  } else {
    Sampling sampling = parameters.target_vertices
                            ? sampler->sample_to_target(options, *parameters.target_vertices)
                            : sampler->sample(options);
    // The largest things in memory, and nothing below reads them.
    sampler.reset();
    if (parameters.surface == SurfaceMethod::Decimation) level_sets = {};
    round = mesh_once(run, labels, dense, level_sets, std::move(sampling));
  }
  // of the round that was taken
  if (const auto& tetrahedra = run.report.stages.tetrahedra)
    warn_of_poor_tets(run, labels, tetrahedra->improvement.after);
  warn_of_coarse_parts(run, labels, *run.report.stages.sizing_field);
  run.report.particle_counts =
      count_particles(round.sampling.particles, dense.mesh, dense.strata, labels);
  if (run.request.keep_stages) write_stages(run, dense, round);
  return std::move(round.tets);
}

}  // namespace cvmesh
