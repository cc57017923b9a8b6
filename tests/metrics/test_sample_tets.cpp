// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/sample_tets.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "metrics/simple_meshes.h"
#include "support/catch.h"

using namespace cvmesh;

namespace {

GridFrame frame_of(const std::array<int, 3>& dims) {
  GridFrame frame;
  frame.dims = dims;
  return frame;
}

template <typename Value>
Grid<float> image_of(const std::array<int, 3>& dims, const Value& value) {
  Grid<float> image(frame_of(dims));
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        image(i, j, k) = static_cast<float>(value(Vec3{1.0 * i, 1.0 * j, 1.0 * k}));
  return image;
}

Vec3 centre(const TetMesh& mesh, std::size_t tet) {
  Vec3 sum;
  for (const std::int32_t v : mesh.tets[tet])
    sum += mesh.points[static_cast<std::size_t>(v)];
  return sum / 4;
}

double linear(const Vec3& p) {
  return 3 * p.x - 2 * p.y + 0.5 * p.z + 7;
}

/// A map with a shear, different scales and a mirror, into the middle of the image.
Affine to_image(double scale) {
  Affine map;
  map.rows = {Vec3{0.9 * scale, 0.2, 0.1}, Vec3{-0.3, -1.4 * scale, 0}, Vec3{0, 0.2, 0.7 * scale}};
  map.offset = {5, 14, 5};
  return map;
}

}  // namespace

TEST_CASE("sample_tets: a linear image is its value at the centre, for large and small tets",
          "[metrics][unit]") {
  const TetMesh mesh = simple_meshes::lattice_box(2, [](const Vec3&) -> MaterialId { return 1; });
  const Grid<float> image = image_of({24, 22, 20}, linear);
  for (const double scale : {0.01, 0.3, 1.0, 4.0}) {
    CAPTURE(scale);
    const Affine map = to_image(scale);
    const TetSamples samples = sample_tets(mesh, image, map);
    CHECK(samples.tets_outside == 0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const double expected = linear(map(centre(mesh, t)));
      CHECK(samples.mean[t] == Approx(expected).epsilon(1e-12));
      // No further off than the image changes within the tet.
      CHECK(std::abs(samples.median[t] - expected) < 3 * (3 * scale + 1));
    }
  }
}

TEST_CASE("sample_tets: mean and median of a step", "[metrics][unit]") {
  // One tet across a wall at index 10.5: the part of its volume beyond is (1/2)^3 of it.
  TetMesh mesh;
  mesh.points = {{0.5, 0, 0}, {20.5, 0, 0}, {0.5, 20, 0}, {0.5, 0, 20}};
  mesh.tets = {{0, 1, 2, 3}};
  mesh.material_of = {1};
  const Grid<float> image =
      image_of({24, 24, 24}, [](const Vec3& p) { return p.x > 10.5 ? 1000 : 0; });
  const TetSamples samples = sample_tets(mesh, image, {});
  // 29 points along the longest edge: half a step of them moves the wall by 1 / 58 of the edge, and
  // the part beyond, the cube of a half, by 3 x 2 / 58.
  CHECK(samples.mean[0] == Approx(125).epsilon(0.1));
  CHECK(samples.median[0] == 0);
}

TEST_CASE("sample_tets: points beyond the image do not count", "[metrics][unit]") {
  const TetMesh mesh = simple_meshes::lattice_box(2, [](const Vec3&) -> MaterialId { return 1; });
  const Grid<float> image = image_of({2, 3, 3}, [](const Vec3&) { return 5; });
  Affine map;
  map.offset = {-0.25, 0, 0};  // one row of cubes inside, the other beyond the last voxel's face
  map.rows[0] = {1.75, 0, 0};
  const TetSamples samples = sample_tets(mesh, image, map);
  std::size_t outside = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const bool is_outside = samples.mean[t] == 0;
    outside += is_outside ? 1 : 0;
    if (centre(mesh, t).x < 1) CHECK_FALSE(is_outside);
    if (!is_outside) CHECK(samples.mean[t] == 5);
  }
  CHECK(outside > 0);
  CHECK(samples.tets_outside == outside);
}

TEST_CASE("sample_tets: the same at any number of threads", "[metrics][determinism]") {
  const TetMesh mesh = simple_meshes::lattice_box(6, [](const Vec3&) -> MaterialId { return 1; });
  const Grid<float> image = image_of(
      {24, 22, 20}, [](const Vec3& p) { return std::sin(p.x) * p.y + std::cos(p.z * p.y); });
  const auto run = [&](int threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    return arena.execute([&] { return sample_tets(mesh, image, to_image(1.2)); });
  };
  const TetSamples one = run(1);
  for (const int threads : {2, 8}) {
    const TetSamples many = run(threads);
    CHECK(many.mean == one.mean);
    CHECK(many.median == one.median);
  }
}

TEST_CASE("bin_by_modulus: bins of equal width, each with the mean of its tets",
          "[metrics][unit]") {
  const TetMesh mesh = simple_meshes::two_material_cube();
  const std::vector<double> modulus = {100, 0, 190, 300, 310, 200};
  const auto bins = bin_by_modulus(mesh, modulus, 3, 0.25);
  // Of [100, 310] the bins begin at 100, 170 and 240; all tets are of one volume.
  REQUIRE(bins.size() == 3);
  CHECK(bins[0].tets == std::vector<std::int32_t>{0});
  CHECK(bins[1].tets == std::vector<std::int32_t>{2, 5});
  CHECK(bins[2].tets == std::vector<std::int32_t>{3, 4});
  CHECK(bins[0].modulus_mpa == Approx(100));
  CHECK(bins[1].modulus_mpa == Approx(195));
  CHECK(bins[2].modulus_mpa == Approx(305));
  CHECK(bins[2].poisson_ratio == 0.25);
  // One value: one bin; none: no bin.
  CHECK(bin_by_modulus(mesh, std::vector<double>(6, 7.0), 5, 0.3).size() == 1);
  CHECK(bin_by_modulus(mesh, std::vector<double>(6, 0.0), 5, 0.3).empty());
}
