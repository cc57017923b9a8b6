// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/box3.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/surface/decimate.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/surface/surface_objective.h"

#include <tbb/task_arena.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include "surface/dense_phantoms.h"
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

using namespace cvmesh;
using dense_phantoms::DensePhantom;

namespace {

DecimateResult thin_out(const DensePhantom& dense,
                        const std::vector<bool>& keep,
                        const DecimateOptions& options = {},
                        std::uint64_t seed = 1) {
  return decimate(MaterialSurfaces(dense.mesh, dense.material_count), keep, dense.voxel_mm, options,
                  silent_context(seed));
}

}  // namespace

TEST_CASE("decimate: keeps topology, closedness and embedding on every phantom and seed",
          "[surface][property]") {
  for (const auto& [name, volume] : phantoms::all_small()) {
    const DensePhantom dense = dense_phantoms::make(volume);
    for (const std::uint64_t seed : {1, 2}) {
      CAPTURE(name, seed);
      const auto keep = dense_phantoms::random_choice(dense.strata, 0.06, seed);
      const DecimateResult result = thin_out(dense, keep, {}, seed);
      const Validation validation = result.surfaces.validate();
      INFO(validation.summary());
      REQUIRE(validation.is_valid());
      dense_phantoms::require_same_topology(result.surfaces.to_interface_mesh(), dense);
      // what is left: the chosen vertices and those that the statistics name
      const auto chosen = static_cast<std::size_t>(std::count(keep.begin(), keep.end(), true));
      REQUIRE(result.surfaces.vertex_count() == chosen + result.stats.kept.size());
      // Nothing is left of what was removed, but for a sample on one facet.
      std::size_t samples = 0;
      for (std::size_t f = 0; f < result.surfaces.facets().size(); ++f) {
        REQUIRE(result.surfaces.facets()[f].is_alive);
        samples += result.surfaces.samples_of(static_cast<std::int32_t>(f)).size();
      }
      CHECK(samples == result.stats.removed);
      for (std::size_t m = 0; m < result.surfaces.material_count(); ++m)
        CHECK(!result.surfaces.mesh(static_cast<MaterialId>(m)).has_garbage());
    }
  }
}

TEST_CASE("decimate: every single removal keeps every invariant", "[surface][property]") {
  for (const auto& volume : {phantoms::three_material_wedge(100, 3), phantoms::torus(3, 1.3)}) {
    const DensePhantom dense = dense_phantoms::make(volume);
    MaterialSurfaces surfaces(dense.mesh, dense.material_count);
    // one vertex after the other, in a fixed order that jumps about
    const std::size_t n = dense.mesh.points.size(), step = 377;
    REQUIRE(std::gcd(n, step) == 1);
    std::size_t removed = 0, kept = 0;
    for (std::size_t k = 0; k < n; ++k) {
      std::vector<bool> keep(n, true);
      keep[k * step % n] = false;
      DecimateResult result =
          decimate(std::move(surfaces), keep, dense.voxel_mm, {}, silent_context());
      removed += result.stats.removed;
      kept += result.stats.kept.size();
      surfaces = std::move(result.surfaces);
      const Validation validation = surfaces.validate();
      INFO(validation.summary());
      REQUIRE(validation.is_valid());
      dense_phantoms::require_same_topology(surfaces.to_interface_mesh(), dense);
    }
    CHECK(removed + kept == n);
    // corners, and the few vertices that hold the topology
    CHECK(20 * kept < n);
  }
}

TEST_CASE("decimate: a ball keeps only its chosen vertices and stays near the dense surface",
          "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::ball(10));
  const DecimateResult result =
      thin_out(dense, dense_phantoms::random_choice(dense.strata, 0.05, 3));
  CHECK(result.stats.kept.empty());
  const InterfaceMesh sparse = result.surfaces.to_interface_mesh();
  // Chosen at random, 5 % of about 3,000 vertices are up to 6 voxels apart; a chord of that length
  // on a radius of 10 is 0.46 voxel deep.
  Box3 box;
  for (const Vec3& p : dense.mesh.points)
    box.add(p);
  for (const auto& facet : sparse.facets) {
    const Vec3 middle =
        (sparse.points[facet[0]] + sparse.points[facet[1]] + sparse.points[facet[2]]) / 3;
    const double r = distance(middle, 0.5 * (box.lo + box.hi));
    CHECK(r > 8.2);
    CHECK(r < 10.6);
  }
}

TEST_CASE("decimate: on_degenerate fail names the way out", "[surface][unit]") {
  // Nothing but two vertices of a ball is to stay: no closed surface has so few.
  const DensePhantom dense = dense_phantoms::make(phantoms::ball(4));
  std::vector<bool> keep(dense.mesh.points.size(), false);
  keep[0] = keep[keep.size() / 2] = true;
  CHECK_THROWS_WITH(
      thin_out(dense, keep, {.on_degenerate = OnDegenerate::Fail}),
      Catch::Contains("degenerate vertex distribution") && Catch::Contains("lower epsilon"));
  const DecimateResult result = thin_out(dense, keep);
  CHECK(result.surfaces.vertex_count() >= 4);
  CHECK(result.stats.kept.size() == result.surfaces.vertex_count() - 2);
  dense_phantoms::require_same_topology(result.surfaces.to_interface_mesh(), dense);
}

TEST_CASE("decimate: a thin curved shell sampled far too sparsely never intersects itself",
          "[surface][property]") {
  // The paper's Fig. 7.9: chords across the shell would cross its other wall.
  const InputVolume shell =
      phantoms::sample(phantoms::frame_around({14, 14, 14}), [](const Vec3& p) {
        const double r = norm(p);
        return Label{r < 12 && r > 10.2 && p.z > -4 ? 1 : 0};
      });
  const DensePhantom dense = dense_phantoms::make(shell);
  const DecimateResult result =
      thin_out(dense, dense_phantoms::random_choice(dense.strata, 0.004, 1));
  dense_phantoms::require_same_topology(result.surfaces.to_interface_mesh(), dense);
  CHECK_FALSE(result.stats.kept.empty());
  for (const KeptVertex& kept : result.stats.kept)
    CHECK_FALSE(kept.reason.empty());
}

TEST_CASE("decimate: equal seeds give equal meshes, other seeds other meshes",
          "[surface][determinism]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::three_material_wedge(80, 8));
  const auto keep = dense_phantoms::random_choice(dense.strata, 0.05, 1);
  const InterfaceMesh a = thin_out(dense, keep).surfaces.to_interface_mesh();
  const InterfaceMesh b = thin_out(dense, keep).surfaces.to_interface_mesh();
  const InterfaceMesh c = thin_out(dense, keep, {}, 2).surfaces.to_interface_mesh();
  CHECK(a.points == b.points);
  CHECK(a.facets == b.facets);
  CHECK(a.facets != c.facets);
}

TEST_CASE("flip_edges: surfaces that nothing was removed from have no samples", "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::ball(4));
  // so small a tolerance that every facet is long enough to bridge something
  const auto flipped = flip_edges(MaterialSurfaces(dense.mesh, dense.material_count),
                                  dense.voxel_mm, {.deviation_vox = 0.001}, silent_context());
  dense_phantoms::require_same_topology(flipped.surfaces.to_interface_mesh(), dense);
}

TEST_CASE("decimate, flip_edges: the number of threads changes no byte", "[surface][determinism]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::three_material_wedge(80, 12));
  const auto keep = dense_phantoms::random_choice(dense.strata, 0.05, 1);
  const auto with = [&](int threads) {
    InterfaceMesh mesh;
    tbb::task_arena(threads).execute([&] {
      auto flipped =
          flip_edges(thin_out(dense, keep).surfaces, dense.voxel_mm, {}, silent_context());
      mesh = flipped.surfaces.to_interface_mesh();
    });
    return mesh;
  };
  const InterfaceMesh one = with(1), four = with(4);
  CHECK(one.points == four.points);
  CHECK(one.facets == four.facets);
  CHECK(one.patch_of == four.patch_of);
}

TEST_CASE("SurfaceObjective: a facet that bridges a gap is far from the samples",
          "[surface][unit]") {
  // a valley 6 deep and 8 wide, sampled at distance 1, and a lid over it
  const SurfaceObjective objective{0.25};
  std::vector<Vec3> samples;
  for (int x = -8; x <= 8; ++x)
    for (int y = -8; y <= 8; ++y)
      samples.push_back({double(x), double(y), std::abs(x) < 4 ? -6 + 1.5 * std::abs(x) : 0.0});
  const auto nearest = [&](const Vec3& p) {
    double least = squared_norm(samples.front() - p);
    for (const Vec3& sample : samples)
      least = std::min(least, squared_norm(sample - p));
    return least;
  };
  CHECK(objective.bridge_mm({-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, nearest, 1) > 2);
  CHECK(objective.bridge_mm({0, -4, -6}, {4, 0, 0}, {0, 4, -6}, nearest, 1) == 0);
  // too short to bridge anything that matters
  CHECK(objective.bridge_mm({0, 0, 9}, {1, 0, 9}, {0, 1, 9}, nearest, 1) == 0);
}

TEST_CASE("flip_edges: what is flat as a line becomes less so step by step", "[surface][unit]") {
  // A pyramid upside down; in its flat top two facets on edge 0-1, one flat as a line. A flip of
  // that edge leaves facets poorer than flips may make of good ones.
  InterfaceMesh mesh;
  mesh.points = {{0, 0, 0},  {10, 0, 0}, {4, 1e-5, 0}, {5, -2e-3, 0},
                 {5, -4, 0}, {5, 4, 0},  {5, 0, -5}};
  mesh.facets = {{0, 1, 2}, {1, 0, 3}, {2, 1, 5}, {0, 2, 5}, {3, 0, 4},
                 {1, 3, 4}, {4, 0, 6}, {1, 4, 6}, {5, 1, 6}, {0, 5, 6}};
  mesh.patch_of.assign(mesh.facets.size(), {{1, 0}, 0});
  const auto flipped = flip_edges(MaterialSurfaces(mesh, 2), 1, {}, silent_context());
  REQUIRE(flipped.surfaces.validate().is_valid());
  const InterfaceMesh after = flipped.surfaces.to_interface_mesh();
  for (const auto& [a, b, c] : after.facets)
    CHECK(triangle_quality(after.points[static_cast<std::size_t>(a)],
                           after.points[static_cast<std::size_t>(b)],
                           after.points[static_cast<std::size_t>(c)]) > 0.1);
}

TEST_CASE("flip_edges: keeps every invariant and leaves nothing to gain", "[surface][property]") {
  for (const auto& volume : {phantoms::ball(8), phantoms::three_material_wedge(75, 8),
                             phantoms::torus(9, 3), phantoms::box_without_background()}) {
    const DensePhantom dense = dense_phantoms::make(volume);
    auto thinned = thin_out(dense, dense_phantoms::random_choice(dense.strata, 0.06, 1));
    const FlipEdgesOptions options{.max_passes = 100};
    auto flipped =
        flip_edges(std::move(thinned.surfaces), dense.voxel_mm, options, silent_context());
    CHECK(flipped.stats.passes < options.max_passes);
    REQUIRE(flipped.surfaces.validate().is_valid());
    dense_phantoms::require_same_topology(flipped.surfaces.to_interface_mesh(), dense);
    const auto again =
        flip_edges(std::move(flipped.surfaces), dense.voxel_mm, options, silent_context());
    CHECK(again.stats.flips == 0);
  }
}
