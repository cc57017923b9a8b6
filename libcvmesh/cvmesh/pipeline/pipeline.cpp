// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/pipeline.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/levelset/resample_labels.h"
#include "cvmesh/metrics/facet_distances.h"
#include "cvmesh/pipeline/check_mesh.h"
#include "cvmesh/pipeline/dense_surfaces.h"
#include "cvmesh/pipeline/finish_mesh.h"
#include "cvmesh/pipeline/forecast.h"
#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/pipeline/library_versions.h"
#include "cvmesh/pipeline/mesh_at_scale.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/pipeline/run_key.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/pipeline/stage_runner.h"
#include "cvmesh/pipeline/summarize_input.h"
#include "cvmesh/pipeline/warning_log.h"
#include "cvmesh/pipeline/write_results.h"
#include "cvmesh/pipeline/write_stages.h"
#include "cvmesh/report/check_gates.h"
#include "cvmesh/report/html_report.h"
#include "cvmesh/report/report_json.h"
#include "cvmesh/tet/second_order.h"
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

InputVolume read(Run& run) {
  InputVolume volume = run.stage.run(
      stage_names::kRead,
      [&] {
        std::vector<std::string> warnings;
        InputVolume read_volume = read_label_volume(run.request.input, &warnings, run.request.read);
        for (const std::string& warning : warnings)
          run.context.log->warn("{}", warning);
        return read_volume;
      },
      [](const InputVolume& v) {
        return fmt::format("{} x {} x {} voxels of {:g} x {:g} x {:g} mm", v.frame.dims[0],
                           v.frame.dims[1], v.frame.dims[2], v.frame.spacing_mm.x,
                           v.frame.spacing_mm.y, v.frame.spacing_mm.z);
      });
  run.report.input = summarize_input(volume, run.request.input);
  run.report.input.output_space = run.request.space.value_or(volume.frame.space);
  run.report.run_key = run_key(run.request);
  return volume;
}

/// The names of the parameters, and those that the request adds.
CleanLabelsOptions clean_labels_options(const Run& run) {
  CleanLabelsOptions options = run.request.parameters.clean_labels;
  const std::vector<Label>& labels = run.report.input.labels;
  std::string absent;
  for (const auto& [label, name] : run.request.label_names) {
    options.names.try_emplace(label, name);
    if (!std::binary_search(labels.begin(), labels.end(), label))
      absent += fmt::format("{}{}", absent.empty() ? "" : ", ", label);
  }
  if (!absent.empty())
    run.context.log->info("label names: not in the volume, and not used: {}", absent);
  return options;
}

LabelVolume clean(Run& run, const InputVolume& volume) {
  const CleanLabelsOptions options = clean_labels_options(run);
  CleanLabelsResult cleaned = run.stage.run(
      stage_names::kLabels, [&] { return clean_labels(volume, options, run.context); },
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
        return tighten(std::move(built.level_sets),
                       tighten_options_of(run.request.parameters, labels), run.context);
      },
      [](const TightenResult& r) {
        return fmt::format("{} sweeps, {} nodes changed", r.stats.sweeps, r.stats.nodes_changed);
      });
  run.report.stages.tightening = tightened.stats;
  return std::move(tightened.level_sets);
}

Dense extract_dense(Run& run, const LevelSets& level_sets) {
  Dense dense = run.stage.run(
      stage_names::kDenseSurfaces, [&] { return make_dense_surfaces(level_sets, run.context); },
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
                         dense.strata.dimension.begin(), dense.strata.dimension.end(), 0)),
                     .compaction = dense.compaction};
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
  if (run.report.stages.decimation)
    for (KeptVertex& vertex : run.report.stages.decimation->kept)
      vertex.position += offset;
  run.mm_to_out = mm_to_space(native.frame(), run.space);
}

/// Nodes on the edges, where elements of second order are asked for.
void add_mid_nodes(Run& run, const InterfaceMesh& dense, TetMesh& tets) {
  if (run.request.parameters.element_order < 2 || run.request.surface_only) return;
  run.report.stages.second_order = run.stage.run(
      stage_names::kSecondOrder,
      [&] {
        return make_second_order(tets, run.request.parameters.curved_elements ? &dense : nullptr,
                                 run.context);
      },
      [](const SecondOrderStats& s) {
        return fmt::format("{} nodes, {} on the surface moved, {} held back by a Jacobian",
                           s.mid_nodes, s.moved, s.held_back);
      });
}

/// Says of a baseline what it is, and which labels it fails.
void warn_of_baseline(Run& run) {
  if (!is_baseline(run)) return;
  run.context.log->warn(
      "surface is \"delaunay\": this mesh is a baseline, written with its faults; \"decimation\" "
      "keeps the topology");
  for (std::size_t m = 1; m < run.report.topology.size(); ++m) {
    const std::string fault = topology_fault(run.report.topology[m]);
    if (!fault.empty())
      run.context.log->warn("{}: label {} ({}) {}", stage_names::kDelaunay, run.report.label_of[m],
                            run.report.name_of[m], fault);
  }
}

void measure(Run& run, const LabelVolume& labels, const InterfaceMesh& dense, const TetMesh& tets) {
  const std::size_t material_count = labels.material_count();
  Report& report = run.report;
  report.mm_to_out = run.mm_to_out;
  run.stage.run(
      stage_names::kMetrics,
      [&] {
        report.topology = measure_topology(labels, dense, tets.surface);
        report.mesh = count_mesh(tets, material_count);
        report_progress(run.context, stage_names::kMetrics, 0.1);
        const TetMesh* filled = run.request.surface_only ? nullptr : &tets;
        report.checks =
            is_baseline(run)
                ? inspect_mesh(labels, report.topology, tets.surface, filled)
                : check_mesh(labels, report.topology, tets.surface, filled, names_in_messages(run));
        report_progress(run.context, stage_names::kMetrics, 0.3);
        report.quality = run.request.surface_only ? measure_quality(tets.surface, material_count)
                                                  : measure_quality(tets, material_count);
        if (!run.request.surface_only) report.volumes = measure_volume_error(tets, labels);
        report_progress(run.context, stage_names::kMetrics, 0.5);
        report.distances =
            measure_surface_fidelity(tets.surface, &dense, nullptr, labels, {}, run.context);
        report.gates = check_gates(report);
        return 0;
      },
      [&](int) {
        return fmt::format("mean distance to the dense surface {:.3g} voxels, to the labels {:.3g}",
                           report.distances->to_dense->overall.voxels.mean_symmetric(),
                           report.distances->to_labels.overall.voxels.mean_symmetric());
      });
}

/// The page for people, on request.
void write_html_report(Run& run,
                       const LabelVolume& labels,
                       const InterfaceMesh& dense,
                       const TetMesh& tets) {
  if (!run.request.html_report) return;
  run.stage.run(
      stage_names::kHtmlReport,
      [&] {
        const FacetDistances distances =
            measure_facet_distances(tets.surface, dense, labels.frame().voxel_mm());
        report_progress(run.context, stage_names::kHtmlReport, 0.5);
        const std::string page = html_report(run.report, tets, distances, run.mm_to_out);
        AtomicFile file(run.outputs.add(".report.html"));
        file.write(page);
        file.commit();
        return page.size();
      },
      [](std::size_t bytes) { return fmt::format("{:.1f} MB", static_cast<double>(bytes) / 1e6); });
}

/// A run that cannot keep its limits is better refused now than stopped after an hour. Forecasts
/// are good to a factor of two, machines differ, too: what may still fit is tried.
void check_limits(Run& run, const LabelVolume& labels) {
  constexpr double kMemoryDoubt = 2, kTimeDoubt = 4;
  const RunLimits& limits = run.request.limits;
  if (limits.memory_mb <= 0 && limits.time_s <= 0) return;
  const auto exceeds_memory = [&](const Forecast& f) {
    return limits.memory_mb > 0 && f.memory_mb > kMemoryDoubt * limits.memory_mb;
  };
  const auto exceeds_time = [&](const Forecast& f) {
    return limits.time_s > 0 && f.seconds > kTimeDoubt * limits.time_s;
  };
  // A forecast takes a tenth of the run: mostly a bound tells that the limits are far away.
  const auto most = bound_forecast(labels, run.request.parameters, run.report.threads);
  if (most && !exceeds_memory(*most) && !exceeds_time(*most)) return;
  const Forecast forecast = make_forecast(labels, run.request.parameters, run.report.threads);
  const auto refuse = [&](const char* what, double need, double bound, const char* unit,
                          const char* option) {
    throw Error(ErrorCode::Limit, stage_names::kLabels,
                fmt::format("the run needs about {:.3g} {} of {}, far above the limit of {:g} {}; "
                            "raise {}, crop the volume by region_of_interest, or raise epsilon",
                            need, unit, what, bound, unit, option));
  };
  if (exceeds_memory(forecast))
    refuse("memory", forecast.memory_mb, limits.memory_mb, "MiB", "--memory-limit");
  if (exceeds_time(forecast)) refuse("time", forecast.seconds, limits.time_s, "s", "--time-limit");
}

void warn_of_first_order_files(const Run& run) {
  if (run.request.parameters.element_order > 1 && !run.request.surface_only &&
      run.request.formats.contains(MeshFormat::Mesh))
    run.context.log->warn(
        "parameters: element_order is {}, but .mesh files hold the corners of the tets only; leave "
        "them out with --formats vtu",
        run.request.parameters.element_order);
}

void run_stages(Run& run) {
  warn_of_first_order_files(run);
  const LabelVolume native = read_and_clean(run);
  for (const std::string& warning : check_label_options(run.request.parameters, native))
    run.context.log->warn("{}", warning);
  check_sample(run, native);
  check_limits(run, native);
  std::optional<ResampleLabelsResult> resampled = resample(run, native);
  const LabelVolume& labels = resampled ? resampled->labels : native;
  LevelSets level_sets = smooth_level_sets_of(run, labels);
  Dense dense = extract_dense(run, level_sets);
  MedialAxis medial_axis = medial_axis_of(run, labels, level_sets, dense);
  TetMesh tets = mesh_at_scale(run, labels, std::move(level_sets), dense, std::move(medial_axis));
  if (resampled) move_to_native_grid(run, native, resampled->offset_mm, dense.mesh, tets);
  resampled.reset();
  add_mid_nodes(run, dense.mesh, tets);
  measure(run, native, dense.mesh, tets);
  warn_of_baseline(run);
  cut_contacts(run, native, tets);
  add_samples(run, native, tets);
  write_results(run, native, tets);
  write_html_report(run, native, dense.mesh, tets);
}

/// Gates that a run to the surfaces could neither keep nor miss.
void refuse_gates_of_tets(const QualityGates& gates) {
  const std::vector<std::string> keys = gates_of_tets(gates);
  if (keys.empty()) return;
  std::string list;
  for (const std::string& key : keys)
    list += fmt::format("{}gates.{}", list.empty() ? "" : ", ", key);
  throw Error(ErrorCode::BadParameter, "parameters",
              list + " cannot be measured without tets; set to null, or leave --surface-only out");
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

int signal_of(const RunRequest& request) {
  return request.signal == nullptr ? 0 : request.signal->load();
}

/// A cancel by a signal, told as such.
Error with_signal(const Error& error, const RunRequest& request) {
  const int signal = signal_of(request);
  if (signal == 0) return error;
  return {ErrorCode::Limit, error.stage(),
          fmt::format("stopped by signal {}; nothing but the failure file was written", signal)};
}

/// Why the run failed goes into a file, too; if even that cannot be written, the error itself
/// still says it.
void write_failure(const OutputFolder& outputs,
                   const Report& report,
                   const Error& error,
                   int signal,
                   const StageContext& context) {
  try {
    write_json(outputs.failure_file(), failure_json(report, error, signal));
  } catch (const std::exception& second) {
    context.log->warn("{}", second.what());
  }
}

OutputPlan plan_of(const RunRequest& request) {
  OutputPlan plan{.suffixes = mesh_suffixes(request), .replace = request.force};
  if (request.html_report) plan.suffixes.emplace_back(".report.html");
  plan.suffixes.emplace_back(".metrics.json");
  return plan;
}

Report empty_report(const RunRequest& request) {
  Report report;
  report.version = kVersion;
  report.libraries = library_versions();
  report.parameters = request.parameters;
  report.input.file = request.input.filename().string();
  report.threads = static_cast<int>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  return report;
}

}  // namespace

RunResult run_pipeline(const RunRequest& request, const StageContext& given) {
  const Timer timer;
  StageContext context = given;
  context.seed = request.parameters.seed;
  Report report = empty_report(request);
  context.log = make_warning_log(given.log, report.warnings);
  std::error_code ignored;
  require(std::filesystem::exists(request.input, ignored), ErrorCode::BadInput, stage_names::kRead,
          "'" + request.input.string() + "' does not exist; check the path");
  if (request.surface_only && request.parameters.target_tets)
    throw Error(ErrorCode::BadParameter, "parameters",
                fmt::format("target_tets ({}) cannot be met by surfaces; give target_vertices, or "
                            "leave --surface-only out",
                            *request.parameters.target_tets));
  if (request.surface_only) refuse_gates_of_tets(request.parameters.gates);
  if (!request.surface_only) find_tetgen_helper();  // a missing helper ends the run here, not late

  OutputFolder outputs(request.out_dir, input_stem(request.input), plan_of(request));
  StageRunner stage(context, report);
  const Report as_begun = report;
  const Watchdog watchdog(
      request.limits, given.cancel, [&] { return stage.current(); },
      request.on_stuck ? [&](const Error& error) {
        // The stages' thread still works on its report; the one from the start is safe to read.
        const Error told = with_signal(error, request);
        write_failure(outputs, as_begun, told, signal_of(request), context);
        outputs.abandon();
        request.on_stuck(told);
      } : Watchdog::Stuck());
  context.cancel = watchdog.stop_flag();
  Run run{request, context, outputs, report, stage};
  try {
    run_stages(run);
    report.total_seconds = timer.seconds();
    write_json(outputs.add(".metrics.json"), report_json(report));
    return {std::move(report), outputs.files()};
  } catch (...) {
    const Error caught = as_error(std::current_exception(), stage.current());
    const Error error = with_signal(watchdog.limit_reached().value_or(caught), request);
    outputs.discard();
    report.total_seconds = timer.seconds();
    write_failure(outputs, report, error, signal_of(request), context);
    throw error;
  }
}

}  // namespace cvmesh
