// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/stats_json.h"

#include <nlohmann/json.hpp>

namespace cvmesh {

using Json = nlohmann::ordered_json;

void to_json(Json& json, const LabelAccount& account) {
  json = {{"label", account.label},
          {"name", account.name},
          {"voxels_in", account.voxels_in},
          {"voxels_kept", account.voxels_kept},
          {"components_in", account.components_in},
          {"components_kept", account.components_kept},
          {"merged_into", account.merged_into ? Json(*account.merged_into) : Json()},
          {"is_dropped", account.is_dropped},
          {"is_outside_region", account.is_outside_region}};
}

void to_json(Json& json, const RemovedComponent& component) {
  json = {{"label", component.label},
          {"voxels", component.voxels},
          {"given_to", component.given_to},
          {"first_voxel", component.first_voxel}};
}

void to_json(Json& json, const CleanLabelsStats& stats) {
  json = {{"islands_removed", stats.islands_removed},
          {"island_voxels", stats.island_voxels},
          {"holes_filled", stats.holes_filled},
          {"hole_voxels", stats.hole_voxels},
          {"islands", stats.islands},
          {"holes", stats.holes}};
}

void to_json(Json& json, const ResampleLabelsStats& stats) {
  json = {{"dims", stats.dims},
          {"spacing_mm", {stats.spacing_mm.x, stats.spacing_mm.y, stats.spacing_mm.z}},
          {"nodes_wished", stats.nodes_wished},
          {"nodes_changed", stats.nodes_changed},
          {"nodes_held", stats.nodes_held}};
}

void to_json(Json& json, const BuildLevelSetsStats& stats) {
  json = {{"band_nodes", stats.band_nodes}, {"stored_bytes", stats.stored_bytes}};
}

void to_json(Json& json, const TightenStats& stats) {
  json = {{"iterations", stats.iterations},
          {"sweeps", stats.sweeps},
          {"nodes_changed", stats.nodes_changed},
          {"nodes_guarded", stats.nodes_guarded},
          {"guarded_places", stats.guarded.size()}};
}

void to_json(Json& json, const SurfaceSummary& summary) {
  json = {{"vertices", summary.vertices},
          {"facets", summary.facets},
          {"patches", summary.patches},
          {"curves", summary.curves},
          {"corners", summary.corners},
          {"merged_vertices", summary.compaction.merged_vertices},
          {"barred_nodes", summary.compaction.barred_nodes}};
}

void to_json(Json& json, const MedialAxisStats& stats) {
  json = {{"sites", stats.sites},
          {"pairs_tested", stats.pairs_tested},
          {"pairs_kept", stats.pairs_kept},
          {"pairs_dropped_at_curves", stats.pairs_dropped_at_curves}};
}

void to_json(Json& json, const SizingStats& stats) {
  json = {{"lfs_min_mm", stats.lfs_min_mm},
          {"lfs_median_mm", stats.lfs_median_mm},
          {"lfs_max_mm", stats.lfs_max_mm},
          {"h_min_mm", stats.h_min_mm},
          {"h_median_mm", stats.h_median_mm},
          {"h_max_mm", stats.h_max_mm},
          {"expected_vertices", stats.expected_vertices},
          {"capped_vertices", stats.capped_vertices}};
}

void to_json(Json& json, const EpsilonSearch& search) {
  json = {{"target", search.target},
          {"wanted", search.wanted},
          {"reached", search.reached},
          {"epsilon", search.epsilon},
          {"rounds", search.rounds}};
}

void to_json(Json& json, const SeedParticlesStats& stats) {
  json = {{"corners", stats.corners},
          {"curve_particles", stats.curve_particles},
          {"interface_particles", stats.interface_particles},
          {"guard_particles", stats.guard_particles},
          {"on_dense_corner", stats.on_dense_corner},
          {"on_dense_curve", stats.on_dense_curve},
          {"expected_interface_particles", stats.expected_interface_particles}};
}

void to_json(Json& json, const DistributeParticlesStats& stats) {
  json = {{"sweeps", stats.sweeps},
          {"thinning_rounds", stats.thinning_rounds},
          {"energy", stats.energy},
          {"split", stats.split},
          {"deleted", stats.deleted},
          {"loop_guards", stats.loop_guards},
          {"on_dense_facet", stats.on_dense_facet},
          {"edge_over_h_mean", stats.edge_over_h_mean},
          {"edge_over_h_sd", stats.edge_over_h_sd},
          {"edge_over_h_min", stats.edge_over_h_min},
          {"edge_over_h_max", stats.edge_over_h_max},
          {"nearest_over_h_mean", stats.nearest_over_h_mean},
          {"six_neighbour_share", stats.six_neighbour_share}};
}

void to_json(Json& json, const InsertParticlesStats& stats) {
  json = {{"snapped", stats.snapped},
          {"facet_splits", stats.facet_splits},
          {"shared", stats.shared},
          {"off_position", stats.off_position}};
}

void to_json(Json& json, const DecimateStats& stats) {
  Json kept = Json::array();
  for (const KeptVertex& vertex : stats.kept)
    kept.push_back({{"position_grid_mm", {vertex.position.x, vertex.position.y, vertex.position.z}},
                    {"reason", vertex.reason}});
  json = {{"removed", stats.removed},
          {"deferrals", stats.deferrals},
          {"passes", stats.passes},
          {"deviation_vox", stats.deviation_vox},
          {"refusals", stats.refusals},
          {"kept_count", stats.kept.size()},
          {"kept", kept}};
}

void to_json(Json& json, const EdgeConformity& conformity) {
  json = {{"edges", conformity.edges},
          {"edges_differing", conformity.edges_differing},
          {"flips", conformity.flips},
          {"edges_not_flippable", conformity.edges_not_flippable},
          {"vertices_differing", conformity.vertices_differing.size()}};
}

void to_json(Json& json, const ConformEdgesStats& stats) {
  json = {{"passes", stats.passes.size()}};
  json.update(Json(stats.total()));
  json["edges_given_up"] = stats.edges_given_up;
  json["boundaries_repeated"] = stats.boundaries_repeated;
}

void to_json(Json& json, const FitVerticesStats& stats) {
  json = {{"vertices", stats.vertices},
          {"refused", stats.refused},
          {"sweeps", stats.sweeps},
          {"mean_shift_mm", stats.mean_shift_mm},
          {"max_shift_mm", stats.max_shift_mm},
          {"rms_before_mm", stats.rms_before_mm},
          {"rms_after_mm", stats.rms_after_mm}};
}

void to_json(Json& json, const FlipEdgesStats& stats) {
  json = {{"flips", stats.flips}, {"refused", stats.refused}, {"passes", stats.passes}};
}

void to_json(Json& json, const RemoveNeedlesStats& stats) {
  json = {{"removed", stats.removed}};
}

void to_json(Json& json, const DelaunayTetsStats& stats) {
  json = {{"particles", stats.particles},
          {"unused_particles", stats.unused_particles},
          {"delaunay_tets", stats.delaunay_tets},
          {"flat_tets", stats.flat_tets}};
}

void to_json(Json& json, const TetrahedralizeStats& stats) {
  json = {{"switches", stats.switches},
          {"attempts", stats.attempts},
          {"surfaces_tried", stats.surfaces_tried},
          {"failed_attempts", stats.failed_attempts},
          {"steiner_points", stats.steiner_points},
          {"volume_error", stats.volume_error},
          {"improvement", stats.improvement}};
}

void to_json(Json& json, const DihedralAngles& angles) {
  json = {{"min_deg", angles.min_deg},
          {"max_deg", angles.max_deg},
          {"min_outside_wedges_deg", angles.min_outside_wedges_deg},
          {"max_outside_wedges_deg", angles.max_outside_wedges_deg},
          {"poor", angles.poor},
          {"poor_in_wedges", angles.poor_in_wedges},
          {"poor_bound_by_surface", angles.poor_bound_by_surface},
          {"least_share_of_wedge", angles.least_share_of_wedge}};
}

void to_json(Json& json, const ImproveTetsStats& stats) {
  json = {{"passes", stats.passes},
          {"moves", stats.moves},
          {"edge_removals", stats.edge_removals},
          {"face_flips", stats.face_flips},
          {"contractions", stats.contractions},
          {"insertions", stats.insertions},
          {"surface_flips", stats.surface_flips},
          {"edge_splits", stats.edge_splits},
          {"shifted_vertices", stats.shifted_vertices},
          {"max_vertex_shift_mm", stats.max_vertex_shift_mm},
          {"dihedral_before", stats.before},
          {"dihedral_after", stats.after}};
}

void to_json(Json& json, const SecondOrderStats& stats) {
  json = {{"mid_nodes", stats.mid_nodes},
          {"moved", stats.moved},
          {"held_back", stats.held_back},
          {"max_shift_mm", stats.max_shift_mm},
          {"least_jacobian", stats.least_jacobian}};
}

void to_json(Json& json, const SplitContactsStats& stats) {
  json = {{"facets_cut", stats.facets_cut},
          {"nodes_added", stats.nodes_added},
          {"node_pairs", stats.node_pairs}};
}

void to_json(Json& json, const SamplingSummary& summary) {
  json = {{"file", summary.file},
          {"min_mean", summary.min_mean},
          {"max_mean", summary.max_mean},
          {"bins", summary.bins}};
}

void to_json(Json& json, const ParticleCounts& counts) {
  json = {{"total", counts.total},         {"corners", counts.corners},
          {"on_curves", counts.on_curves}, {"on_interfaces", counts.on_interfaces},
          {"guards", counts.guards},       {"guards_of_specks", counts.guards_of_specks}};
}

void to_json(Json& json, const MeshCounts& counts) {
  json = {{"points", counts.points},
          {"surface_vertices", counts.surface_vertices},
          {"surface_triangles", counts.surface_triangles},
          {"wall_triangles", counts.wall_triangles},
          {"interior_points", counts.interior_points},
          {"tets", counts.tets}};
}

void to_json(Json& json, const Distribution& d) {
  json = {{"count", d.count},
          {"min", d.min},
          {"max", d.max},
          {"mean", d.mean},
          {"standard_deviation", d.standard_deviation},
          {"p1", d.p1},
          {"p5", d.p5},
          {"p25", d.p25},
          {"p50", d.p50},
          {"p75", d.p75},
          {"p95", d.p95},
          {"p99", d.p99}};
}

void to_json(Json& json, const TetQuality& quality) {
  json = {{"radius_ratio", quality.radius_ratio},
          {"scaled_jacobian", quality.scaled_jacobian},
          {"min_dihedral_deg", quality.min_dihedral_deg},
          {"max_dihedral_deg", quality.max_dihedral_deg},
          {"dihedral_histogram_10_deg", quality.dihedral_histogram},
          {"below_5_deg", quality.below_5_deg},
          {"below_10_deg", quality.below_10_deg},
          {"below_20_deg", quality.below_20_deg},
          {"above_165_deg", quality.above_165_deg}};
}

void to_json(Json& json, const TriangleQuality& quality) {
  json = {{"radius_ratio", quality.radius_ratio}, {"min_angle_deg", quality.min_angle_deg}};
}

void to_json(Json& json, const MeshQuality& quality) {
  json["triangles"] = quality.triangles;
  // A run that stops at the surfaces has no tets to describe.
  if (quality.tets.radius_ratio.count > 0) json["tets"] = quality.tets;
}

void to_json(Json& json, const VolumeError& volume) {
  json = {{"voxels_mm3", volume.voxels_mm3},
          {"mesh_mm3", volume.mesh_mm3},
          {"relative_error", volume.relative_error}};
}

void to_json(Json& json, const Checks& checks) {
  json = {{"surface_is_valid", checks.surface_is_valid},
          {"surface_intersections", checks.surface_intersections},
          {"labels_are_complete", checks.labels_are_complete},
          {"topology_as_lattice14", checks.topology_as_lattice14}};
  if (checks.tets_are_valid) json["tets_are_valid"] = *checks.tets_are_valid;
  if (!checks.faults.empty()) json["faults"] = checks.faults;
}

void to_json(Json& json, const TetFaults& faults) {
  json = {{"inverted", faults.inverted},
          {"flat", faults.flat},
          {"repeated_vertex", faults.repeated_vertex},
          {"repeated_tets", faults.repeated_tets},
          {"crowded_faces", faults.crowded_faces},
          {"folded_faces", faults.folded_faces}};
}

void to_json(Json& json, const JudgedMesh& judged) {
  json = {{"file", judged.file},
          {"label_source", judged.label_source},
          {"other_elements", judged.other_elements},
          {"unused_points", judged.unused_points},
          {"tet_faults", judged.faults}};
}

void to_json(Json& json, const GateResult& gate) {
  json = {
      {"gate", gate.gate}, {"bound", gate.bound}, {"value", gate.value}, {"passed", gate.passed}};
  if (gate.label) json["label"] = *gate.label;
}

}  // namespace cvmesh
