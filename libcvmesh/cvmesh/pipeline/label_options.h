// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include <optional>
#include <string>
#include <vector>

/// What the parameter file says of the user's labels, interfaces and boxes of voxels, in the
/// material ids and grid mm of one run; and the warnings where that has no effect.
namespace cvmesh {

/// The material that the parameters call by the label's value or name.
/// @param key  for messages
/// @throws Error BadParameter where it is not among the labels to mesh, or two have the name
MaterialId material_named(const LabelVolume& labels,
                          const LabelReference& reference,
                          const std::string& key);

/// The interfaces that `contact` names.
/// @throws Error BadParameter
std::vector<Sides> contact_sides(const Parameters& parameters, const LabelVolume& labels);

/// Per material, whether the laws of density and modulus hold in it.
/// @throws Error BadParameter
std::vector<bool> sampled_materials(const SampleParameters& sample, const LabelVolume& labels);

/// Looks up the labels, interfaces and boxes that the parameters name, before the long work.
/// @return warnings of labels that have parameters, but are not there to use them
/// @throws Error BadParameter for boxes that reach outside the volume, and where `contact` names
///         what is not among the labels to mesh
std::vector<std::string> check_label_options(const Parameters& parameters,
                                             const LabelVolume& labels);

/// Says which sizes have no surface to rule.
void warn_of_idle_sizes(const Run& run,
                        const LabelVolume& labels,
                        const Dense& dense,
                        const SizingOptions& options);

/// Says which labels have parts with fewer than three facets around, the worst first.
void warn_of_coarse_parts(const Run& run, const LabelVolume& labels, const SizingStats& stats);

TightenOptions tighten_options_of(const Parameters& parameters, const LabelVolume& labels);
/// @param input_spacing_mm  of the volume, which boxes of voxels are given in
SizingOptions sizing_options_of(const Parameters& parameters,
                                const Vec3& input_spacing_mm,
                                const LabelVolume& labels);

/// The options with every epsilon multiplied, so that all places keep their ratios.
SizingOptions scaled(SizingOptions options, double factor);

/// The options scaled to the epsilon at which half of the surface is expected to stay within
/// `limit_mm` of the dense one, were it curved as much as the local feature size allows.
/// @param lfs_mm  of each dense vertex
SizingOptions scaled_to_distance(const SizingOptions& options,
                                 const std::vector<double>& lfs_mm,
                                 double voxel_mm,
                                 double limit_mm);

/// The largest distance that the parameters allow, in mm; nothing where they set none.
std::optional<double> max_distance_mm_of(const Parameters& parameters, double voxel_mm);

}  // namespace cvmesh
