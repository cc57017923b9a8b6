// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/label_options.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/median.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

/// The two sides of the interface of two of the user's labels, of which 0 may be the exterior;
/// nothing where one is not in the volume.
std::optional<Sides> sides_of(const LabelVolume& labels, const std::array<Label, 2>& pair) {
  std::array<MaterialId, 2> ids{};
  for (std::size_t n = 0; n < 2; ++n) {
    const auto m = labels.material_of(pair[n]);
    if (!m && pair[n] != 0) return std::nullopt;
    ids[n] = m.value_or(kExterior);
  }
  return Sides{std::max(ids[0], ids[1]), std::min(ids[0], ids[1])};
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

void check_boxes(const std::vector<BoxParameters>& boxes, const std::array<int, 3>& dims) {
  for (std::size_t n = 0; n < boxes.size(); ++n)
    for (std::size_t axis = 0; axis < 3; ++axis)
      require(boxes[n].box.hi[axis] < dims[axis], ErrorCode::BadParameter, "parameters",
              fmt::format("boxes[{0}].box reaches {1} = {2}, outside the volume of {3} x {4} x {5} "
                          "voxels; keep {1} between 0 and {6}",
                          n, "ijk"[axis], boxes[n].box.hi[axis], dims[0], dims[1], dims[2],
                          dims[axis] - 1));
}

}  // namespace

MaterialId material_named(const LabelVolume& labels,
                          const LabelReference& reference,
                          const std::string& key) {
  std::string wanted, known;
  std::vector<MaterialId> found;
  for (std::size_t id = 1; id < labels.material_count(); ++id) {
    known += fmt::format("{}{} \"{}\"", known.empty() ? "" : ", ", labels.label_of[id],
                         labels.name_of[id]);
    const bool is_it = std::holds_alternative<Label>(reference)
                           ? std::get<Label>(reference) == labels.label_of[id]
                           : std::get<std::string>(reference) == labels.name_of[id];
    if (is_it) found.push_back(static_cast<MaterialId>(id));
  }
  if (found.size() == 1) return found.front();
  std::visit([&](const auto& label) { wanted = fmt::format("{}", label); }, reference);
  throw Error(ErrorCode::BadParameter, "parameters",
              fmt::format("{} names \"{}\", which is {} of the labels to mesh; give one of {}", key,
                          wanted, found.empty() ? "none" : "more than one", known));
}

std::vector<Sides> contact_sides(const Parameters& parameters, const LabelVolume& labels) {
  std::vector<Sides> contacts;
  for (const std::array<LabelReference, 2>& pair : parameters.contact) {
    const MaterialId a = material_named(labels, pair[0], "contact");
    const MaterialId b = material_named(labels, pair[1], "contact");
    contacts.push_back({std::max(a, b), std::min(a, b)});
  }
  return contacts;
}

std::vector<bool> sampled_materials(const SampleParameters& sample, const LabelVolume& labels) {
  std::vector<bool> is_sampled(labels.material_count(), sample.labels.empty());
  for (const Label label : sample.labels)
    is_sampled[material_named(labels, label, "sample.labels")] = true;
  return is_sampled;
}

std::vector<std::string> check_label_options(const Parameters& parameters,
                                             const LabelVolume& labels) {
  check_boxes(parameters.boxes, labels.input_dims);
  contact_sides(parameters, labels);
  std::vector<std::string> warnings;
  for (const auto& [label, own] : parameters.labels) {
    const bool is_used = own.r || own.epsilon || own.min_edge_mm || own.max_edge_mm;
    if (is_used && !labels.material_of(label))
      warnings.push_back(fmt::format(
          "parameters: label {} has a radius or sizes, but is not among the labels to mesh",
          label));
  }
  for (const InterfaceParameters& own : parameters.interfaces)
    if (!sides_of(labels, own.labels))
      warnings.push_back(fmt::format(
          "parameters: interfaces names labels {} and {}, which are not both among the labels to "
          "mesh",
          own.labels[0], own.labels[1]));
  return warnings;
}

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
TightenOptions tighten_options_of(const Parameters& parameters, const LabelVolume& labels) {
  TightenOptions options = parameters.tighten;
  for (const auto& [label, own] : parameters.labels)
    if (const auto m = labels.material_of(label); m && own.r) options.r_vox_of[*m] = *own.r;
  // The smaller radius rules where materials meet, and the exterior has no say in it.
  double largest = options.r_vox;
  for (const auto& [material, r] : options.r_vox_of)
    largest = std::max(largest, r);
  options.r_vox_of[kExterior] = largest;
  return options;
}

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

/// The sizing options with the user's labels turned into material ids, and boxes into grid mm.
SizingOptions sizing_options_of(const Parameters& parameters,
                                const Vec3& input_spacing_mm,
                                const LabelVolume& labels) {
  SizingOptions options = parameters.sizing;
  for (const auto& [label, own] : parameters.labels)
    if (const auto m = labels.material_of(label))
      options.per_material[*m] = {own.epsilon, own.min_edge_mm, own.max_edge_mm};
  for (const InterfaceParameters& own : parameters.interfaces)
    if (const auto sides = sides_of(labels, own.labels))
      options.per_interface[*sides] = {own.epsilon, own.min_edge_mm, own.max_edge_mm};
  for (const BoxParameters& own : parameters.boxes)
    options.boxes.push_back({box_mm(own.box, input_spacing_mm, labels),
                             {own.epsilon, own.min_edge_mm, own.max_edge_mm}});
  return options;
}

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

SizingOptions scaled_to_distance(const SizingOptions& options,
                                 const std::vector<double>& lfs_mm,
                                 double voxel_mm,
                                 double limit_mm) {
  // The middle of a triangle with edges h is off a sphere of radius rho by h^2 / (6 rho).
  constexpr double kSagitta = 6;
  constexpr double kLeastEpsilon = 0.05, kMostEpsilon = 5;
  std::vector<double> ratio(lfs_mm.size());
  for (std::size_t v = 0; v < lfs_mm.size(); ++v)
    ratio[v] = std::sqrt(kSagitta * limit_mm / std::max(lfs_mm[v], voxel_mm));
  const double epsilon = std::clamp(median(std::move(ratio)), kLeastEpsilon, kMostEpsilon);
  return scaled(options, epsilon / options.epsilon);
}

std::optional<double> max_distance_mm_of(const Parameters& parameters, double voxel_mm) {
  if (parameters.max_distance_mm) return parameters.max_distance_mm;
  if (parameters.max_distance_vox) return *parameters.max_distance_vox * voxel_mm;
  return std::nullopt;
}

}  // namespace cvmesh
