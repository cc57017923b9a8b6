// SPDX-License-Identifier: AGPL-3.0-or-later
#include "metrics_command.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/pipeline/judge_mesh.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <iostream>

namespace cvmesh::app {

namespace {

std::string row(const std::string& name, const std::string& value) {
  return fmt::format("  {:<24} {}\n", name, value);
}

std::string yes_or_no(bool value) {
  return value ? "yes" : "no";
}

std::string distribution_row(const Distribution& d) {
  return fmt::format("mean {:.4f}, sd {:.4f}, min {:.4f}, max {:.4f}", d.mean, d.standard_deviation,
                     d.min, d.max);
}

std::string distance_rows(const char* name, const TwoSidedDistance& distance) {
  const auto direction = [](const DistanceStats& d) {
    return fmt::format("max {:.3f} to {:.3f}, p95 {:.3f}, mean {:.4f} (+- {:.4f}), rms {:.4f}",
                       d.max, d.max + d.max_error, d.p95, d.mean, d.mean_standard_error, d.rms);
  };
  return row(fmt::format("mesh to {}", name), direction(distance.mesh_to_reference)) +
         row(fmt::format("{} to mesh", name), direction(distance.reference_to_mesh));
}

std::string distance_rows(const SurfaceFidelity& fidelity) {
  const SurfaceDistance& to_labels = fidelity.to_labels.overall;
  const SurfaceDistance* const to_truth = fidelity.to_truth ? &fidelity.to_truth->overall : nullptr;
  std::string table = "  distances in voxels\n" + distance_rows("labels", to_labels.voxels);
  if (to_truth != nullptr) table += distance_rows("truth", to_truth->voxels);
  if (!to_labels.world_mm) return table;
  table += "  distances in mm of the world, as the volume is sheared\n" +
           distance_rows("labels", *to_labels.world_mm);
  if (to_truth != nullptr) table += distance_rows("truth", *to_truth->world_mm);
  return table;
}

std::string label_rows(const Report& report) {
  std::string table =
      fmt::format("\n  {:>8} {:>10} {:>14} {:>10} {:>11} {:>7} {:>9} {:>9}\n", "label", "tets",
                  "volume mm3", "error %", "components", "Euler", "manifold", "max vox");
  for (std::size_t m = 1; m < report.label_of.size(); ++m) {
    const MaterialTopology& t = report.topology[m];
    const TwoSidedDistance& d = report.distances->to_labels.of_material[m].voxels;
    table += fmt::format("  {:>8} {:>10} {:>14.6g} {:>10.3f} {:>5} of {:>2} {:>7} {:>9} {:>9.3f}\n",
                         report.label_of[m], report.mesh->tets_of[m], report.volumes[m].mesh_mm3,
                         100 * report.volumes[m].relative_error, t.mesh_components,
                         t.voxels.components, t.mesh_euler.value_or(0),
                         yes_or_no(t.mesh.is_closed_manifold), d.hausdorff_lower_bound());
  }
  return table;
}

std::string table_of(const Report& report) {
  const JudgedMesh& judged = *report.judged;
  const Checks& checks = *report.checks;
  const TetFaults& f = judged.faults;
  std::string table = fmt::format("{} against {}\n", judged.file, report.input.file);
  table += row("labels from", fmt::format("'{}'", judged.label_source));
  table += row("tets", std::to_string(report.mesh->tets));
  table += row("points", fmt::format("{}, {} unused", report.mesh->points, judged.unused_points));
  table += row("surface vertices", std::to_string(report.mesh->surface_vertices));
  table += row("surface triangles", std::to_string(report.mesh->surface_triangles));
  table += row("tets valid", yes_or_no(checks.tets_are_valid.value_or(false)));
  table += row("surface valid", yes_or_no(checks.surface_is_valid));
  table += row("surface intersections", std::to_string(checks.surface_intersections));
  table += row("all labels", yes_or_no(checks.labels_are_complete));
  table += row("topology as the voxels", yes_or_no(checks.topology_as_lattice14));
  if (!(f == TetFaults{}))
    table += row("faults of tets",
                 fmt::format("{} inverted, {} flat, {} with a repeated vertex, {} repeated; faces: "
                             "{} in more than two tets, {} folded",
                             f.inverted, f.flat, f.repeated_vertex, f.repeated_tets,
                             f.crowded_faces, f.folded_faces));
  table += row("triangles 2r/R", distribution_row(report.quality->triangles.radius_ratio));
  table += row("tets 3r/R", distribution_row(report.quality->tets.radius_ratio));
  table += row("smallest dihedral", distribution_row(report.quality->tets.min_dihedral_deg));
  table += row("largest dihedral", distribution_row(report.quality->tets.max_dihedral_deg));
  table += distance_rows(*report.distances);
  table += label_rows(report);
  for (const std::string& fault : checks.faults)
    table += fmt::format("  fault: {}\n", fault);
  return table;
}

}  // namespace

void run_metrics(const MetricsCommand& command, const StageContext& context) {
  JudgeRequest request;
  request.mesh = command.mesh;
  request.labels = command.labels;
  if (!command.truth.empty()) request.truth = command.truth;
  request.space = command.space;
  request.read = command.read;
  if (!command.params_file.empty())
    request.parameters =
        parse_parameters(read_json(command.params_file), "'" + command.params_file + "'");
  const Report report = judge_mesh(request, context);
  const nlohmann::ordered_json json = report_json(report);
  if (!command.out_file.empty()) write_json(command.out_file, json);
  using Handler = nlohmann::ordered_json::error_handler_t;
  std::cout << (command.as_json ? json.dump(2, ' ', false, Handler::replace) + "\n"
                                : table_of(report))
            << std::flush;
  require(std::cout.good(), ErrorCode::Output, "write", "standard output cannot be written");
}

}  // namespace cvmesh::app
