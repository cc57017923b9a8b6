// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/pipeline.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/tet_writer.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/levelset/resample_labels.h"
#include "cvmesh/pipeline/check_mesh.h"
#include "cvmesh/pipeline/find_epsilon.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/pipeline/stage_runner.h"
#include "cvmesh/pipeline/write_stages.h"
#include "cvmesh/report/report_json.h"
#include "cvmesh/tet/tetgen_backend.h"

#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <memory>
#include <new>
#include <set>
#include <system_error>

namespace cvmesh {

namespace {

constexpr int kEstimateRounds = 12;  ///< of the search on estimates of the expected vertices
constexpr int kExpectedRounds = 4;   ///< of the search on sizing fields, where the estimates end
constexpr int kActualRounds = 6;     ///< of the search on real particles
constexpr double kTargetTolerance = 0.02;

/// Everything the steps of one run share.
struct Run {
  const RunRequest& request;
  const StageContext& context;
  OutputFolder& outputs;
  Report& report;
  StageRunner& stage;

  Affine mm_to_out{};
  Space space = Space::Unknown;
};

/// The dense surfaces and what was derived from them.
struct Dense {
  InterfaceMesh mesh;
  Strata strata;
};

/// Particles and the field that spaced them.
struct Sampling {
  SizingField sizing_field;
  ParticleSet particles;
};

InputSummary summarize(const InputVolume& volume, const RunRequest& request) {
  std::set<Label> labels;
  Label last = 0;
  for (const Label label : volume.values) {
    // Neighbours are mostly equal: one look into the set per run of voxels.
    if (labels.empty() || label != last) labels.insert(label);
    last = label;
  }
  return {.file = request.input.filename().string(),
          .dims = volume.frame.dims,
          .spacing_mm = volume.frame.spacing_mm,
          .space = volume.frame.space,
          .output_space = request.space.value_or(volume.frame.space),
          .labels = {labels.begin(), labels.end()}};
}

InputVolume read(Run& run) {
  InputVolume volume = run.stage.run(
      stage_names::kRead,
      [&] {
        std::vector<std::string> warnings;
        InputVolume read_volume = read_label_volume(run.request.input, &warnings);
        for (const std::string& warning : warnings)
          run.context.log->warn("{}", warning);
        return read_volume;
      },
      [](const InputVolume& v) {
        return fmt::format("{} x {} x {} voxels of {:g} x {:g} x {:g} mm", v.frame.dims[0],
                           v.frame.dims[1], v.frame.dims[2], v.frame.spacing_mm.x,
                           v.frame.spacing_mm.y, v.frame.spacing_mm.z);
      });
  run.report.input = summarize(volume, run.request);
  return volume;
}

LabelVolume clean(Run& run, const InputVolume& volume) {
  CleanLabelsResult cleaned = run.stage.run(
      stage_names::kLabels,
      [&] { return clean_labels(volume, run.request.parameters.clean_labels, run.context); },
      [](const CleanLabelsResult& r) {
        const auto& dims = r.labels.frame().dims;
        return fmt::format("{} labels on {} x {} x {} voxels, {} islands removed, {} holes filled",
                           r.labels.material_count() - 1, dims[0], dims[1], dims[2],
                           r.stats.islands_removed, r.stats.holes_filled);
      });
  run.report.stages.labels = cleaned.stats;
  run.report.label_of = output_labels(cleaned.labels);
  run.report.name_of = cleaned.labels.name_of;
  run.space = run.report.input.output_space;
  run.mm_to_out = mm_to_space(cleaned.labels.frame(), run.space);
  return std::move(cleaned.labels);
}

/// The volume itself is given back as soon as the cleaned labels stand.
LabelVolume read_and_clean(Run& run) {
  return clean(run, read(run));
}

/// The labels on the working grid that `grid_spacing_mm` asks for; nothing where it asks for none.
std::optional<ResampleLabelsResult> resample(Run& run, const LabelVolume& native) {
  const std::optional<GridSpacing>& spacing = run.request.parameters.grid_spacing_mm;
  if (!spacing) return std::nullopt;
  const double mm = spacing->is_auto ? auto_spacing_mm(native.frame()) : spacing->mm;
  ResampleLabelsResult resampled = run.stage.run(
      stage_names::kResampling,
      [&] { return resample_labels(native, {.spacing_mm = mm}, run.context); },
      [](const ResampleLabelsResult& r) {
        return fmt::format("{} x {} x {} voxels, {} moved, {} held by the topology",
                           r.stats.dims[0], r.stats.dims[1], r.stats.dims[2], r.stats.nodes_changed,
                           r.stats.nodes_held);
      });
  run.report.stages.resampling = resampled.stats;
  run.mm_to_out = mm_to_space(resampled.labels.frame(), run.space);
  return resampled;
}

/// The id of one of the user's labels, or nothing where it is not in the volume.
std::optional<MaterialId> material_of(const LabelVolume& labels, Label label) {
  const auto found = std::find(labels.label_of.begin() + 1, labels.label_of.end(), label);
  if (found == labels.label_of.end()) return std::nullopt;
  return static_cast<MaterialId>(found - labels.label_of.begin());
}

/// Refuses boxes that reach outside the volume.
void check_boxes(const Run& run) {
  const std::array<int, 3>& dims = run.report.input.dims;
  const std::vector<BoxParameters>& boxes = run.request.parameters.boxes;
  for (std::size_t n = 0; n < boxes.size(); ++n)
    for (std::size_t axis = 0; axis < 3; ++axis)
      require(boxes[n].box.hi[axis] < dims[axis], ErrorCode::BadParameter, "parameters",
              fmt::format("boxes[{0}].box reaches {1} = {2}, outside the volume of {3} x {4} x {5} "
                          "voxels; keep {1} between 0 and {6}",
                          n, "ijk"[axis], boxes[n].box.hi[axis], dims[0], dims[1], dims[2],
                          dims[axis] - 1));
}

/// The two sides of the interface of two of the user's labels, of which 0 may be the exterior;
/// nothing where one is not in the volume.
std::optional<Sides> sides_of(const LabelVolume& labels, const std::array<Label, 2>& pair) {
  std::array<MaterialId, 2> ids{};
  for (std::size_t n = 0; n < 2; ++n) {
    const auto m = material_of(labels, pair[n]);
    if (!m && pair[n] != 0) return std::nullopt;
    ids[n] = m.value_or(kExterior);
  }
  return Sides{std::max(ids[0], ids[1]), std::min(ids[0], ids[1])};
}

/// Says which labels have parameters, but are not there to use them.
void warn_of_absent_labels(const Run& run, const LabelVolume& labels) {
  for (const auto& [label, own] : run.request.parameters.labels) {
    const bool is_used = own.r || own.epsilon || own.min_edge_mm || own.max_edge_mm;
    if (is_used && !material_of(labels, label))
      run.context.log->warn(
          "parameters: label {} has a radius or sizes, but is not among the labels to mesh", label);
  }
  for (const InterfaceParameters& own : run.request.parameters.interfaces)
    if (!sides_of(labels, own.labels))
      run.context.log->warn(
          "parameters: interfaces names labels {} and {}, which are not both among the labels to "
          "mesh",
          own.labels[0], own.labels[1]);
}

/// Says which sizes have no surface to rule.
void warn_of_idle_sizes(const Run& run,
                        const LabelVolume& labels,
                        const Dense& dense,
                        const SizingOptions& options) {
  for (const InterfaceParameters& own : run.request.parameters.interfaces) {
    const auto sides = sides_of(labels, own.labels);
    const auto is_it = [&](const PatchKey& patch) { return patch.sides == *sides; };
    if (sides && std::none_of(dense.strata.patches.begin(), dense.strata.patches.end(), is_it))
      run.context.log->warn(
          "parameters: interfaces names labels {} and {}, which do not touch each other",
          own.labels[0], own.labels[1]);
  }
  for (std::size_t n = 0; n < options.boxes.size(); ++n) {
    const auto& [box_mm, sizes] = options.boxes[n];
    if (std::none_of(dense.mesh.points.begin(), dense.mesh.points.end(),
                     [box = box_mm](const Vec3& p) { return box.contains(p); }))
      run.context.log->warn("parameters: no surface crosses boxes[{}], so {}", n,
                            sizes.max_edge_mm && !run.request.surface_only
                                ? "its max_edge_mm bounds the tets in it only"
                                : "it has no effect");
  }
}

/// The tightening options with the user's labels turned into material ids.
TightenOptions tighten_options_of(const Run& run, const LabelVolume& labels) {
  TightenOptions options = run.request.parameters.tighten;
  for (const auto& [label, own] : run.request.parameters.labels)
    if (const auto m = material_of(labels, label); m && own.r) options.r_vox_of[*m] = *own.r;
  // The smaller radius rules where materials meet, and the exterior has no say in it.
  double largest = options.r_vox;
  for (const auto& [material, r] : options.r_vox_of)
    largest = std::max(largest, r);
  options.r_vox_of[kExterior] = largest;
  return options;
}

LevelSets smooth_level_sets_of(Run& run, const LabelVolume& labels) {
  auto ids = std::make_shared<const Grid<MaterialId>>(labels.ids);
  BuildLevelSetsResult built = run.stage.run(
      stage_names::kLevelSets,
      [&] { return build_level_sets(ids, labels.material_count(), run.context); },
      [](const BuildLevelSetsResult& r) {
        return fmt::format("{} nodes in the band, {} MiB", r.stats.band_nodes,
                           r.stats.stored_bytes >> 20);
      });
  run.report.stages.level_sets = built.stats;

  TightenResult tightened = run.stage.run(
      stage_names::kTightening,
      [&] {
        return tighten(std::move(built.level_sets), tighten_options_of(run, labels), run.context);
      },
      [](const TightenResult& r) {
        return fmt::format("{} sweeps, {} nodes changed", r.stats.sweeps, r.stats.nodes_changed);
      });
  run.report.stages.tightening = tightened.stats;
  return std::move(tightened.level_sets);
}

Dense extract_dense(Run& run, const LevelSets& level_sets) {
  Dense dense = run.stage.run(
      stage_names::kDenseSurfaces,
      [&] {
        Dense result{extract_interfaces(level_sets, run.context), {}};
        result.strata = find_strata(result.mesh);
        return result;
      },
      [](const Dense& r) {
        return fmt::format("{} vertices, {} facets, {} interfaces, {} curves", r.mesh.points.size(),
                           r.mesh.facets.size(), r.strata.patches.size(), r.strata.curves.size());
      });
  run.report.stages.dense_surfaces =
      SurfaceSummary{.vertices = dense.mesh.points.size(),
                     .facets = dense.mesh.facets.size(),
                     .patches = dense.strata.patches.size(),
                     .curves = dense.strata.curves.size(),
                     .corners = static_cast<std::size_t>(std::count(
                         dense.strata.dimension.begin(), dense.strata.dimension.end(), 0))};
  if (run.request.keep_stages)
    write_off(run.outputs.add_stage("dense.off"), dense.mesh, run.mm_to_out);
  return dense;
}

MedialAxis medial_axis_of(Run& run,
                          const LabelVolume& labels,
                          const LevelSets& level_sets,
                          const Dense& dense) {
  MedialAxisResult result = run.stage.run(
      stage_names::kMedialAxis,
      [&] {
        return extract_medial_axis(level_sets, dense.mesh, dense.strata,
                                   run.request.parameters.medial_axis, run.context);
      },
      [](const MedialAxisResult& r) {
        return fmt::format("{} points from {} sites", r.medial_axis.points.size(), r.stats.sites);
      });
  run.report.stages.medial_axis = result.stats;
  if (run.request.keep_stages)
    write_medial_axis(run.outputs.add_stage("medial_axis.vtp"), result.medial_axis, labels,
                      run.mm_to_out, run.space);
  return std::move(result.medial_axis);
}

/// Says which labels have parts with fewer than three facets around, the worst first.
void warn_of_coarse_parts(const Run& run, const LabelVolume& labels, const SizingStats& stats) {
  constexpr double kMostShare = 0.01;  ///< less is noise of the local feature size
  constexpr std::size_t kMostLabels = 5;
  std::vector<std::pair<double, std::size_t>> coarse;
  for (std::size_t m = 1; m < stats.share_below_three_facets.size(); ++m)
    if (stats.share_below_three_facets[m] > kMostShare)
      coarse.emplace_back(-stats.share_below_three_facets[m], m);
  if (coarse.empty()) return;
  std::sort(coarse.begin(), coarse.end());
  std::vector<std::string> named;
  for (std::size_t n = 0; n < std::min(coarse.size(), kMostLabels); ++n)
    named.push_back(fmt::format("{:.1f} % of label {} ({})", -100 * coarse[n].first,
                                labels.label_of[coarse[n].second],
                                labels.name_of[coarse[n].second]));
  if (coarse.size() > kMostLabels)
    named.push_back(fmt::format("parts of {} more", coarse.size() - kMostLabels));
  run.context.log->warn(
      "sizing field: too coarse for three facets around thin parts, by area: {}; lower epsilon or "
      "set max_edge_mm for them, as in labels.{}.epsilon",
      fmt::join(named, ", "), labels.label_of[coarse.front().second]);
}

/// The extent of a box of input voxels in the grid mm of the working grid, which begins with the
/// same voxel face as the crop, whatever its spacing.
Box3 box_mm(const VoxelBox& box, const Vec3& input_spacing_mm, const LabelVolume& labels) {
  Box3 result;
  for (int axis = 0; axis < 3; ++axis) {
    const auto n = static_cast<std::size_t>(axis);
    const double first_face = -0.5 * labels.frame().spacing_mm[axis];
    const double spacing = input_spacing_mm[axis];
    result.lo[axis] = first_face + spacing * (box.lo[n] - labels.first_voxel[n]);
    result.hi[axis] = first_face + spacing * (box.hi[n] + 1 - labels.first_voxel[n]);
  }
  return result;
}

/// The sizing options with the user's labels turned into material ids, and boxes into grid mm.
SizingOptions sizing_options_of(const Run& run, const LabelVolume& labels) {
  SizingOptions options = run.request.parameters.sizing;
  for (const auto& [label, own] : run.request.parameters.labels)
    if (const auto m = material_of(labels, label))
      options.per_material[*m] = {own.epsilon, own.min_edge_mm, own.max_edge_mm};
  for (const InterfaceParameters& own : run.request.parameters.interfaces)
    if (const auto sides = sides_of(labels, own.labels))
      options.per_interface[*sides] = {own.epsilon, own.min_edge_mm, own.max_edge_mm};
  for (const BoxParameters& own : run.request.parameters.boxes)
    options.boxes.push_back({box_mm(own.box, run.report.input.spacing_mm, labels),
                             {own.epsilon, own.min_edge_mm, own.max_edge_mm}});
  return options;
}

/// The options with every epsilon multiplied, so that all places keep their ratios.
SizingOptions scaled(SizingOptions options, double factor) {
  const auto scale = [&](OwnSizes& own) {
    if (own.epsilon) own.epsilon = *own.epsilon * factor;
  };
  options.epsilon *= factor;
  for (auto& [material, own] : options.per_material)
    scale(own);
  for (auto& [sides, own] : options.per_interface)
    scale(own);
  for (BoxSizes& box : options.boxes)
    scale(box.sizes);
  return options;
}

/// The particle stages for one setting of the sizes, and the field they follow.
class Sampler {
 public:
  Sampler(Run& run, const Dense& dense, const LevelSets& level_sets, MedialAxis medial_axis)
      : run_(run), dense_(dense), level_sets_(level_sets), medial_axis_(std::move(medial_axis)) {}

  SizingResult size(const SizingOptions& options) {
    if (searched_ && searched_->first == options) {
      SizingResult result = std::move(searched_->second);
      searched_.reset();
      return result;
    }
    return problem().field(options, run_.context);
  }

  Sampling sample(const SizingOptions& options) {
    SizingResult sized = run_.stage.run(
        stage_names::kSizingField, [&] { return size(options); },
        [&](const SizingResult& r) {
          return fmt::format("epsilon {:.4g}, edges {:.3g} to {:.3g} mm, {:.0f} vertices expected",
                             options.epsilon, r.stats.h_min_mm, r.stats.h_max_mm,
                             r.stats.expected_vertices);
        });
    const Sheets sheets({dense_.mesh, dense_.strata, level_sets_, sized.sizing_field});
    const Parameters& parameters = run_.request.parameters;
    SeedParticlesResult seeded = run_.stage.run(
        stage_names::kSeedParticles,
        [&] { return seed_particles(sheets, parameters.seed_particles, run_.context); },
        [](const SeedParticlesResult& r) {
          return fmt::format("{} corners, {} on curves, {} on interfaces", r.stats.corners,
                             r.stats.curve_particles, r.stats.interface_particles);
        });
    DistributeParticlesResult distributed = run_.stage.run(
        stage_names::kParticles,
        [&] {
          return distribute_particles(std::move(seeded.particles), sheets,
                                      parameters.distribute_particles, run_.context);
        },
        [](const DistributeParticlesResult& r) {
          return fmt::format("{} particles, {} sweeps", r.particles.particles.size(),
                             r.stats.sweeps);
        });
    StageResults& stages = run_.report.stages;
    stages.sizing_field = sized.stats;
    stages.seed_particles = seeded.stats;
    stages.particles = distributed.stats;
    return {std::move(sized.sizing_field), std::move(distributed.particles)};
  }

  /// The sampling whose particles come nearest to `target`. First a search that computes sizing
  /// fields only, then a few rounds with real particles.
  Sampling sample_to_target(const SizingOptions& options, std::size_t target) {
    const double wanted = static_cast<double>(target);
    const CountSearchResult first = run_.stage.run(
        stage_names::kSizingField, [&] { return search_expected(options, wanted); },
        [&](const CountSearchResult& r) {
          return fmt::format("epsilon {:.4g} is expected to give {:.0f} of {} vertices", r.epsilon,
                             r.count, target);
        });

    Sampling best;
    StageResults best_stages;
    double best_error = -1;
    const auto actual = [&](double factor) {
      Sampling sampling = sample(scaled(options, factor));
      const double count = static_cast<double>(sampling.particles.particles.size());
      const double error = std::abs(count - wanted);
      if (best_error < 0 || error < best_error) {
        best_error = error;
        best = std::move(sampling);
        best_stages = run_.report.stages;
      }
      return count;
    };
    const CountSearchResult found = find_epsilon(actual, {.target = wanted,
                                                          .start = first.epsilon,
                                                          .tolerance = kTargetTolerance,
                                                          .max_rounds = kActualRounds});
    run_.report.stages = std::move(best_stages);
    run_.report.stages.epsilon_search = EpsilonSearch{
        target, best.particles.particles.size(), options.epsilon * found.epsilon, found.rounds};
    if (!found.is_reached)
      run_.context.log->warn(
          "target_vertices ({}) was not reached within {:g} %: {:.0f} surface vertices at epsilon "
          "{:.4g}; curves, corners and small parts need theirs, and edge bounds may forbid more",
          target, 100 * kTargetTolerance, found.count, options.epsilon * found.epsilon);
    return best;
  }

 private:
  /// What does not depend on the options is found by the first call.
  const SizingProblem& problem() {
    if (!problem_) {
      problem_.emplace(dense_.mesh, dense_.strata,
                       local_feature_size(dense_.mesh, dense_.strata, medial_axis_,
                                          level_sets_.frame().voxel_mm(), run_.context),
                       *level_sets_.labels);
      medial_axis_ = {};
    }
    return *problem_;
  }

  /// The factor for every epsilon at which the sizing field is expected to give the wanted
  /// vertices: a search on estimates, then on the fields themselves, of which the last is kept.
  CountSearchResult search_expected(const SizingOptions& options, double wanted) {
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

  Run& run_;
  const Dense& dense_;
  const LevelSets& level_sets_;
  MedialAxis medial_axis_;
  std::optional<SizingProblem> problem_;
  std::optional<std::pair<SizingOptions, SizingResult>> searched_;  ///< the search's last field
};

Sampling sample_surfaces(Run& run,
                         const LabelVolume& labels,
                         const LevelSets& level_sets,
                         const Dense& dense,
                         MedialAxis medial_axis) {
  const SizingOptions options = sizing_options_of(run, labels);
  warn_of_idle_sizes(run, labels, dense, options);
  Sampler sampler(run, dense, level_sets, std::move(medial_axis));
  const std::optional<std::size_t> target = run.request.parameters.target_vertices;
  Sampling sampling = target ? sampler.sample_to_target(options, *target) : sampler.sample(options);

  warn_of_coarse_parts(run, labels, *run.report.stages.sizing_field);
  run.report.particle_counts =
      count_particles(sampling.particles, dense.mesh, dense.strata, labels.material_count());
  if (run.request.keep_stages) {
    write_sizing_field(run.outputs.add_stage("sizing_field.vtp"), sampling.sizing_field, dense.mesh,
                       run.mm_to_out, run.space);
    write_particles(run.outputs.add_stage("particles.vtp"), sampling.particles, run.mm_to_out,
                    run.space);
  }
  return sampling;
}

/// The dense surfaces with the particles as vertices, and nothing but the particles at the end.
InterfaceMesh sparsen(Run& run,
                      const LabelVolume& labels,
                      const Dense& dense,
                      const ParticleSet& particles) {
  const double voxel_mm = labels.frame().voxel_mm();
  const Parameters& parameters = run.request.parameters;
  InsertParticlesResult inserted = run.stage.run(
      stage_names::kInsertion,
      [&] {
        return insert_particles(MaterialSurfaces(dense.mesh, labels.material_count()), dense.strata,
                                particles, voxel_mm, run.context);
      },
      [](const InsertParticlesResult& r) {
        return fmt::format("{} snapped, {} edges and {} facets split", r.stats.snapped,
                           r.stats.edge_splits, r.stats.facet_splits);
      });
  run.report.stages.insertion = inserted.stats;
  if (run.request.keep_stages)
    write_off(run.outputs.add_stage("augmented.off"), inserted.surfaces.to_interface_mesh(),
              run.mm_to_out);

  std::vector<bool> keep(inserted.surfaces.points().size(), false);
  for (const std::int32_t vertex : inserted.vertex_of)
    keep[static_cast<std::size_t>(vertex)] = true;
  DecimateResult decimated = run.stage.run(
      stage_names::kDecimation,
      [&] {
        return decimate(std::move(inserted.surfaces), keep, voxel_mm, parameters.decimate,
                        run.context);
      },
      [](const DecimateResult& r) {
        return fmt::format("{} removed, {} left, {} of them could not go", r.stats.removed,
                           r.surfaces.vertex_count(), r.stats.kept.size());
      });
  run.report.stages.decimation = decimated.stats;

  FlipEdgesResult flipped = run.stage.run(
      stage_names::kEdgeFlipping,
      [&] {
        return flip_edges(std::move(decimated.surfaces), voxel_mm, parameters.flip_edges,
                          run.context);
      },
      [](const FlipEdgesResult& r) {
        return fmt::format("{} flips in {} passes", r.stats.flips, r.stats.passes);
      });
  run.report.stages.edge_flipping = flipped.stats;
  InterfaceMesh sparse = flipped.surfaces.to_interface_mesh();
  if (run.request.keep_stages)
    write_off(run.outputs.add_stage("sparse.off"), sparse, run.mm_to_out);
  return sparse;
}

TetMesh fill(Run& run,
             const LabelVolume& labels,
             InterfaceMesh surface,
             const SizingField& sizing_field) {
  if (run.request.surface_only)
    return {.points = surface.points, .tets = {}, .material_of = {}, .surface = surface};
  TetrahedralizeResult filled = run.stage.run(
      stage_names::kTetrahedra,
      [&] {
        return tetrahedralize(surface, labels.material_count(), sizing_field,
                              run.request.parameters.tetrahedralize, run.context);
      },
      [](const TetrahedralizeResult& r) {
        return fmt::format("{} tets, {} points added, TetGen -{}", r.tets.tets.size(),
                           r.stats.steiner_points, r.stats.switches);
      });
  run.report.stages.tetrahedra = filled.stats;
  return std::move(filled.tets);
}

void shift(std::vector<Vec3>& points, const Vec3& offset) {
  for (Vec3& p : points)
    p += offset;
}

/// From the grid mm of the working grid to those of the native one, where what is measured and
/// written belongs.
void move_to_native_grid(
    Run& run, const LabelVolume& native, const Vec3& offset, InterfaceMesh& dense, TetMesh& tets) {
  shift(dense.points, offset);
  shift(tets.points, offset);
  shift(tets.surface.points, offset);
  for (GuardedPlace& place : run.report.stages.tightening->guarded)
    place.position += offset;
  for (KeptVertex& vertex : run.report.stages.decimation->kept)
    vertex.position += offset;
  run.mm_to_out = mm_to_space(native.frame(), run.space);
}

void measure(Run& run, const LabelVolume& labels, const InterfaceMesh& dense, const TetMesh& tets) {
  const std::size_t material_count = labels.material_count();
  Report& report = run.report;
  run.stage.run(
      stage_names::kMetrics,
      [&] {
        report.topology = measure_topology(labels, dense, tets.surface);
        report.mesh = count_mesh(tets, material_count);
        report_progress(run.context, stage_names::kMetrics, 0.1);
        report.checks = check_mesh(labels, report.topology, tets.surface,
                                   run.request.surface_only ? nullptr : &tets);
        report_progress(run.context, stage_names::kMetrics, 0.3);
        report.quality = run.request.surface_only ? measure_quality(tets.surface, material_count)
                                                  : measure_quality(tets, material_count);
        if (!run.request.surface_only) report.volumes = measure_volume_error(tets, labels);
        report_progress(run.context, stage_names::kMetrics, 0.5);
        report.distances = measure_surface_fidelity(tets.surface, dense, labels, {}, run.context);
        return 0;
      },
      [&](int) {
        return fmt::format("mean distance to the dense surface {:.3g} voxels, to the labels {:.3g}",
                           report.distances->to_dense.overall.voxels.mean_symmetric(),
                           report.distances->to_labels.overall.voxels.mean_symmetric());
      });
}

void write(Run& run, const LabelVolume& labels, const TetMesh& tets) {
  run.stage.run(
      stage_names::kWrite,
      [&] {
        if (!run.request.surface_only) {
          write_vtu(run.outputs.add(".vtu"), tets, labels, run.mm_to_out, run.space);
          report_progress(run.context, stage_names::kWrite, 0.5);
          write_medit(run.outputs.add(".mesh"), tets, labels, run.mm_to_out, run.space);
        }
        write_surface_vtp(run.outputs.add(".surface.vtp"), tets.surface, labels, run.mm_to_out,
                          run.space);
        return run.outputs.files().size();
      },
      [](std::size_t files) { return fmt::format("{} files", files); });
}

void run_stages(Run& run) {
  const LabelVolume native = read_and_clean(run);
  check_boxes(run);
  warn_of_absent_labels(run, native);
  std::optional<ResampleLabelsResult> resampled = resample(run, native);
  const LabelVolume& labels = resampled ? resampled->labels : native;
  LevelSets level_sets = smooth_level_sets_of(run, labels);
  Dense dense = extract_dense(run, level_sets);
  MedialAxis medial_axis = medial_axis_of(run, labels, level_sets, dense);
  const Sampling sampling = sample_surfaces(run, labels, level_sets, dense, std::move(medial_axis));
  level_sets = {};  // the largest thing in memory, and nothing below reads it
  InterfaceMesh sparse = sparsen(run, labels, dense, sampling.particles);
  TetMesh tets = fill(run, labels, std::move(sparse), sampling.sizing_field);
  if (resampled) move_to_native_grid(run, native, resampled->offset_mm, dense.mesh, tets);
  resampled.reset();
  measure(run, native, dense.mesh, tets);
  write(run, native, tets);
}

/// Any exception as an `Error` that names the stage.
Error as_error(const std::exception_ptr& pointer, const std::string& stage) {
  try {
    std::rethrow_exception(pointer);
  } catch (const Error& error) {
    return error;
  } catch (const std::bad_alloc&) {
    return {ErrorCode::Limit, stage,
            "out of memory; ask for more, crop the volume, or raise epsilon"};
  } catch (const std::exception& error) {
    return {ErrorCode::Internal, stage, error.what()};
  }
}

/// Why the run failed goes into a file, too; if even that cannot be written, the error itself
/// still says it.
void write_failure(const OutputFolder& outputs,
                   const Report& report,
                   const Error& error,
                   const StageContext& context) {
  try {
    write_json(outputs.failure_file(), failure_json(report, error));
  } catch (const std::exception& second) {
    context.log->warn("{}", second.what());
  }
}

}  // namespace

RunResult run_pipeline(const RunRequest& request, const StageContext& given) {
  const Timer timer;
  StageContext context = given;
  context.seed = request.parameters.seed;
  std::error_code ignored;
  require(std::filesystem::exists(request.input, ignored), ErrorCode::BadInput, stage_names::kRead,
          "'" + request.input.string() + "' does not exist; check the path");
  if (!request.surface_only) find_tetgen_helper();  // a missing helper ends the run here, not late

  OutputFolder outputs(request.out_dir, input_stem(request.input));
  Report report;
  report.version = kVersion;
  report.parameters = request.parameters;
  report.input.file = request.input.filename().string();
  report.threads = static_cast<int>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  StageRunner stage(context, report);
  Run run{request, context, outputs, report, stage};
  try {
    run_stages(run);
    report.total_seconds = timer.seconds();
    write_json(outputs.add(".metrics.json"), report_json(report));
    return {std::move(report), outputs.files()};
  } catch (...) {
    const Error error = as_error(std::current_exception(), stage.current());
    outputs.discard();
    report.total_seconds = timer.seconds();
    write_failure(outputs, report, error, context);
    throw error;
  }
}

}  // namespace cvmesh
