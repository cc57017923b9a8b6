// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/delaunay_tets.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

using namespace cvmesh;

namespace {

struct Scene {
  LevelSets level_sets;
  Vec3 centre;  ///< of the phantom, in grid mm
};

Scene scene_of(const InputVolume& volume) {
  const StageContext context = silent_context();
  LabelVolume labels = clean_labels(volume, {}, context).labels;
  const GridFrame frame = labels.frame();
  Scene scene;
  for (int axis = 0; axis < 3; ++axis)
    scene.centre[axis] = 0.5 * (frame.dims[axis] - 1) * frame.spacing_mm[axis];
  const auto ids = std::make_shared<const Grid<MaterialId>>(std::move(labels.ids));
  scene.level_sets = build_level_sets(ids, labels.material_count(), context).level_sets;
  return scene;
}

/// Nearly even points of a sphere (a golden spiral), off it by less than `jitter_mm` so that no
/// five lie on one sphere.
void add_sphere(const Vec3& centre, double radius, int count, double jitter_mm, ParticleSet& set) {
  const CounterRandom random(1, "test");
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int n = 0; n < count; ++n) {
    const double z = 1 - (2 * n + 1.0) / count, angle = golden * n;
    const double r = radius + jitter_mm * random.uniform(static_cast<std::uint64_t>(n));
    const double flat = std::sqrt(1 - z * z);
    set.particles.push_back(
        {.position = centre + r * Vec3{flat * std::cos(angle), flat * std::sin(angle), z}});
  }
}

double volume_of(const TetMesh& mesh, MaterialId material) {
  double volume = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    if (mesh.material_of[t] == material)
      volume += volume6(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]) / 6;
  }
  return volume;
}

}  // namespace

TEST_CASE("delaunay_tets: a dense sampling of nested balls gives their topology and volumes",
          "[tet][unit]") {
  const Scene scene = scene_of(phantoms::nested_balls(8, 14));
  ParticleSet particles;
  add_sphere(scene.centre, 14, 1500, 1e-3, particles);
  add_sphere(scene.centre, 8, 500, 1e-3, particles);
  const DelaunayTetsResult result = delaunay_tets(particles, scene.level_sets, silent_context());
  const TetMesh& mesh = result.tets;
  CHECK(result.stats.particles == 2000);
  CHECK(result.stats.unused_particles == 0);

  const auto topology = boundary_topology(mesh.surface, 3);
  CHECK(topology[1].is_closed_manifold);
  CHECK(topology[1].euler == 2);
  CHECK(topology[2].is_closed_manifold);
  CHECK(topology[2].components == 2);
  CHECK(topology[2].euler == 4);
  CHECK(topology[2].nonmanifold_edges == 0);
  const double inner = volume_of(mesh, 1), both = inner + volume_of(mesh, 2);
  const double unit = 4 * std::numbers::pi / 3;
  CHECK(inner == Approx(unit * 8 * 8 * 8).epsilon(0.03));  // a polyhedron inside of the ball
  CHECK(both == Approx(unit * 14 * 14 * 14).epsilon(0.03));
  // Every face between materials is a facet, with its materials on the right sides.
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("delaunay_tets: a sampling too coarse for a thin shell breaks its topology",
          "[tet][unit]") {
  const Scene scene = scene_of(phantoms::nested_balls(12, 14));
  const auto shell = [&](int outer, int inner) {
    ParticleSet particles;
    add_sphere(scene.centre, 14, outer, 1e-3, particles);
    add_sphere(scene.centre, 12, inner, 1e-3, particles);
    const TetMesh mesh = delaunay_tets(particles, scene.level_sets, silent_context()).tets;
    return boundary_topology(mesh.surface, 3)[2];
  };
  const BoundaryTopology dense = shell(6000, 4500);
  CHECK(dense.is_closed_manifold);
  CHECK(dense.euler == 4);
  // Edges of 12 voxels on a shell of 2: circumcentres know nothing of it.
  const BoundaryTopology coarse = shell(24, 18);
  CHECK((coarse.components != 2 || coarse.euler != 4 || !coarse.is_closed_manifold));
}

TEST_CASE("delaunay_tets: particles in any order, and twice at one place, give the same tets",
          "[tet][unit]") {
  const Scene scene = scene_of(phantoms::ball(9));
  ParticleSet particles;
  add_sphere(scene.centre, 9, 300, 1e-3, particles);
  const TetMesh mesh = delaunay_tets(particles, scene.level_sets, silent_context()).tets;
  CHECK(std::is_sorted(mesh.tets.begin(), mesh.tets.end()));
  CHECK(std::is_sorted(mesh.surface.facets.begin(), mesh.surface.facets.end()));

  ParticleSet reversed = particles;
  std::reverse(reversed.particles.begin(), reversed.particles.end());
  const TetMesh turned = delaunay_tets(reversed, scene.level_sets, silent_context()).tets;
  CHECK(turned.tets.size() == mesh.tets.size());
  CHECK(volume_of(turned, 1) == Approx(volume_of(mesh, 1)).epsilon(1e-12));

  reversed.particles.push_back(reversed.particles.front());
  const DelaunayTetsResult twice = delaunay_tets(reversed, scene.level_sets, silent_context());
  CHECK(twice.stats.particles == 300);
  CHECK(twice.tets.tets.size() == mesh.tets.size());
}

TEST_CASE("delaunay_tets: fewer than four particles, or all in one plane, give an empty mesh",
          "[tet][unit]") {
  const Scene scene = scene_of(phantoms::ball(9));
  ParticleSet particles;
  CHECK(delaunay_tets(particles, scene.level_sets, silent_context()).tets.tets.empty());
  for (int n = 0; n < 9; ++n)
    particles.particles.push_back(
        {.position = scene.centre + Vec3{1.0 * (n % 3), 1.0 * (n / 3), 0}});
  const DelaunayTetsResult flat = delaunay_tets(particles, scene.level_sets, silent_context());
  CHECK(flat.tets.tets.empty());
  CHECK(flat.stats.particles == 9);
}
