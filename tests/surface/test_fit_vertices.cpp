// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/box3.h"
#include "cvmesh/core/error.h"
#include "cvmesh/surface/decimate.h"
#include "cvmesh/surface/fit_vertices.h"

#include <tbb/task_arena.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include "surface/dense_phantoms.h"
#include <atomic>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

using namespace cvmesh;
using dense_phantoms::DensePhantom;

namespace {

MaterialSurfaces thinned(const DensePhantom& dense, double share, std::uint64_t seed = 1) {
  return decimate(MaterialSurfaces(dense.mesh, dense.material_count),
                  dense_phantoms::random_choice(dense.strata, share, seed), dense.voxel_mm, {},
                  silent_context(seed))
      .surfaces;
}

FitVerticesResult fit(MaterialSurfaces surfaces,
                      const DensePhantom& dense,
                      const FitVerticesOptions& options = {}) {
  return fit_vertices(std::move(surfaces), dense.voxel_mm, options, silent_context());
}

// What the facets of a mesh with one interface enclose.
double enclosed_mm3(const InterfaceMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.facets)
    sum += volume6(Vec3{}, mesh.points[a], mesh.points[b], mesh.points[c]) / 6;
  return std::abs(sum);
}

InputVolume thin_shell() {
  return phantoms::sample(phantoms::frame_around({14, 14, 14}), [](const Vec3& p) {
    const double r = norm(p);
    return Label{r < 12 && r > 10.2 && p.z > -4 ? 1 : 0};
  });
}

}  // namespace

TEST_CASE("fit_vertices: keeps every invariant, and no sum of squares grows",
          "[surface][property]") {
  auto volumes = phantoms::all_small();
  volumes.push_back({"thin shell", thin_shell()});
  for (const auto& [name, volume] : volumes) {
    const DensePhantom dense = dense_phantoms::make(volume);
    for (const std::uint64_t seed : {1, 2}) {
      CAPTURE(name, seed);
      MaterialSurfaces sparse = thinned(dense, 0.05, seed);
      const InterfaceMesh before = sparse.to_interface_mesh();
      const FitVerticesResult fitted = fit(std::move(sparse), dense);
      const Validation validation = fitted.surfaces.validate();
      INFO(validation.summary());
      REQUIRE(validation.is_valid());
      const InterfaceMesh after = fitted.surfaces.to_interface_mesh();
      dense_phantoms::require_same_topology(after, dense);
      REQUIRE(after.facets == before.facets);
      CHECK(fitted.stats.rms_after_mm <= fitted.stats.rms_before_mm);
      CHECK(fitted.stats.max_shift_mm <= (0.5 + 1e-9) * dense.voxel_mm);
      for (std::size_t v = 0; v < after.points.size(); ++v)
        REQUIRE(distance(after.points[v], before.points[v]) <= (0.5 + 1e-9) * dense.voxel_mm);
    }
  }
}

TEST_CASE("fit_vertices: a ball gets back the volume that its chords cut off", "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::ball(20));
  MaterialSurfaces sparse = thinned(dense, 0.03);
  const double wanted = enclosed_mm3(dense.mesh);
  const double before = enclosed_mm3(sparse.to_interface_mesh());
  const FitVerticesResult fitted = fit(std::move(sparse), dense);
  const double after = enclosed_mm3(fitted.surfaces.to_interface_mesh());
  // Facets inside the ball: all of the error has one sign.
  REQUIRE(before < 0.99 * wanted);
  CHECK(std::abs(after - wanted) < 0.25 * (wanted - before));
  CHECK(fitted.stats.rms_after_mm < 0.6 * fitted.stats.rms_before_mm);
  CHECK(fitted.stats.vertices > 0.9 * static_cast<double>(fitted.surfaces.vertex_count()));
  CHECK(fitted.stats.mean_shift_mm > 0);
}

TEST_CASE("fit_vertices: vertices on the border of the image stay", "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::box_without_background());
  const FitVerticesResult fitted = fit(thinned(dense, 0.06), dense);
  REQUIRE(fitted.stats.vertices > 0);  // others do not
  const InterfaceMesh mesh = fitted.surfaces.to_interface_mesh();
  Box3 box;
  for (const Vec3& p : dense.mesh.points)
    box.add(p);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const int wall = mesh.patch_of[f].wall;
    if (wall == 0) continue;
    const int axis = (wall - 1) / 2;
    for (const auto v : mesh.facets[f])
      REQUIRE(mesh.points[v][axis] == (wall % 2 == 1 ? box.lo : box.hi)[axis]);
  }
}

TEST_CASE("fit_vertices: a shift of 0 leaves every vertex where it is", "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::torus(9, 3));
  MaterialSurfaces sparse = thinned(dense, 0.05);
  const InterfaceMesh before = sparse.to_interface_mesh();
  const FitVerticesResult fitted = fit(std::move(sparse), dense, {.max_shift_vox = 0});
  CHECK(fitted.surfaces.to_interface_mesh().points == before.points);
  CHECK(fitted.stats.vertices == 0);
  CHECK(fitted.stats.rms_after_mm == fitted.stats.rms_before_mm);
}

TEST_CASE("fit_vertices: the number of threads changes no byte", "[surface][determinism]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::three_material_wedge(80, 12));
  const auto with = [&](int threads) {
    std::vector<Vec3> points;
    tbb::task_arena(threads).execute(
        [&] { points = fit(thinned(dense, 0.05), dense).surfaces.to_interface_mesh().points; });
    return points;
  };
  CHECK(with(1) == with(4));
}

TEST_CASE("fit_vertices: a cancel ends it with a Limit error", "[surface][unit]") {
  const DensePhantom dense = dense_phantoms::make(phantoms::ball(6));
  MaterialSurfaces sparse = thinned(dense, 0.1);
  const std::atomic<bool> cancel = true;
  StageContext context = silent_context();
  context.cancel = &cancel;
  try {
    fit_vertices(std::move(sparse), dense.voxel_mm, {}, context);
    FAIL("it went on");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Limit);
  }
}
