// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/mesh_counts.h"
#include "cvmesh/metrics/tet_quality.h"
#include "cvmesh/metrics/volume_error.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

using namespace cvmesh;

namespace {

constexpr double kExact = 1e-12;
const double kRegularDihedral = std::acos(1.0 / 3) * 180 / std::numbers::pi;

}  // namespace

TEST_CASE("tet_shape: a regular tet is 1, 1 and acos(1/3) at every edge", "[metrics][unit]") {
  // Alternate corners of a cube, far from the origin and not of unit size.
  const Vec3 o{100, -50, 7};
  const TetShape shape = tet_shape(o, o + Vec3{3, 3, 0}, o + Vec3{0, 3, 3}, o + Vec3{3, 0, 3});
  CHECK(shape.radius_ratio == Approx(1).epsilon(kExact));
  CHECK(shape.scaled_jacobian == Approx(1).epsilon(kExact));
  for (const double angle : shape.dihedral_deg)
    CHECK(angle == Approx(kRegularDihedral));
}

TEST_CASE("tet_shape: the corner of a cube has its known angles and ratios", "[metrics][unit]") {
  const TetShape shape = tet_shape({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  // r = 1 / (3 + sqrt 3), R = sqrt(3) / 2.
  CHECK(shape.radius_ratio == Approx(3 / (3 + std::sqrt(3.0)) / (std::sqrt(3.0) / 2)));
  // Three edges meet at right angles; at (1,0,0) the lengths are 1, sqrt 2, sqrt 2.
  CHECK(shape.scaled_jacobian == Approx(std::sqrt(2.0) / 2));
  const double slanted = std::acos(1 / std::sqrt(3.0)) * 180 / std::numbers::pi;
  for (const int right : {0, 1, 2})
    CHECK(shape.dihedral_deg[right] == Approx(90));
  for (const int other : {3, 4, 5})
    CHECK(shape.dihedral_deg[other] == Approx(slanted));
}

TEST_CASE("tet_shape: flat and inverted tets score zero and below", "[metrics][unit]") {
  const TetShape flat = tet_shape({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0});
  CHECK(flat.radius_ratio == 0);
  CHECK(flat.scaled_jacobian == 0);
  const TetShape inverted = tet_shape({0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1});
  CHECK(inverted.radius_ratio == 0);
  CHECK(inverted.scaled_jacobian == Approx(-std::sqrt(2.0) / 2));
  CHECK(tet_shape({}, {}, {}, {}).radius_ratio == 0);
}

TEST_CASE("describe: percentiles, mean and deviation of 0..999 in any order", "[metrics][unit]") {
  std::vector<double> values(1000);
  std::iota(values.begin(), values.end(), 0.0);
  const Distribution forward = describe(values);
  std::reverse(values.begin(), values.end());
  const Distribution backward = describe(values);
  CHECK(forward.count == 1000);
  CHECK(forward.min == 0);
  CHECK(forward.max == 999);
  CHECK(forward.mean == Approx(499.5).epsilon(kExact));
  CHECK(forward.standard_deviation == Approx(std::sqrt((1e6 - 1) / 12)).epsilon(kExact));
  CHECK(forward.p1 == 10);
  CHECK(forward.p5 == 50);
  CHECK(forward.p25 == 250);
  CHECK(forward.p50 == 500);
  CHECK(forward.p75 == 750);
  CHECK(forward.p95 == 950);
  CHECK(forward.p99 == 990);
  CHECK(backward.mean == forward.mean);
  CHECK(backward.standard_deviation == forward.standard_deviation);
  CHECK(describe({}).count == 0);
  CHECK(describe({3}).p99 == 3);
}

TEST_CASE("measure_quality: tets and facets are counted overall and per material",
          "[metrics][unit]") {
  const TetMesh cube = simple_meshes::two_material_cube();
  const MeshQuality quality = measure_quality(cube, 3);
  CHECK(quality.tets.radius_ratio.count == 6);
  CHECK(quality.tets_of[0].radius_ratio.count == 0);
  CHECK(quality.tets_of[1].radius_ratio.count == 3);
  CHECK(quality.tets_of[2].radius_ratio.count == 3);
  // All six tets are congruent: angles 45, 45, 60, 90, 90, 90.
  CHECK(quality.tets.min_dihedral_deg.min == Approx(45));
  CHECK(quality.tets.min_dihedral_deg.max == Approx(45));
  CHECK(quality.tets.max_dihedral_deg.max == Approx(90));
  CHECK(quality.tets.below_20_deg == 0);
  CHECK(quality.tets.above_165_deg == 0);
  CHECK(std::accumulate(quality.tets.dihedral_histogram.begin(),
                        quality.tets.dihedral_histogram.end(), std::size_t{0}) == 36);
  CHECK(quality.tets.dihedral_histogram[4] == 12);
  // 12 facets outside, two between the materials, which count for both.
  CHECK(quality.triangles.radius_ratio.count == 14);
  CHECK(quality.triangles_of[0].radius_ratio.count == 0);
  CHECK(quality.triangles_of[1].radius_ratio.count == 8);
  CHECK(quality.triangles_of[2].radius_ratio.count == 8);
  // Half a square: 2r/R = 2 (sqrt 2 - 1).
  CHECK(quality.triangles.radius_ratio.max == Approx(2 * (std::sqrt(2.0) - 1)));
  CHECK(quality.triangles.min_angle_deg.max == Approx(45));
}

TEST_CASE("measure_quality: bad tets are found in the counters", "[metrics][unit]") {
  TetMesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.01}};
  mesh.tets = {{0, 1, 2, 3}};
  mesh.material_of = {1};
  const MeshQuality quality = measure_quality(mesh, 2);
  CHECK(quality.tets.below_5_deg == 1);
  CHECK(quality.tets.below_10_deg == 1);
  CHECK(quality.tets.above_165_deg == 1);
}

TEST_CASE("count_mesh: points, facets and tets by material", "[metrics][unit]") {
  TetMesh cube = simple_meshes::two_material_cube();
  cube.points.push_back({0.5, 0.5, 0.5});  // a point that no facet uses
  cube.surface.patch_of.back().wall = 6;
  const MeshCounts counts = count_mesh(cube, 3);
  CHECK(counts.points == 9);
  CHECK(counts.surface_vertices == 8);
  CHECK(counts.interior_points == 1);
  CHECK(counts.surface_triangles == 14);
  CHECK(counts.wall_triangles == 1);
  CHECK(counts.tets == 6);
  CHECK(counts.tets_of == std::vector<std::size_t>{0, 3, 3});
  CHECK(counts.triangles_of == std::vector<std::size_t>{12, 8, 8});
}

TEST_CASE("measure_volume_error: tets against voxels, signed", "[metrics][unit]") {
  const TetMesh cube = simple_meshes::two_material_cube();
  GridFrame frame;
  frame.dims = {3, 2, 1};
  frame.spacing_mm = {0.5, 0.5, 1};
  LabelVolume labels;
  labels.ids = Grid<MaterialId>(frame);
  labels.ids.values = {1, 1, 1, 1, 2, 0};
  labels.label_of = {0, 5, 9, 12};
  const std::vector<VolumeError> errors = measure_volume_error(cube, labels);
  REQUIRE(errors.size() == 4);
  CHECK(errors[1].voxels_mm3 == Approx(1));
  CHECK(errors[1].mesh_mm3 == Approx(0.5));
  CHECK(errors[1].relative_error == Approx(-0.5));
  CHECK(errors[2].voxels_mm3 == Approx(0.25));
  CHECK(errors[2].relative_error == Approx(1));
  CHECK(errors[3].mesh_mm3 == 0);
  CHECK(errors[3].relative_error == 0);
}
