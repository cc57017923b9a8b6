// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/surface/insert_particles.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/random_volumes.h"
#include "surface/dense_phantoms.h"
#include <algorithm>
#include <set>

using namespace cvmesh;
using dense_phantoms::DensePhantom;

namespace {

// Particles at every corner, on a share of the curve edges, and inside a share of the facets.
ParticleSet particles_on(const DensePhantom& dense, double share) {
  const CounterRandom random(4, "particles");
  ParticleSet set;
  const auto& points = dense.mesh.points;
  for (std::size_t v = 0; v < points.size(); ++v) {
    if (dense.strata.dimension[v] != 0) continue;
    Particle p{
        .position = points[v], .h_mm = 1, .dimension = 0, .stratum = static_cast<std::int32_t>(v)};
    p.carrier[0] = static_cast<std::int32_t>(v);
    set.particles.push_back(p);
  }
  for (std::size_t c = 0; c < dense.strata.curves.size(); ++c) {
    const auto& chain = dense.strata.curves[c].vertices;
    for (std::size_t n = 0; n + 1 < chain.size(); ++n) {
      const std::int32_t a = chain[n], b = chain[n + 1];
      if (random.uniform(n, c) > share) continue;
      Particle p{
          .position = {}, .h_mm = 1, .dimension = 1, .stratum = static_cast<std::int32_t>(c)};
      p.position = points[a] + random.uniform(n, c + 1000) * (points[b] - points[a]);
      p.carrier[0] = a;
      p.carrier[1] = b;
      set.particles.push_back(p);
    }
  }
  for (std::size_t f = 0; f < dense.mesh.facets.size(); ++f) {
    if (random.uniform(f, 1) > share) continue;
    const auto& v = dense.mesh.facets[f];
    double u = random.uniform(f, 2), w = random.uniform(f, 3);
    if (u + w > 1) {
      u = 1 - u;
      w = 1 - w;
    }
    Particle p{.position = {}, .h_mm = 1, .dimension = 2, .stratum = dense.strata.patch_of[f]};
    p.position =
        points[v[0]] + u * (points[v[1]] - points[v[0]]) + w * (points[v[2]] - points[v[0]]);
    p.carrier[0] = static_cast<std::int32_t>(f);
    set.particles.push_back(p);
  }
  return set;
}

// The least cosine between the normals of two facets that share an edge inside a patch.
double sharpest_fold(const MaterialSurfaces& surfaces) {
  const auto normal_of = [&](std::int32_t f) {
    const auto& [a, b, c] = surfaces.facets()[f].vertices;
    const auto& points = surfaces.points();
    return normalized(area_vector2(points[a], points[b], points[c]));
  };
  double least = 1;
  for (const auto& facet : surfaces.facets())
    for (std::size_t c = 0; facet.is_alive && c < 3; ++c) {
      std::int32_t first = -1, second = -1;
      if (surfaces.facets_of_edge(facet.vertices[c], facet.vertices[(c + 1) % 3], first, second))
        least = std::min(least, dot(normal_of(first), normal_of(second)));
    }
  return least;
}

}  // namespace

TEST_CASE(
    "insert_particles: every particle becomes a vertex, at its place and of its own but where "
    "two nearly coincide",
    "[surface][property]") {
  for (const auto& volume :
       {phantoms::ball(6), phantoms::three_material_wedge(75, 6), phantoms::four_material_corner(6),
        phantoms::box_without_background({8, 7, 6})}) {
    const DensePhantom dense = dense_phantoms::make(volume);
    for (const double share : {0.05, 0.5}) {
      CAPTURE(share);
      const ParticleSet set = particles_on(dense, share);
      const InsertParticlesResult result =
          insert_particles(MaterialSurfaces(dense.mesh, dense.material_count), dense.strata, set,
                           dense.voxel_mm, silent_context());
      const Validation validation = result.surfaces.validate();
      INFO(validation.summary());
      REQUIRE(validation.is_valid());
      dense_phantoms::require_same_topology(result.surfaces.to_interface_mesh(), dense);
      REQUIRE(result.vertex_of.size() == set.particles.size());
      const std::set<std::int32_t> distinct(result.vertex_of.begin(), result.vertex_of.end());
      CHECK(distinct.size() + result.stats.shared >= set.particles.size());
      CHECK(result.stats.shared <= set.particles.size() / 200);
      std::size_t elsewhere = 0;
      for (std::size_t p = 0; p < set.particles.size(); ++p) {
        const Vec3& at = result.surfaces.points()[result.vertex_of[p]];
        if (distance(at, set.particles[p].position) > 1e-9) ++elsewhere;
        REQUIRE(distance(at, set.particles[p].position) < dense.voxel_mm);
      }
      CHECK(elsewhere <= result.stats.off_position + result.stats.shared);
      // particles on the dense surface itself: only crowding can keep one from its place
      CHECK(result.stats.off_position <= set.particles.size() / 20);
      CHECK(result.stats.snapped + result.stats.edge_splits + result.stats.facet_splits +
                result.stats.shared ==
            set.particles.size());
    }
  }
}

TEST_CASE(
    "insert_particles: particles that crowd at the end of an edge make no edge shorter than a "
    "hundredth of a voxel",
    "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::three_material_wedge(75, 6));
  const auto& points = dense.mesh.points;
  const auto& chain = dense.strata.curves.front().vertices;
  REQUIRE(chain.size() > 3);
  const std::int32_t a = chain[1], b = chain[2];
  ParticleSet set;
  for (int n = 0; n < 12; ++n) {
    Particle p{.position = points[a] + 1e-4 * n * (points[b] - points[a]),
               .h_mm = 1,
               .dimension = 1,
               .stratum = 0};
    p.carrier[0] = a;
    p.carrier[1] = b;
    set.particles.push_back(p);
  }
  const InsertParticlesResult result =
      insert_particles(MaterialSurfaces(dense.mesh, dense.material_count), dense.strata, set,
                       dense.voxel_mm, silent_context());
  CHECK(result.stats.shared > 0);
  CHECK(result.surfaces.validate().is_valid());
  const InterfaceMesh mesh = result.surfaces.to_interface_mesh();
  double shortest = 1e300;
  for (const auto& f : mesh.facets)
    for (std::size_t k = 0; k < 3; ++k)
      shortest =
          std::min(shortest, distance(mesh.points[static_cast<std::size_t>(f[k])],
                                      mesh.points[static_cast<std::size_t>(f[(k + 1) % 3])]));
  // The dense surface has shorter edges of its own where a cut is at a voxel's corner.
  double dense_shortest = 1e300;
  for (const auto& f : dense.mesh.facets)
    for (std::size_t k = 0; k < 3; ++k)
      dense_shortest =
          std::min(dense_shortest, distance(points[static_cast<std::size_t>(f[k])],
                                            points[static_cast<std::size_t>(f[(k + 1) % 3])]));
  CHECK(shortest >= std::min(dense_shortest, 0.01 * dense.voxel_mm));
}

TEST_CASE("insert_particles: moves that add up fold no facets onto each other",
          "[surface][property]") {
  constexpr double kTenDegrees = -0.985;
  // Thin parts, and a particle in every facet: all corners of many facets move.
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const DensePhantom dense = dense_phantoms::make(
        random_volumes::make(seed, random_volumes::Kind::Shells, {12, 10, 8}, 5).volume);
    const MaterialSurfaces before(dense.mesh, dense.material_count);
    const InsertParticlesResult result =
        insert_particles(MaterialSurfaces(dense.mesh, dense.material_count), dense.strata,
                         particles_on(dense, 1), dense.voxel_mm, silent_context());
    CAPTURE(seed);
    CHECK(result.surfaces.validate().is_valid());
    CHECK(sharpest_fold(result.surfaces) >= std::min(sharpest_fold(before), kTenDegrees));
  }
}

TEST_CASE("insert_particles: several particles in one needle do not nest in it",
          "[surface][unit]") {
  // A pyramid upside down, with the needle (0, 1, 2) in its flat top.
  InterfaceMesh mesh;
  mesh.points = {{0, 0, 0}, {10, 0, 0}, {9.9, 0.2, 0}, {5, -4, 0}, {5, 4, 0}, {5, 0, -5}};
  mesh.facets = {{0, 1, 2}, {0, 3, 1}, {1, 4, 2}, {0, 2, 4},
                 {3, 0, 5}, {1, 3, 5}, {4, 1, 5}, {0, 4, 5}};
  mesh.patch_of.assign(mesh.facets.size(), {{1, 0}, 0});
  ParticleSet set;
  const auto add = [&](const Vec3& position) {
    Particle p{.position = position, .h_mm = 1, .dimension = 2, .stratum = 0};
    p.carrier[0] = 0;
    set.particles.push_back(p);
  };
  for (std::size_t corner = 0; corner < 3; ++corner)
    add(mesh.points[corner]);
  for (const double x : {2., 4., 5.5, 7., 8.5})
    add({x, 0.01 * x, 0});
  const auto poorest = [](const MaterialSurfaces& surfaces) {
    double least = 1;
    for (const auto& facet : surfaces.facets()) {
      const auto& [a, b, c] = facet.vertices;
      const auto& p = surfaces.points();
      if (facet.is_alive) least = std::min(least, triangle_quality(p[a], p[b], p[c]));
    }
    return least;
  };
  MaterialSurfaces surfaces(mesh, 2);
  const double before = poorest(surfaces);
  InsertParticlesResult result =
      insert_particles(std::move(surfaces), find_strata(mesh), set, 1, silent_context());
  REQUIRE(result.surfaces.validate().is_valid());
  CHECK(result.stats.facet_splits == 0);
  const FlipEdgesResult flipped =
      flip_edges(std::move(result.surfaces), 1, FlipEdgesOptions{}, silent_context());
  REQUIRE(flipped.surfaces.validate().is_valid());
  CHECK(poorest(flipped.surfaces) >= 0.5 * before);
}
