// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/judge_mesh.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/surface_reader.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/metrics/label_tets.h"
#include "cvmesh/pipeline/check_mesh.h"
#include "cvmesh/pipeline/library_versions.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/pipeline/stage_runner.h"
#include "cvmesh/pipeline/summarize_input.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>

namespace cvmesh {

namespace {

// A mesh whose box is this many times the volume's, or does not meet it, is in other coordinates.
constexpr double kLargestBox = 10;

bool has_label_0(const TetFile& file) {
  return std::find(file.label_of.begin(), file.label_of.end(), 0) != file.label_of.end();
}

std::vector<MaterialId> materials_of(const TetFile& file,
                                     const LabelVolume& labels,
                                     const std::filesystem::path& path) {
  std::map<Label, MaterialId> id_of;
  for (std::size_t m = 1; m < labels.material_count(); ++m)
    id_of[labels.label_of[m]] = static_cast<MaterialId>(m);
  std::vector<MaterialId> result(file.tets.size());
  for (std::size_t t = 0; t < result.size(); ++t) {
    const auto found = id_of.find(file.label_of[t]);
    require(found != id_of.end(), ErrorCode::BadInput, stage_names::kRead,
            fmt::format("'{}': tetrahedron {} has the label {} ({}), which is not among the labels "
                        "of the volume; give the volume that the mesh was made from, or the "
                        "parameter file that merged its labels",
                        path.string(), t, file.label_of[t], file.label_source));
    result[t] = found->second;
  }
  return result;
}

std::vector<Vec3> mapped(const std::vector<Vec3>& points, const Affine& map) {
  std::vector<Vec3> result;
  result.reserve(points.size());
  for (const Vec3& p : points)
    result.push_back(map(p));
  return result;
}

void check_place(const std::vector<Vec3>& points_mm,
                 const GridFrame& frame,
                 const std::filesystem::path& path) {
  Box3 mesh, volume;
  for (const Vec3& p : points_mm)
    mesh.add(p);
  volume.add(frame.index_to_mm({-0.5, -0.5, -0.5}));
  volume.add(frame.index_to_mm({frame.dims[0] - 0.5, frame.dims[1] - 0.5, frame.dims[2] - 0.5}));
  require(mesh.overlaps(volume) && mesh.diagonal() <= kLargestBox * volume.diagonal(),
          ErrorCode::BadInput, stage_names::kRead,
          fmt::format("'{}' does not lie in the volume (its box is {:.4g} x {:.4g} x {:.4g} mm and "
                      "starts {:.4g}, {:.4g}, {:.4g} mm from the first voxel); say its coordinates "
                      "by --space",
                      path.string(), mesh.extent().x, mesh.extent().y, mesh.extent().z, mesh.lo.x,
                      mesh.lo.y, mesh.lo.z));
}

InterfaceMesh truth_surface(const std::filesystem::path& path, const Affine& to_mm) {
  SurfaceFile file = read_surface_file(path);
  InterfaceMesh surface;
  surface.points = mapped(file.points, to_mm);
  surface.facets = std::move(file.facets);
  surface.patch_of.resize(surface.facets.size());
  return surface;
}

std::vector<MaterialTopology> topology_of(const LabelVolume& labels, const LabelledTets& tets) {
  const std::vector<LatticeTopology> voxels = lattice_topology(labels.ids, labels.material_count());
  const std::vector<BoundaryTopology> boundary =
      boundary_topology(tets.mesh.surface, labels.material_count());
  std::vector<MaterialTopology> topology(labels.material_count());
  for (std::size_t m = 1; m < topology.size(); ++m) {
    topology[m].voxels = voxels[m];
    topology[m].mesh = boundary[m];
    topology[m].mesh_components = tets.solids[m].components;
    topology[m].mesh_euler = tets.solids[m].euler;
  }
  return topology;
}

Checks check(const LabelledTets& tets,
             const std::vector<MaterialTopology>& topology,
             const MeshNames& names) {
  constexpr std::size_t kMostPairs = 1000000;
  Checks checks;
  const Validation surface = validate(tets.mesh.surface, topology.size(), names);
  const Validation solid = validate(tets.mesh, topology.size(), names);
  checks.surface_is_valid = surface.is_valid();
  checks.tets_are_valid = solid.is_valid() && tets.faults == TetFaults{};
  checks.surface_intersections = find_intersections(tets.mesh.surface, kMostPairs).size();
  checks.labels_are_complete = checks.topology_as_lattice14 = true;
  for (std::size_t m = 1; m < topology.size(); ++m) {
    const MaterialTopology& t = topology[m];
    if (t.mesh_components == 0) checks.labels_are_complete = false;
    if (t.mesh_components != t.voxels.components || t.mesh_euler != t.voxels.euler)
      checks.topology_as_lattice14 = false;
  }
  checks.faults = surface.faults;
  checks.faults.insert(checks.faults.end(), solid.faults.begin(), solid.faults.end());
  return checks;
}

}  // namespace

Report judge_mesh(const JudgeRequest& request, const StageContext& context) {
  const Timer timer;
  Report report;
  report.version = kVersion;
  report.libraries = library_versions();
  report.parameters = request.parameters;
  report.threads = static_cast<int>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  StageRunner stage(context, report);

  const TetFile file = stage.run(
      stage_names::kRead, [&] { return read_tet_file(request.mesh); },
      [](const TetFile& f) {
        return fmt::format("{} tets, {} points, labels from '{}'", f.tets.size(), f.points.size(),
                           f.label_source);
      });
  CleanLabelsOptions options = request.parameters.clean_labels;
  options.mesh_background = options.mesh_background || has_label_0(file);
  const CleanLabelsResult cleaned = stage.run(
      stage_names::kLabels,
      [&] {
        std::vector<std::string> warnings;
        const InputVolume volume = read_label_volume(request.labels, &warnings, request.read);
        for (const std::string& warning : warnings)
          context.log->warn("{}", warning);
        report.input = summarize_input(volume, request.labels);
        return clean_labels(volume, options, context);
      },
      [](const CleanLabelsResult& r) {
        return fmt::format("{} labels", r.labels.material_count() - 1);
      });
  const LabelVolume& labels = cleaned.labels;
  report.stages.labels = cleaned.stats;
  report.label_of = output_labels(labels);
  report.name_of = labels.name_of;
  const Space space = file.space.value_or(request.space.value_or(labels.frame().space));
  report.input.output_space = space;
  report.mm_to_out = mm_to_space(labels.frame(), space);
  const Affine to_mm = inverse(report.mm_to_out);

  stage.run(
      stage_names::kMetrics,
      [&] {
        const std::vector<Vec3> points_mm = mapped(file.points, to_mm);
        check_place(points_mm, labels.frame(), request.mesh);
        const LabelledTets tets =
            build_label_tets(points_mm, file.tets, materials_of(file, labels, request.mesh),
                             labels.material_count(), labels.frame());
        report.judged = JudgedMesh{.file = request.mesh.filename().string(),
                                   .label_source = file.label_source,
                                   .other_elements = file.other_elements,
                                   .unused_points = tets.unused_points,
                                   .faults = tets.faults};
        report.topology = topology_of(labels, tets);
        report.mesh = count_mesh(tets.mesh, labels.material_count());
        report.checks =
            check(tets, report.topology, names_in_messages(report, report.mm_to_out, space));
        report_progress(context, stage_names::kMetrics, 0.3);
        report.quality = measure_quality(tets.mesh, labels.material_count());
        report.volumes = measure_volume_error(tets.mesh, labels);
        report_progress(context, stage_names::kMetrics, 0.5);
        const std::optional<InterfaceMesh> truth =
            request.truth ? std::optional(truth_surface(*request.truth, to_mm)) : std::nullopt;
        report.distances = measure_surface_fidelity(tets.mesh.surface, nullptr,
                                                    truth ? &*truth : nullptr, labels, {}, context);
        return 0;
      },
      [](int) { return std::string("done"); });
  report.total_seconds = timer.seconds();
  return report;
}

}  // namespace cvmesh
