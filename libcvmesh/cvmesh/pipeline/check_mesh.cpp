// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/check_mesh.h"

#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/pipeline/stage_names.h"

#include <spdlog/fmt/fmt.h>

#include <functional>

namespace cvmesh {

namespace {

/// Number of solid parts of each material: closed boundary components with a positive volume
/// inside. The others are the walls of cavities.
std::vector<std::size_t> count_solids(const InterfaceMesh& mesh, std::size_t material_count) {
  std::vector<std::vector<std::int32_t>> facets_of(material_count);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    facets_of[mesh.patch_of[f].sides.inside].push_back(static_cast<std::int32_t>(f));
    facets_of[mesh.patch_of[f].sides.outside].push_back(static_cast<std::int32_t>(f));
  }
  std::vector<std::size_t> solids(material_count, 0);
  DisjointSets boundaries(mesh.points.size());
  std::vector<double> volume(mesh.points.size());
  for (std::size_t m = 1; m < material_count; ++m) {
    boundaries.reset();
    std::fill(volume.begin(), volume.end(), 0.0);
    for (const std::int32_t f : facets_of[m])
      for (int k = 1; k < 3; ++k)
        boundaries.join(mesh.facets[f][0], mesh.facets[f][k]);
    for (const std::int32_t f : facets_of[m]) {
      const auto& [a, b, c] = mesh.facets[f];
      // Relative to a vertex of the component, so that large coordinates cost no digits.
      const std::uint32_t root = boundaries.find(a);
      const double part =
          volume6(mesh.points[root], mesh.points[a], mesh.points[b], mesh.points[c]);
      volume[root] += mesh.patch_of[f].sides.inside == m ? part : -part;
    }
    for (const double v : volume)
      solids[m] += v > 0 ? 1 : 0;
  }
  return solids;
}

[[noreturn]] void fail(const std::string& message) {
  throw Error(ErrorCode::StageFailed, stage_names::kMetrics, message);
}

void check_material(const std::string& label, const MaterialTopology& t) {
  for (const bool is_mesh : {false, true}) {
    const char* where = is_mesh ? "mesh" : "dense surface";
    const BoundaryTopology& boundary = is_mesh ? t.mesh : *t.dense;
    const std::size_t components = is_mesh ? t.mesh_components : t.dense_components;
    if (boundary.components == 0)
      fail(fmt::format("{} is lost in the {}; lower r, or drop the label by drop_labels", label,
                       where));
    if (components != t.voxels.components)
      fail(
          fmt::format("{} has {} components in its voxels, but {} in the {}; lower r, or raise "
                      "min_island_voxels to remove small components",
                      label, t.voxels.components, components, where));
    if (!boundary.is_closed_manifold)
      fail(fmt::format("the boundary of {} is no closed manifold in the {}; lower epsilon or r",
                       label, where));
    if (boundary.euler != 2 * t.voxels.euler)
      fail(
          fmt::format("{} has Euler characteristic {} in its voxels, but {} in the {}; lower "
                      "epsilon or r",
                      label, t.voxels.euler, boundary.euler / 2.0, where));
  }
}

}  // namespace

std::vector<MaterialTopology> measure_topology(const LabelVolume& labels,
                                               const InterfaceMesh& dense,
                                               const InterfaceMesh& surface) {
  const std::size_t count = labels.material_count();
  const std::vector<LatticeTopology> voxels = lattice_topology(labels.ids, count);
  const std::vector<BoundaryTopology> dense_boundary = boundary_topology(dense, count);
  const std::vector<BoundaryTopology> mesh_boundary = boundary_topology(surface, count);
  const std::vector<std::size_t> dense_solids = count_solids(dense, count);
  const std::vector<std::size_t> mesh_solids = count_solids(surface, count);
  std::vector<MaterialTopology> topology(count);
  for (std::size_t m = 1; m < count; ++m)
    topology[m] = {voxels[m],       dense_boundary[m], mesh_boundary[m],
                   dense_solids[m], mesh_solids[m],    {}};
  return topology;
}

Checks check_mesh(const LabelVolume& labels,
                  const std::vector<MaterialTopology>& topology,
                  const InterfaceMesh& surface,
                  const TetMesh* tets,
                  const MeshNames& names) {
  Checks checks;
  for (std::size_t m = 1; m < labels.material_count(); ++m)
    check_material(names.material(static_cast<MaterialId>(m)), topology[m]);
  checks.labels_are_complete = checks.topology_as_lattice14 = true;

  const Validation surface_state = validate(surface, labels.material_count(), names);
  if (!surface_state.is_valid()) fail("the surface is not valid: " + surface_state.summary());
  checks.surface_is_valid = true;
  checks.surface_intersections = find_intersections(surface).size();
  if (checks.surface_intersections > 0)
    fail(fmt::format("{} pairs of surface facets intersect; lower epsilon",
                     checks.surface_intersections));
  if (tets != nullptr) {
    const Validation tet_state = validate(*tets, labels.material_count(), names);
    if (!tet_state.is_valid()) fail("the tets are not valid: " + tet_state.summary());
    checks.tets_are_valid = true;
  }
  return checks;
}

Checks inspect_mesh(const LabelVolume& labels,
                    const std::vector<MaterialTopology>& topology,
                    const InterfaceMesh& surface,
                    const TetMesh* tets) {
  Checks checks;
  checks.labels_are_complete = checks.topology_as_lattice14 = true;
  for (std::size_t m = 1; m < labels.material_count(); ++m) {
    const MaterialTopology& t = topology[m];
    if (t.mesh_components != t.voxels.components) checks.labels_are_complete = false;
    if (!topology_fault(t).empty()) checks.topology_as_lattice14 = false;
  }
  checks.surface_is_valid = validate(surface, labels.material_count()).is_valid();
  checks.surface_intersections = find_intersections(surface, kMostIntersections).size();
  if (tets != nullptr) checks.tets_are_valid = validate(*tets, labels.material_count()).is_valid();
  return checks;
}

std::string topology_fault(const MaterialTopology& t) {
  if (t.mesh.components == 0) return "is lost";
  std::string faults;
  const auto add = [&](const std::string& fault) {
    faults += (faults.empty() ? "" : ", ") + fault;
  };
  if (t.mesh.nonmanifold_edges > 0)
    add(fmt::format("{} edges are in more or fewer than two facets", t.mesh.nonmanifold_edges));
  if (t.mesh.nonmanifold_vertices > 0)
    add(fmt::format("it touches itself in {} vertices", t.mesh.nonmanifold_vertices));
  if (t.mesh_components != t.voxels.components)
    add(fmt::format("{} components instead of {}", t.mesh_components, t.voxels.components));
  if (t.mesh.euler != 2 * t.voxels.euler)
    add(fmt::format("Euler number of the boundary {} instead of {}", t.mesh.euler,
                    2 * t.voxels.euler));
  return faults;
}

void require_positive(const TetMesh& tets, const Affine& to_file, Space space) {
  const auto corner = [&](std::size_t t, std::size_t k) {
    return to_file(tets.points[static_cast<std::size_t>(tets.tets[t][k])]);
  };
  const double sign = to_file.determinant() < 0 ? -1 : 1;
  const std::size_t turned = deterministic_reduce(
      0, tets.tets.size(), std::size_t{0},
      [&](std::size_t t) {
        const double volume = volume6(corner(t, 0), corner(t, 1), corner(t, 2), corner(t, 3));
        return std::size_t{sign * volume > 0 ? 0U : 1U};
      },
      std::plus<>());
  require(turned == 0, ErrorCode::StageFailed, stage_names::kTetrahedra,
          fmt::format("{} tets are so flat that they turn over in {} coordinates; make the surface "
                      "finer (smaller epsilon), or use --space grid",
                      turned, space_name(space)));
}

}  // namespace cvmesh
