// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/finish_mesh.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/metrics/sample_tets.h"
#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/tet/split_contacts.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace cvmesh {
namespace {

Grid<float> read_sample(const Run& run, bool is_first) {
  std::vector<std::string> warnings;
  // Shear is no matter for values at points; a choice of volume is the labels' own.
  const ReadVolumeOptions options{.allow_shear = true,
                                  .allow_detached = run.request.read.allow_detached};
  Grid<float> image = read_image(run.request.sample, &warnings, options);
  if (is_first)
    for (const std::string& warning : warnings)
      run.context.log->warn("sample: {}", warning);
  return image;
}

/// Grid mm of the mesh -> index of the image, through the world of both.
Affine mm_to_image_index(const LabelVolume& labels, const GridFrame& image) {
  const Affine to_world = mm_to_space(labels.frame(), image.space);
  const Affine to_index = inverse(image.index_to_world);
  Affine map;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 unit{};
    unit[axis] = 1;
    const Vec3 column = to_index.linear(to_world.linear(unit));
    for (int row = 0; row < 3; ++row)
      map.rows[static_cast<std::size_t>(row)][axis] = column[row];
  }
  map.offset = to_index(to_world.offset);
  return map;
}

/// The laws of the parameter file, on the tets of the labels that they hold in.
void add_laws(const LabelVolume& labels,
              const SampleParameters& sample,
              const std::vector<double>& mean,
              TetMesh& tets) {
  if (!sample.density_slope) return;
  const std::vector<bool> is_sampled = sampled_materials(sample, labels);
  std::vector<double> density(mean.size(), 0), modulus(mean.size(), 0);
  for (std::size_t tet = 0; tet < mean.size(); ++tet) {
    if (!is_sampled[tets.material_of[tet]]) continue;
    density[tet] = *sample.density_slope * mean[tet] + sample.density_intercept;
    if (!sample.modulus_factor) continue;
    // A power of a negative density would be no number.
    const double law =
        *sample.modulus_factor * std::pow(std::max(density[tet], 0.0), sample.modulus_exponent);
    modulus[tet] = std::max(law, sample.min_modulus_mpa);
  }
  if (sample.bins > 0) tets.bins = bin_by_modulus(tets, modulus, sample.bins, sample.poisson_ratio);
  tets.arrays.push_back({"density_g_cm3", std::move(density)});
  if (sample.modulus_factor) tets.arrays.push_back({"modulus_mpa", std::move(modulus)});
}

}  // namespace

void check_sample(Run& run, const LabelVolume& labels) {
  if (run.request.sample.empty()) {
    if (run.request.parameters.sample.density_slope)
      run.context.log->warn("parameters: sample has laws, but there is no image; give --sample");
    return;
  }
  sampled_materials(run.request.parameters.sample, labels);
  mm_to_image_index(labels, read_sample(run, true).frame);
}

void cut_contacts(Run& run, const LabelVolume& labels, TetMesh& tets) {
  const std::vector<Sides> contacts = contact_sides(run.request.parameters, labels);
  if (contacts.empty() || run.request.surface_only) return;
  run.report.stages.contacts = run.stage.run(
      stage_names::kContacts, [&] { return split_contacts(tets, contacts); },
      [](const SplitContactsStats& s) {
        return fmt::format("{} facets cut, {} nodes added, {} pairs of nodes", s.facets_cut,
                           s.nodes_added, s.node_pairs);
      });
  for (const Sides& sides : contacts)
    if (std::none_of(tets.contacts.begin(), tets.contacts.end(),
                     [&](const Contact& contact) { return contact.sides == sides; }))
      run.context.log->warn("parameters: contact: {} and {} do not meet; nothing is cut there",
                            labels.name_of[sides.inside], labels.name_of[sides.outside]);
}

void add_samples(Run& run, const LabelVolume& labels, TetMesh& tets) {
  if (run.request.sample.empty() || run.request.surface_only) return;
  const std::string file = run.request.sample.filename().string();
  run.report.stages.sampling = run.stage.run(
      stage_names::kSampling,
      [&] {
        const Grid<float> image = read_sample(run, false);
        TetSamples samples = sample_tets(tets, image, mm_to_image_index(labels, image.frame));
        require(samples.tets_outside == 0, ErrorCode::BadInput, stage_names::kSampling,
                fmt::format("{} of {} tets lie outside the image '{}'; give one that covers the "
                            "labels, or crop these with region_of_interest",
                            samples.tets_outside, tets.tets.size(), file));
        const auto [lowest, highest] =
            std::minmax_element(samples.mean.begin(), samples.mean.end());
        SamplingSummary summary{.file = file, .min_mean = *lowest, .max_mean = *highest};
        add_laws(labels, run.request.parameters.sample, samples.mean, tets);
        tets.arrays.insert(tets.arrays.begin(), {{"sample_mean", std::move(samples.mean)},
                                                 {"sample_median", std::move(samples.median)}});
        summary.bins = tets.bins.size();
        return summary;
      },
      [](const SamplingSummary& s) {
        return fmt::format("means of {:.6g} to {:.6g}, {} elastic materials", s.min_mean,
                           s.max_mean, s.bins);
      });
}

}  // namespace cvmesh
