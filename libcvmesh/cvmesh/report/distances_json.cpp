// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/distances_json.h"

#include <nlohmann/json.hpp>

#include <set>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

Json stats_json(const DistanceStats& stats, const Report& report) {
  Json json = {{"max", stats.max},
               {"max_error", stats.max_error},
               {"p95", stats.p95},
               {"mean", stats.mean},
               {"mean_standard_error", stats.mean_standard_error},
               {"rms", stats.rms},
               {"samples", stats.samples}};
  if (stats.samples == 0) return json;
  const Vec3 place = report.mm_to_out(stats.worst_mm);
  json["worst"] = {{"position", {place.x, place.y, place.z}}};
  if (stats.worst_sides.inside == stats.worst_sides.outside) return json;  // a surface of no labels
  json["worst"]["inside_label"] = report.label_of[stats.worst_sides.inside];
  json["worst"]["outside_label"] = report.label_of[stats.worst_sides.outside];
  return json;
}

Json two_sided_json(const TwoSidedDistance& distance, const Report& report) {
  return {{"mesh_to_reference", stats_json(distance.mesh_to_reference, report)},
          {"reference_to_mesh", stats_json(distance.reference_to_mesh, report)},
          {"hausdorff_lower_bound", distance.hausdorff_lower_bound()},
          {"hausdorff_upper_bound", distance.hausdorff_upper_bound()},
          {"mean_symmetric", distance.mean_symmetric()},
          {"rms_symmetric", distance.rms_symmetric()}};
}

Json distance_json(const SurfaceDistance& distance, const Report& report) {
  Json json = {{"mm", two_sided_json(distance.mm, report)},
               {"voxels", two_sided_json(distance.voxels, report)}};
  if (distance.world_mm) json["world_mm"] = two_sided_json(*distance.world_mm, report);
  return json;
}

/// Calls visit(key, distances) for every reference that was measured.
template <typename Visit>
void for_each_reference(const SurfaceFidelity& fidelity, const Visit& visit) {
  if (fidelity.to_dense) visit("to_dense", *fidelity.to_dense);
  visit("to_labels", fidelity.to_labels);
  if (fidelity.to_truth) visit("to_truth", *fidelity.to_truth);
}

Json interfaces_json(const Report& report) {
  std::set<Sides> pairs;
  for_each_reference(*report.distances, [&](const char*, const SurfaceDistances& distances) {
    for (const auto& [pair, distance] : distances.of_pair)
      pairs.insert(pair);
  });
  Json interfaces = Json::array();
  for (const Sides& pair : pairs) {
    Json entry = {{"inside_label", report.label_of[pair.inside]},
                  {"outside_label", report.label_of[pair.outside]}};
    for_each_reference(*report.distances, [&](const char* key, const SurfaceDistances& distances) {
      const auto found = distances.of_pair.find(pair);
      if (found != distances.of_pair.end()) entry[key] = distance_json(found->second, report);
    });
    interfaces.push_back(entry);
  }
  return interfaces;
}

}  // namespace

Json distances_json(const Report& report) {
  Json json;
  for_each_reference(*report.distances, [&](const char* key, const SurfaceDistances& distances) {
    json[key] = distance_json(distances.overall, report);
  });
  json["interfaces"] = interfaces_json(report);
  json["samples_per_square_voxel"] = report.distances->options.samples_per_square_voxel;
  json["max_error_vox"] = report.distances->options.max_error_vox;
  return json;
}

Json material_distances_json(const Report& report, std::size_t m) {
  Json json;
  for_each_reference(*report.distances, [&](const char* key, const SurfaceDistances& distances) {
    if (m < distances.of_material.size())
      json[key] = distance_json(distances.of_material[m], report);
  });
  return json;
}

}  // namespace cvmesh
