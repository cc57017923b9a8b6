// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/report_json.h"

#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/report/distances_json.h"
#include "cvmesh/report/stats_json.h"

#include <nlohmann/json.hpp>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

Json header(const Report& report, const char* status) {
  Json object = {{"cvmesh", report.version},
                 {"schema_version", kReportSchemaVersion},
                 {"status", status},
                 {"libraries", report.libraries}};
  if (!report.run_key.empty()) object[kRunKey] = report.run_key;
  return object;
}

Json input_json(const InputSummary& input) {
  return {{"file", input.file},
          {"dims", input.dims},
          {"spacing_mm", {input.spacing_mm.x, input.spacing_mm.y, input.spacing_mm.z}},
          {"space", space_name(input.space)},
          {"output_space", space_name(input.output_space)},
          {"labels", input.labels},
          {"file_sha256", input.file_sha256},
          {"labels_sha256", input.labels_sha256}};
}

template <typename T>
void add(Json& object, const char* key, const std::optional<T>& value) {
  if (value) object[key] = *value;
}

Json boundary_json(const BoundaryTopology& boundary, std::size_t components) {
  return {{"components", components},
          {"boundary_components", boundary.components},
          {"boundary_euler", boundary.euler},
          {"is_closed_manifold", boundary.is_closed_manifold},
          {"nonmanifold_edges", boundary.nonmanifold_edges},
          {"nonmanifold_vertices", boundary.nonmanifold_vertices}};
}

Json topology_json(const MaterialTopology& t) {
  Json json = {{"voxels", {{"components", t.voxels.components}, {"euler", t.voxels.euler}}}};
  if (t.dense) json["dense"] = boundary_json(*t.dense, t.dense_components);
  json["mesh"] = boundary_json(t.mesh, t.mesh_components);
  if (t.mesh_euler) json["mesh"]["euler"] = *t.mesh_euler;
  return json;
}

/// Entry `m` of a per-material vector, where there is one.
template <typename T>
void add_entry(Json& object, const char* key, const std::vector<T>& values, std::size_t m) {
  if (m < values.size()) object[key] = values[m];
}

/// What is known of material m besides its accounting.
void add_material(const Report& report, std::size_t m, Json& entry) {
  add_entry(entry, "volume", report.volumes, m);
  if (m < report.topology.size()) entry["topology"] = topology_json(report.topology[m]);
  if (report.stages.sizing_field)
    add_entry(entry, "share_below_three_facets",
              report.stages.sizing_field->share_below_three_facets, m);
  if (report.particle_counts) add_entry(entry, "particles", report.particle_counts->of_material, m);
  if (report.mesh) {
    add_entry(entry, "tets", report.mesh->tets_of, m);
    add_entry(entry, "surface_triangles", report.mesh->triangles_of, m);
  }
  if (report.distances) entry["distances"] = material_distances_json(report, m);
  if (report.quality) {
    Json quality;
    add_entry(quality, "triangles", report.quality->triangles_of, m);
    add_entry(quality, "tets", report.quality->tets_of, m);
    entry["quality"] = quality;
  }
}

/// One entry per label of the input, and per label that only merges brought.
Json labels_json(const Report& report) {
  Json labels = Json::array();
  if (!report.stages.labels) return labels;
  for (const LabelAccount& account : report.stages.labels->accounts) {
    Json entry = account;
    for (std::size_t m = 1; m < report.label_of.size(); ++m)
      if (report.label_of[m] == account.label && !account.is_dropped)
        add_material(report, m, entry);
    labels.push_back(entry);
  }
  return labels;
}

/// The interfaces with the two labels of each, numbered as in the mesh files.
Json interfaces_json(const Report& report, const ParticleCounts& counts) {
  Json interfaces = Json::array();
  for (std::size_t p = 0; p < counts.patches.size(); ++p)
    interfaces.push_back({{"index", p + 1},
                          {"inside_label", report.label_of[counts.patches[p].sides.inside]},
                          {"outside_label", report.label_of[counts.patches[p].sides.outside]},
                          {"wall", counts.patches[p].wall},
                          {"particles", counts.on_patch[p]}});
  return interfaces;
}

/// Where the topology guard held a label: the places with most nodes, since a noisy volume may have
/// thousands.
Json guarded_json(const std::vector<GuardedPlace>& places, const std::vector<Label>& label_of) {
  constexpr std::size_t kMostPlaces = 100;
  Json guarded = Json::array();
  for (const GuardedPlace& place : places) {
    if (guarded.size() == kMostPlaces) break;
    guarded.push_back(
        {{"label", label_of[place.material]},
         {"nodes", place.nodes},
         {"position_grid_mm", {place.position.x, place.position.y, place.position.z}}});
  }
  return guarded;
}

/// What every pass of a pair of labels took.
Json pairs_json(const std::vector<ConformPass>& passes, const std::vector<Label>& label_of) {
  Json pairs = Json::array();
  for (const ConformPass& pass : passes) {
    Json pair = {{"master_label", label_of[pass.sides.outside]},
                 {"slave_label", label_of[pass.sides.inside]}};
    pair.update(Json(pass.result));
    pairs.push_back(pair);
  }
  return pairs;
}

/// Where tets stayed poor, and in which narrow wedge if that is why.
Json poor_tets_json(const std::vector<PoorTet>& places, const std::vector<Label>& label_of) {
  Json poor = Json::array();
  for (const PoorTet& place : places) {
    Json tet = {{"label", label_of[place.material]},
                {"min_deg", place.min_deg},
                {"max_deg", place.max_deg},
                {"position_grid_mm", {place.position.x, place.position.y, place.position.z}}};
    if (place.wedge_deg > 0) tet["wedge_deg"] = place.wedge_deg;
    if (place.bound_deg > 0) tet["bound_deg"] = place.bound_deg;
    poor.push_back(tet);
  }
  return poor;
}

Json stages_json(const Report& report) {
  const StageResults& stages = report.stages;
  Json object = Json::object();
  add(object, "labels", stages.labels);
  add(object, "resampling", stages.resampling);
  add(object, "level_sets", stages.level_sets);
  add(object, "tightening", stages.tightening);
  if (stages.tightening)
    object["tightening"]["guarded"] = guarded_json(stages.tightening->guarded, report.label_of);
  add(object, "dense_surfaces", stages.dense_surfaces);
  add(object, "medial_axis", stages.medial_axis);
  add(object, "sizing_field", stages.sizing_field);
  add(object, "epsilon_search", stages.epsilon_search);
  add(object, "seed_particles", stages.seed_particles);
  add(object, "particle_optimisation", stages.particles);
  add(object, "insertion", stages.insertion);
  add(object, "decimation", stages.decimation);
  add(object, "edge_conformity", stages.edge_conformity);
  if (stages.edge_conformity)
    object["edge_conformity"]["pairs"] =
        pairs_json(stages.edge_conformity->passes, report.label_of);
  add(object, "vertex_fit", stages.vertex_fit);
  add(object, "edge_flipping", stages.edge_flipping);
  add(object, "needles", stages.needles);
  add(object, "delaunay_tetrahedra", stages.delaunay_tets);
  add(object, "tetrahedra", stages.tetrahedra);
  if (stages.tetrahedra)
    object["tetrahedra"]["poor_tets"] =
        poor_tets_json(stages.tetrahedra->improvement.after.places, report.label_of);
  add(object, "second_order_nodes", stages.second_order);
  add(object, "contacts", stages.contacts);
  add(object, "sampling", stages.sampling);
  return object;
}

Json results_json(const Report& report) {
  Json results;
  results["labels"] = labels_json(report);
  if (!report.label_of.empty()) results["exterior_label"] = report.label_of[kExterior];
  if (report.particle_counts) {
    results["particles"] = *report.particle_counts;
    results["interfaces"] = interfaces_json(report, *report.particle_counts);
  }
  add(results, "mesh", report.mesh);
  add(results, "quality", report.quality);
  if (report.distances) results["distances"] = distances_json(report);
  add(results, "checks", report.checks);
  results["warnings"] = report.warnings;
  if (report.parameters.surface == SurfaceMethod::Delaunay) results["is_baseline"] = true;
  if (!report.gates.empty()) results["gates"] = report.gates;
  results["stages"] = stages_json(report);
  return results;
}

Json timings_json(const Report& report) {
  Json stages = Json::array();
  for (const StageTiming& timing : report.timings)
    stages.push_back(
        {{"stage", timing.stage}, {"seconds", timing.seconds}, {"peak_mb", timing.peak_mb}});
  return {{"threads", report.threads},
          {"total_seconds", report.total_seconds},
          {"peak_mb", report.peak_mb},
          {"stages", stages}};
}

void add_body(const Report& report, Json& object) {
  object["input"] = input_json(report.input);
  add(object, "judged_mesh", report.judged);
  object["parameters"] = parameters_to_json(report.parameters);
  object["results"] = results_json(report);
  object["timings"] = timings_json(report);
}

}  // namespace

const char* code_name(ErrorCode code) {
  switch (code) {
    case ErrorCode::BadParameter:
      return "BadParameter";
    case ErrorCode::BadInput:
      return "BadInput";
    case ErrorCode::StageFailed:
      return "StageFailed";
    case ErrorCode::QualityGate:
      return "QualityGate";
    case ErrorCode::Output:
      return "Output";
    case ErrorCode::Limit:
      return "Limit";
    case ErrorCode::Internal:
      break;
  }
  return "Internal";
}

Json report_json(const Report& report) {
  Json object = header(report, "success");
  add_body(report, object);
  return object;
}

Json failure_json(const Report& report, const Error& error, int signal) {
  constexpr int kSignalExitBase = 128;
  Json object = header(report, "failed");
  object["stage"] = error.stage();
  object["code"] = signal != 0 ? "Signal" : code_name(error.code());
  object["exit_code"] = signal != 0 ? kSignalExitBase + signal : static_cast<int>(error.code());
  object["message"] = error.message();
  add_body(report, object);
  return object;
}

}  // namespace cvmesh
