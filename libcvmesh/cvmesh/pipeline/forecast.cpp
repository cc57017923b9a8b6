// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/forecast.h"

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/resample_labels.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/metrics/measured_surfaces.h"
#include "cvmesh/pipeline/dense_surfaces.h"
#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

namespace cvmesh {
namespace {

// Measured on volumes of 8 to 32 million voxels, 2 to 116 labels, epsilon 0.5 to 5.
constexpr double kTetsPerVertex = 12;
constexpr double kBaseMb = 15;
constexpr double kBytesPerVoxel = 3, kBytesPerFullFacet = 290, kBytesPerFacet = 520,
                 kBytesPerVertex = 4500;
constexpr double kMebi = 1 << 20;
// Processor time. Decimation and metrics take most of what a facet costs, the improvement of the
// tets most of what a vertex costs.
constexpr double kBaseSeconds = 0.05, kSecondsPerFacet = 42e-6, kSecondsPerVoxel = 0.3e-6,
                 kSecondsPerVertex = 0.9e-3;
constexpr double kSequentialShare = 0.35;
// A sixth of what a run smooths, and more where it costs less than a second: then vertices differ
// by 1 to 6 % where epsilon is 0.5 to 4. Without smoothing a ball has a third of its vertices, and
// a plate of one voxel a fifth; a small ball after 20 sweeps three times as many.
constexpr int kLeastSweeps = 20;
constexpr double kSweptNodes = 5e8;

/// The labels on the working grid that `grid_spacing_mm` asks for; nothing where it asks for none.
std::optional<LabelVolume> on_working_grid(const LabelVolume& labels,
                                           const std::optional<GridSpacing>& spacing) {
  if (!spacing) return std::nullopt;
  const double mm = spacing->is_auto ? auto_spacing_mm(labels.frame()) : spacing->mm;
  return resample_labels(labels, {.spacing_mm = mm}, silent_context()).labels;
}

/// The surfaces to come, on a grid.
struct Surfaces {
  std::size_t facets = 0, full_facets = 0;  ///< after and before dense vertices are merged
  double vertices = 0;                      ///< that the sizes lead to
};

Surfaces first_stages(const LabelVolume& labels,
                      const Vec3& input_spacing_mm,
                      const Parameters& parameters) {
  const StageContext context = silent_context();
  const auto ids = std::make_shared<const Grid<MaterialId>>(labels.ids);
  LevelSets rough = build_level_sets(ids, labels.material_count(), context).level_sets;
  TightenOptions smoothing = tighten_options_of(parameters, labels);
  const double affordable = kSweptNodes / static_cast<double>(rough.values.size());
  if (smoothing.smoothing_sweeps > affordable)
    smoothing.smoothing_sweeps =
        std::min(smoothing.smoothing_sweeps, std::max(kLeastSweeps, static_cast<int>(affordable)));
  const LevelSets level_sets = tighten(std::move(rough), smoothing, context).level_sets;
  const Dense dense = make_dense_surfaces(level_sets, context);
  Surfaces result{.facets = dense.mesh.facets.size()};
  result.full_facets = result.facets + 2 * dense.compaction.merged_vertices;
  if (parameters.target_vertices || parameters.target_tets) return result;  // sizes do not matter
  const MedialAxis axis =
      extract_medial_axis(level_sets, dense.mesh, dense.strata, parameters.medial_axis, context)
          .medial_axis;
  const double voxel_mm = labels.frame().voxel_mm();
  const SizingProblem problem(dense.mesh, dense.strata,
                              local_feature_size(dense.mesh, dense.strata, axis, voxel_mm, context),
                              *ids);
  SizingOptions options = sizing_options_of(parameters, input_spacing_mm, labels);
  // where it begins: what is too far then is refined, which nobody can tell before
  if (const auto limit_mm = max_distance_mm_of(parameters, voxel_mm))
    options = scaled_to_distance(options, problem.lfs_mm(), voxel_mm, *limit_mm);
  result.vertices = problem.estimate_vertices(options);
  return result;
}

/// No edge is wanted shorter than this anywhere, but where a thin part needs three around it.
double least_edge_mm(const Parameters& parameters, double voxel_mm) {
  const double floor = parameters.sizing.min_feature_vox * voxel_mm;
  double least = parameters.sizing.epsilon * floor;
  const auto take = [&](const auto& sizes) {
    if (sizes.epsilon) least = std::min(least, *sizes.epsilon * floor);
    if (sizes.max_edge_mm) least = std::min(least, *sizes.max_edge_mm);
  };
  if (parameters.sizing.max_edge_mm) least = std::min(least, *parameters.sizing.max_edge_mm);
  for (const auto& [label, own] : parameters.labels)
    take(own);
  for (const InterfaceParameters& own : parameters.interfaces)
    take(own);
  for (const BoxParameters& own : parameters.boxes)
    take(own);
  return least;
}

Forecast costs_of(const Surfaces& surfaces, std::size_t voxels, int threads) {
  Forecast forecast;
  const double vertices = surfaces.vertices;
  forecast.dense_facets = surfaces.facets;
  forecast.surface_vertices = vertices;
  forecast.tets = kTetsPerVertex * vertices;
  const auto of_facets = static_cast<double>(surfaces.facets),
             of_full = static_cast<double>(surfaces.full_facets),
             of_voxels = static_cast<double>(voxels);
  forecast.memory_mb =
      kBaseMb + (kBytesPerVoxel * of_voxels +
                 std::max({kBytesPerFullFacet * of_full, kBytesPerFacet * of_facets,
                           kBytesPerVertex * vertices})) /
                    kMebi;
  const double on_one_thread = kBaseSeconds + kSecondsPerFacet * of_facets +
                               kSecondsPerVoxel * of_voxels + kSecondsPerVertex * vertices;
  forecast.seconds =
      on_one_thread * (kSequentialShare + (1 - kSequentialShare) / std::max(1, threads));
  return forecast;
}

}  // namespace

std::optional<Forecast> bound_forecast(const LabelVolume& labels,
                                       const Parameters& parameters,
                                       int threads) {
  if (parameters.grid_spacing_mm || parameters.max_distance_mm || parameters.max_distance_vox)
    return std::nullopt;
  constexpr double kMostFacetsPerFace = 10;  // six as a rule, nine where labels meet everywhere
  const std::vector<VoxelFace> faces = find_voxel_faces(labels.ids);
  const Vec3& step = labels.frame().spacing_mm;
  double area = 0;
  for (const VoxelFace& face : faces)
    area += step[(face.axis + 1) % 3] * step[(face.axis + 2) % 3];
  const double edge = least_edge_mm(parameters, labels.frame().voxel_mm());
  const double vertices = std::max({2 / std::sqrt(3.0) * area / (edge * edge),
                                    static_cast<double>(parameters.target_vertices.value_or(0)),
                                    static_cast<double>(parameters.target_tets.value_or(0))});
  const std::size_t facets = static_cast<std::size_t>(kMostFacetsPerFace) * faces.size();
  return costs_of({facets, facets, vertices}, labels.frame().size(), threads);
}

Forecast make_forecast(const LabelVolume& labels, const Parameters& parameters, int threads) {
  const std::optional<LabelVolume> resampled = on_working_grid(labels, parameters.grid_spacing_mm);
  const LabelVolume& working = resampled ? *resampled : labels;
  Surfaces surfaces = first_stages(working, labels.frame().spacing_mm, parameters);
  if (parameters.target_vertices)
    surfaces.vertices = static_cast<double>(*parameters.target_vertices);
  else if (parameters.target_tets)
    surfaces.vertices = static_cast<double>(*parameters.target_tets) / kTetsPerVertex;
  return costs_of(surfaces, working.frame().size(), threads);
}

}  // namespace cvmesh
