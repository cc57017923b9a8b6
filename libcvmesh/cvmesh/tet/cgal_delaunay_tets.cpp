// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/tet/delaunay_tets.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace cvmesh {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::int32_t, Kernel>;
using CellBase =
    CGAL::Triangulation_cell_base_with_info_3<MaterialId,
                                              Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using Delaunay =
    CGAL::Delaunay_triangulation_3<Kernel,
                                   CGAL::Triangulation_data_structure_3<VertexBase, CellBase>>;

using Tet = std::array<std::int32_t, 4>;
using Facet = std::array<std::int32_t, 3>;

/// The material whose level set is largest at a point (grid mm).
MaterialId material_at(const LevelSets& level_sets, const Vec3& p) {
  const GridFrame& frame = level_sets.frame();
  const Vec3 index = frame.mm_to_index(p);
  std::array<int, 3> low{}, high{};
  for (int axis = 0; axis < 3; ++axis) {
    // Circumcentres of flat tets may lie anywhere, infinity included.
    if (!(index[axis] > -0.5 && index[axis] < frame.dims[axis] - 0.5)) return kExterior;
    low[axis] = std::max(0, static_cast<int>(std::floor(index[axis])));
    high[axis] = std::min(frame.dims[axis] - 1, static_cast<int>(std::floor(index[axis])) + 1);
  }
  // Between eight nodes only their own materials can be largest.
  const Grid<MaterialId>& labels = *level_sets.labels;
  MaterialId best = labels(low[0], low[1], low[2]);
  for (const int k : {low[2], high[2]})
    for (const int j : {low[1], high[1]})
      for (const int i : {low[0], high[0]}) {
        const MaterialId other = labels(i, j, k);
        if (other == best) continue;
        const double lead = level_sets.difference(other, best, p);
        // Ties go to the smaller material, whatever the order.
        if (lead > 0 || (lead == 0 && other < best)) best = other;
      }
  return best;
}

/// The material of every cell; infinite ones are exterior.
void assign_materials(Delaunay& delaunay, const LevelSets& level_sets) {
  std::vector<Delaunay::Cell_handle> cells;
  for (const auto cell : delaunay.all_cell_handles()) {
    cell->info() = kExterior;
    if (!delaunay.is_infinite(cell)) cells.push_back(cell);
  }
  parallel_for_each_index(0, cells.size(), [&](std::size_t c) {
    const auto centre = delaunay.dual(cells[c]);
    cells[c]->info() = material_at(level_sets, {centre.x(), centre.y(), centre.z()});
  });
}

/// Vertices turned so that the smallest comes first; the orientation stays.
Facet turned(Facet facet) {
  std::rotate(facet.begin(), std::min_element(facet.begin(), facet.end()), facet.end());
  return facet;
}

/// The same for a tet: a vertex and the opposite face, as seen from outside, are positive again.
Tet turned(const Tet& tet) {
  const auto first =
      static_cast<std::size_t>(std::min_element(tet.begin(), tet.end()) - tet.begin());
  const Facet opposite = turned(tet_face(tet, first));
  return {tet[first], opposite[0], opposite[1], opposite[2]};
}

struct Pieces {
  std::vector<std::pair<Tet, MaterialId>> tets;
  std::vector<std::pair<Facet, PatchKey>> facets;
};

/// Tets of the materials and faces between materials, in an order that the particles alone decide.
Pieces collect(const Delaunay& delaunay) {
  Pieces pieces;
  for (const auto cell : delaunay.finite_cell_handles()) {
    if (cell->info() == kExterior) continue;
    Tet tet;
    for (int k = 0; k < 4; ++k)
      tet[k] = cell->vertex(k)->info();
    pieces.tets.emplace_back(turned(tet), cell->info());
    for (int k = 0; k < 4; ++k) {
      const MaterialId other = cell->neighbor(k)->info();
      if (cell->info() <= other) continue;
      pieces.facets.emplace_back(turned(tet_face(tet, k)), PatchKey{{cell->info(), other}, 0});
    }
  }
  // A face between two materials belongs to the larger of them, so each was met once.
  std::sort(pieces.tets.begin(), pieces.tets.end());
  std::sort(pieces.facets.begin(), pieces.facets.end());
  return pieces;
}

/// New numbers of the particles: those of the surface first, then those inside; -1 for the others.
std::vector<std::int32_t> number_points(const Pieces& pieces,
                                        std::size_t particle_count,
                                        std::size_t& on_surface,
                                        std::size_t& used) {
  constexpr std::int32_t kUnused = -1, kInside = -2, kSurface = -3;
  std::vector<std::int32_t> number(particle_count, kUnused);
  for (const auto& [tet, material] : pieces.tets)
    for (const std::int32_t v : tet)
      number[v] = kInside;
  for (const auto& [facet, patch] : pieces.facets)
    for (const std::int32_t v : facet)
      number[v] = kSurface;
  std::int32_t next = 0;
  for (const std::int32_t kind : {kSurface, kInside}) {
    for (std::int32_t& n : number)
      if (n == kind) n = next++;
    if (kind == kSurface) on_surface = static_cast<std::size_t>(next);
  }
  used = static_cast<std::size_t>(next);
  return number;
}

TetMesh make_mesh(const Pieces& pieces, const ParticleSet& particles, std::size_t& used) {
  std::size_t on_surface = 0;
  const std::vector<std::int32_t> number =
      number_points(pieces, particles.particles.size(), on_surface, used);
  TetMesh mesh;
  mesh.points.resize(used);
  for (std::size_t p = 0; p < number.size(); ++p)
    if (number[p] >= 0) mesh.points[number[p]] = particles.particles[p].position;
  mesh.surface.points.assign(mesh.points.begin(),
                             mesh.points.begin() + static_cast<std::ptrdiff_t>(on_surface));
  for (auto [tet, material] : pieces.tets) {
    for (std::int32_t& v : tet)
      v = number[v];
    mesh.tets.push_back(tet);
    mesh.material_of.push_back(material);
  }
  for (auto [facet, patch] : pieces.facets) {
    for (std::int32_t& v : facet)
      v = number[v];
    mesh.surface.facets.push_back(facet);
    mesh.surface.patch_of.push_back(patch);
  }
  return mesh;
}

std::size_t count_flat(const TetMesh& mesh) {
  std::size_t flat = 0;
  for (const Tet& t : mesh.tets)
    flat += volume6(mesh.points[t[0]], mesh.points[t[1]], mesh.points[t[2]], mesh.points[t[3]]) > 0
                ? 0
                : 1;
  return flat;
}

}  // namespace

DelaunayTetsResult delaunay_tets(const ParticleSet& particles,
                                 const LevelSets& level_sets,
                                 const StageContext& context) {
  std::vector<std::pair<Kernel::Point_3, std::int32_t>> points;
  points.reserve(particles.particles.size());
  for (const Particle& particle : particles.particles) {
    const Vec3& p = particle.position;
    points.emplace_back(Kernel::Point_3(p.x, p.y, p.z), static_cast<std::int32_t>(points.size()));
  }
  // Ties of five and more particles on a sphere are broken by their coordinates, so the tets do
  // not depend on the order of insertion.
  Delaunay delaunay(points.begin(), points.end());
  report_progress(context, stage_names::kDelaunay, 0.5);

  DelaunayTetsResult result;
  result.stats.particles = delaunay.number_of_vertices();
  if (delaunay.dimension() < 3) return result;
  result.stats.delaunay_tets = delaunay.number_of_finite_cells();
  assign_materials(delaunay, level_sets);
  std::size_t used = 0;
  result.tets = make_mesh(collect(delaunay), particles, used);
  result.stats.unused_particles = result.stats.particles - used;
  result.stats.flat_tets = count_flat(result.tets);
  return result;
}

}  // namespace cvmesh
