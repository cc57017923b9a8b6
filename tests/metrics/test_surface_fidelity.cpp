// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/mesh/shape_tree.h"
#include "cvmesh/metrics/surface_fidelity.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include <cmath>
#include <limits>

using namespace cvmesh;

namespace {

GridFrame frame_of(const Vec3& spacing) {
  GridFrame frame;
  frame.dims = {32, 32, 32};
  frame.spacing_mm = spacing;
  return frame;
}

Grid<MaterialId> ids_of(const InputVolume& volume) {
  Grid<MaterialId> ids(volume.frame);
  for (std::size_t i = 0; i < ids.values.size(); ++i) {
    ids.values[i] = static_cast<MaterialId>(volume.values[i]);
  }
  return ids;
}

void check_all(const DistanceStats& stats, double expected) {
  constexpr double kFloat = 1e-6;  // distances are kept as floats
  CHECK(stats.max == Approx(expected).margin(kFloat));
  CHECK(stats.p95 == Approx(expected).margin(kFloat));
  CHECK(stats.mean == Approx(expected).margin(kFloat));
  CHECK(stats.rms == Approx(expected).margin(kFloat));
}

/// The largest distance from the facets of some sides to those of the same, on a grid of points in
/// every facet, 20 steps along a side.
template <typename IsWanted>
double brute_force(const InterfaceMesh& from, const InterfaceMesh& to, const IsWanted& is_wanted) {
  constexpr int kSide = 20;
  double largest = 0;
  for (std::size_t f = 0; f < from.facets.size(); ++f) {
    if (!is_wanted(from.patch_of[f].sides)) continue;
    const auto& [i, j, k] = from.facets[f];
    for (int u = 0; u <= kSide; ++u)
      for (int v = 0; u + v <= kSide; ++v) {
        const Vec3 p = from.points[i] + (u / double(kSide)) * (from.points[j] - from.points[i]) +
                       (v / double(kSide)) * (from.points[k] - from.points[i]);
        double nearest = std::numeric_limits<double>::infinity();
        for (std::size_t g = 0; g < to.facets.size(); ++g) {
          if (!is_wanted(to.patch_of[g].sides)) continue;
          const auto& [x, y, z] = to.facets[g];
          nearest = std::min(nearest, distance(p, nearest_on_triangle(p, to.points[x], to.points[y],
                                                                      to.points[z])));
        }
        largest = std::max(largest, nearest);
      }
  }
  return largest;
}

}  // namespace

TEST_CASE("measure_distances: parallel squares are at their distance everywhere",
          "[metrics][unit]") {
  const Vec3 spacing{0.5, 2, 0.25};
  const SurfaceDistances d = measure_distances(
      simple_meshes::square(4, 0), simple_meshes::square(4, 0.75), frame_of(spacing), 2, {});
  check_all(d.overall.mm.mesh_to_reference, 0.75);
  check_all(d.overall.mm.reference_to_mesh, 0.75);
  // Index space divides each axis by its own spacing: along z, 0.75 mm are three voxels.
  check_all(d.overall.voxels.mesh_to_reference, 3);
  check_all(d.of_material[1].voxels.reference_to_mesh, 3);
  CHECK(d.overall.mm.hausdorff_lower_bound() == Approx(0.75));
  CHECK(d.overall.mm.mean_symmetric() == Approx(0.75));
  CHECK(d.overall.mm.rms_symmetric() == Approx(0.75));
  CHECK(d.of_material[0].mm.mesh_to_reference.samples == 0);
  // 4 mm x 4 mm are 8 x 2 voxels: at least twenty samples on each square voxel.
  CHECK(d.overall.mm.mesh_to_reference.samples >= 20 * 16);
}

TEST_CASE("measure_distances: the nearest point is found anew in index space", "[metrics][unit]") {
  // From the origin's square, another square 1 mm above (10 voxels) and one 3 mm aside (1 voxel).
  InterfaceMesh above = simple_meshes::square(0.001, 1);
  InterfaceMesh aside = simple_meshes::square(0.001, 0);
  for (Vec3& p : aside.points)
    p.x += 3;
  const SurfaceDistances d =
      measure_distances(simple_meshes::square(0.001, 0), simple_meshes::together(above, aside),
                        frame_of({3, 3, 0.1}), 2, {});
  CHECK(d.overall.mm.mesh_to_reference.mean == Approx(1).epsilon(1e-3));
  CHECK(d.overall.voxels.mesh_to_reference.mean == Approx(1).epsilon(1e-3));
  CHECK(d.overall.mm.reference_to_mesh.max == Approx(3).epsilon(1e-3));
  CHECK(d.overall.voxels.reference_to_mesh.max == Approx(10).epsilon(1e-3));
}

TEST_CASE("measure_distances: the directions differ where one surface is larger",
          "[metrics][unit]") {
  const SurfaceDistances d = measure_distances(
      simple_meshes::square(1, 0), simple_meshes::square(2, 0), frame_of({0.1, 0.1, 0.1}), 2, {});
  check_all(d.overall.mm.mesh_to_reference, 0);
  // The far corner of the larger square; the mean over the L outside, a quarter of it inside:
  // two strips with mean 1/2 and a corner square with mean (sqrt 2 + asinh 1) / 3.
  CHECK(d.overall.mm.reference_to_mesh.max == Approx(std::sqrt(2.0)));
  const double corner = (std::sqrt(2.0) + std::asinh(1.0)) / 3;
  CHECK(d.overall.mm.reference_to_mesh.mean == Approx((1 + corner) / 4).epsilon(5e-3));
  CHECK(d.overall.mm.hausdorff_lower_bound() == Approx(std::sqrt(2.0)));
}

TEST_CASE("measure_distances: concentric and shifted spheres", "[metrics][unit]") {
  const InterfaceMesh sphere = simple_meshes::sphere({16, 16, 16}, 10, 4);
  const GridFrame frame = frame_of({1, 1, 1});
  // Chords of 0.7 keep within 0.01 of the sphere.
  const SurfaceDistances larger =
      measure_distances(simple_meshes::sphere({16, 16, 16}, 10.5, 4), sphere, frame, 2, {});
  CHECK(larger.overall.mm.mesh_to_reference.mean == Approx(0.5).margin(0.02));
  CHECK(larger.overall.mm.reference_to_mesh.max == Approx(0.5).margin(0.02));
  const double shift = 0.4;
  const SurfaceDistances shifted =
      measure_distances(simple_meshes::sphere({16 + shift, 16, 16}, 10, 4), sphere, frame, 2, {});
  CHECK(shifted.overall.mm.hausdorff_lower_bound() == Approx(shift).margin(0.02));
  // The distance is |cos| of the angle to the shift, whose mean over a sphere is 1/2, mean square
  // 1/3 and 95th percentile 0.95.
  CHECK(shifted.overall.mm.mean_symmetric() == Approx(shift / 2).margin(0.01));
  CHECK(shifted.overall.mm.rms_symmetric() == Approx(shift / std::sqrt(3.0)).margin(0.01));
  CHECK(shifted.overall.mm.mesh_to_reference.p95 == Approx(0.95 * shift).margin(0.02));
}

namespace {

/// The z axis leans towards x: a step of 1 along it is 0.6 along x and 0.8 along z of the world.
GridFrame leaning_frame() {
  GridFrame frame = frame_of({1, 1, 1});
  frame.index_to_world.rows = {Vec3{1, 0, 0.6}, Vec3{0, 1, 0}, Vec3{0, 0, 0.8}};
  return frame;
}

InterfaceMesh moved(InterfaceMesh mesh, const Vec3& by) {
  for (Vec3& p : mesh.points)
    p += by;
  return mesh;
}

}  // namespace

TEST_CASE("measure_distances: a sheared volume is measured in the world, too", "[metrics][unit]") {
  const GridFrame frame = leaning_frame();
  const InterfaceMesh small = moved(simple_meshes::square(4, 0.75), {6, 6, 0});
  const SurfaceDistances d = measure_distances(small, simple_meshes::square(16, 0), frame, 2, {});
  check_all(d.overall.mm.mesh_to_reference, 0.75);
  // Planes that are 0.75 steps apart along the leaning axis have 0.75 * 0.8 mm between them.
  for (const SurfaceDistance* distance : {&d.overall, &d.of_material[1], &d.of_pair.at({1, 0})}) {
    REQUIRE(distance->world_mm);
    check_all(distance->world_mm->mesh_to_reference, 0.6);
    CHECK(&distance->true_mm() == &*distance->world_mm);
  }
  // The small square lies 0.45 mm farther along x than its grid coordinates say, so that the
  // corners of the large one at x = 0 are 6.45 mm away along x, and 6 along y.
  const DistanceStats& back = d.overall.world_mm->reference_to_mesh;
  CHECK(back.max == Approx(std::sqrt(6.45 * 6.45 + 6 * 6 + 0.6 * 0.6)).epsilon(1e-6));
  CHECK(back.worst_mm.x == Approx(0).margin(1e-9));  // grid mm, as everywhere
  CHECK(back.worst_mm.z == Approx(0).margin(1e-9));

  const SurfaceDistances straight = measure_distances(small, small, frame_of({1, 1, 1}), 2, {});
  CHECK_FALSE(straight.overall.world_mm);
  CHECK(&straight.overall.true_mm() == &straight.overall.mm);
}

TEST_CASE("measure_distances: the voxel faces of a sheared volume are measured in the world",
          "[metrics][unit]") {
  Grid<MaterialId> ids(leaning_frame());
  for (int k = 0; k < 16; ++k)
    for (int j = 0; j < 32; ++j)
      for (int i = 0; i < 32; ++i)
        ids(i, j, k) = 1;
  // The top of the slab lies at z = 15.5.
  const InterfaceMesh above = moved(simple_meshes::square(4, 15.5 + 0.5), {14, 14, 0});
  const SurfaceDistances d = measure_distances(above, ids, 2, {});
  check_all(d.overall.mm.mesh_to_reference, 0.5);
  check_all(d.overall.world_mm->mesh_to_reference, 0.4);
  // The slab's far corners are those at the bottom, at x and y = -0.5 or 31.5, z = -0.5: in the
  // world 16.5 * 0.6 mm to the side and 16.5 * 0.8 mm below the square's plane.
  const double x = 14 + 0.5 + 16.5 * 0.6, y = 14 + 0.5, z = 16.5 * 0.8;
  CHECK(d.overall.world_mm->reference_to_mesh.max ==
        Approx(std::sqrt(x * x + y * y + z * z)).epsilon(1e-6));
}

TEST_CASE("measure_distances: a material is measured against its own boundary only",
          "[metrics][unit]") {
  // Two spheres that changed places: all interfaces together agree, each material is 30 mm off.
  const Vec3 left{0, 0, 0}, right{30, 0, 0};
  const auto pair = [&](MaterialId a, MaterialId b) {
    return simple_meshes::together(simple_meshes::sphere(left, 5, 3, {a, 0}),
                                   simple_meshes::sphere(right, 5, 3, {b, 0}));
  };
  const SurfaceDistances d = measure_distances(pair(1, 2), pair(2, 1), frame_of({1, 1, 1}), 4, {});
  CHECK(d.overall.mm.hausdorff_lower_bound() == Approx(0).margin(1e-6));
  for (const MaterialId m : {1, 2}) {
    CHECK(d.of_material[m].mm.mesh_to_reference.max == Approx(30).margin(0.1));
    CHECK(d.of_material[m].mm.reference_to_mesh.max == Approx(30).margin(0.1));
    CHECK(d.of_material[m].mm.mesh_to_reference.samples > 0);
  }
  CHECK(d.of_material[3].mm.mesh_to_reference.samples == 0);
}

TEST_CASE("measure_distances: the raw boundary of a box is the box, its wall included",
          "[metrics][unit]") {
  // Voxels x 0..1, y 0..2, z 0..3 of material 1 fill the grid: a box from -1/2 to dims - 1/2.
  GridFrame frame;
  frame.dims = {2, 3, 4};
  frame.spacing_mm = {1, 0.5, 2};
  const Grid<MaterialId> ids(frame, 1);
  InterfaceMesh box;
  for (int c = 0; c < 8; ++c) {
    box.points.push_back(
        frame.index_to_mm({(c & 1) * 2 - 0.5, (c >> 1 & 1) * 3 - 0.5, (c >> 2) * 4 - 0.5}));
  }
  box.facets = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  box.patch_of.assign(12, {{1, 0}, 1});
  const SurfaceDistances d = measure_distances(box, ids, 2, {});
  CHECK(d.overall.voxels.hausdorff_lower_bound() == Approx(0).margin(1e-6));
  CHECK(d.overall.mm.hausdorff_lower_bound() == Approx(0).margin(1e-6));
  // 2 (2*3 + 3*4 + 2*4) = 52 faces with twenty samples each.
  CHECK(d.overall.voxels.reference_to_mesh.samples == 20 * 52);
  for (Vec3& p : box.points)
    p.z += 1;
  CHECK(measure_distances(box, ids, 2, {}).overall.mm.hausdorff_lower_bound() == Approx(1));
  CHECK(measure_distances(box, ids, 2, {}).overall.voxels.hausdorff_lower_bound() == Approx(0.5));
}

TEST_CASE("measure_distances: a sphere keeps its known distance from its staircase",
          "[metrics][unit]") {
  const InputVolume ball = phantoms::ball(20);
  const double middle = (ball.frame.dims[0] - 1) / 2.0;
  const SurfaceDistances d = measure_distances(
      simple_meshes::sphere({middle, middle, middle}, 20, 5), ids_of(ball), 2, {});
  // A staircase around a smooth surface: symmetric mean about 0.12 to 0.25, corners stick out by
  // less than a voxel's half diagonal.
  CHECK(d.overall.voxels.hausdorff_lower_bound() < std::sqrt(3.0) / 2 + 0.05);
  CHECK(d.overall.voxels.mean_symmetric() > 0.1);
  CHECK(d.overall.voxels.mean_symmetric() < 0.3);
  CHECK(d.of_material[1].voxels.mean_symmetric() == d.overall.voxels.mean_symmetric());
}

TEST_CASE("measure_surface_fidelity: both references, the same at 1 and 4 threads",
          "[metrics][determinism]") {
  LabelVolume labels;
  labels.ids = ids_of(phantoms::nested_balls(6, 10, phantoms::kAnisotropic));
  labels.label_of = {0, 1, 2};
  const Vec3 middle = 0.5 * labels.frame().index_to_mm({double(labels.frame().dims[0] - 1),
                                                        double(labels.frame().dims[1] - 1),
                                                        double(labels.frame().dims[2] - 1)});
  const auto shells = [&](int levels) {
    return simple_meshes::together(simple_meshes::sphere(middle, 6, levels, {2, 1}),
                                   simple_meshes::sphere(middle, 10, levels, {2, 0}));
  };
  const InterfaceMesh dense = shells(4);
  const auto run = [&](int threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    return arena.execute([&] {
      return measure_surface_fidelity(shells(2), &dense, nullptr, labels, {}, silent_context());
    });
  };
  const SurfaceFidelity one = run(1), four = run(4);
  CHECK(one.options.samples_per_square_voxel == 20);
  const auto check_equal = [](const DistanceStats& a, const DistanceStats& b) {
    CHECK(a.max == b.max);
    CHECK(a.p95 == b.p95);
    CHECK(a.mean == b.mean);
    CHECK(a.rms == b.rms);
    CHECK(a.samples == b.samples);
    CHECK(a.max_error == b.max_error);
    CHECK(a.mean_standard_error == b.mean_standard_error);
    CHECK(a.worst_mm == b.worst_mm);
  };
  const auto check_all_equal = [&](const SurfaceDistances& a, const SurfaceDistances& b) {
    check_equal(a.overall.mm.mesh_to_reference, b.overall.mm.mesh_to_reference);
    for (const std::size_t m : {1, 2}) {
      check_equal(a.of_material[m].voxels.reference_to_mesh,
                  b.of_material[m].voxels.reference_to_mesh);
      CHECK(a.of_material[m].mm.reference_to_mesh.samples > 0);
    }
  };
  check_all_equal(*one.to_dense, *four.to_dense);
  check_all_equal(one.to_labels, four.to_labels);
  // Edges of 320 facets on radius 10 are 3.3 mm: the chord is 0.1 mm to 0.2 mm inside.
  CHECK(one.to_dense->overall.mm.hausdorff_lower_bound() < 0.3);
  CHECK(one.to_labels.overall.mm.mean_symmetric() < 0.35);
}

TEST_CASE("measure_distances: the largest distance is within the stated error of the truth",
          "[metrics][unit]") {
  // Two polyhedra around shifted centres. The largest distance from a convex surface to another is
  // at a vertex or where the nearest facet changes; a grid of points in every facet, measured
  // against every facet, misses it by less than a step.
  const InterfaceMesh a = simple_meshes::sphere({16, 16, 16}, 6, 1);
  const InterfaceMesh b = simple_meshes::sphere({16.5, 16.3, 15.8}, 5, 0);
  const auto any = [](Sides) { return true; };
  for (const double max_error : {0.05, 0.005}) {
    SurfaceFidelityOptions options;
    options.max_error_vox = max_error;
    const SurfaceDistances d = measure_distances(a, b, frame_of({1, 1, 1}), 2, options);
    const auto& [forward, back] = d.overall.voxels;
    for (const DistanceStats* stats : {&forward, &back}) {
      CHECK(stats->max_error >= 0);
      CHECK(stats->max_error <= max_error);
    }
    CHECK(brute_force(a, b, any) <= forward.max + forward.max_error + 1e-12);
    CHECK(brute_force(b, a, any) <= back.max + back.max_error + 1e-12);
    CHECK(brute_force(a, b, any) >= forward.max - 0.1);  // steps of 0.2 voxel
    CHECK(d.overall.voxels.hausdorff_upper_bound() - d.overall.voxels.hausdorff_lower_bound() <=
          max_error);
  }
}

TEST_CASE("measure_distances: the largest distance of every label and interface is bounded, too",
          "[metrics][unit]") {
  // Label 2 inside label 1, and both in the reference elsewhere: near the other interface in
  // places, so that distances to all, to a label and to an interface differ.
  const auto with_sides = [](InterfaceMesh mesh, Sides sides) {
    for (PatchKey& key : mesh.patch_of)
      key.sides = sides;
    return mesh;
  };
  const Sides outer{1, 0}, inner{2, 1};
  const InterfaceMesh a =
      simple_meshes::together(with_sides(simple_meshes::sphere({16, 16, 16}, 6, 1), outer),
                              with_sides(simple_meshes::sphere({15, 16, 16}, 4, 1), inner));
  const InterfaceMesh b =
      simple_meshes::together(with_sides(simple_meshes::sphere({16.5, 16.3, 15.8}, 6.5, 1), outer),
                              with_sides(simple_meshes::sphere({18, 16.2, 16}, 3.5, 0), inner));
  const SurfaceFidelityOptions options;
  const SurfaceDistances d = measure_distances(a, b, frame_of({1, 1, 1}), 3, options);
  const auto check = [&](const SurfaceDistance& distances, const auto& is_wanted) {
    const auto& [forward, back] = distances.voxels;
    const auto check_one = [&](const DistanceStats& stats, double brute) {
      CHECK(stats.max_error >= 0);
      CHECK(stats.max_error <= options.max_error_vox);
      CHECK(brute <= stats.max + stats.max_error + 1e-12);
      CHECK(brute >= stats.max - 0.2);  // steps of the grid are up to 0.4 voxel
    };
    check_one(forward, brute_force(a, b, is_wanted));
    check_one(back, brute_force(b, a, is_wanted));
  };
  check(d.of_pair.at(outer), [&](Sides s) { return s == outer; });
  check(d.of_pair.at(inner), [&](Sides s) { return s == inner; });
  check(d.of_material[1], [](Sides s) { return s.inside == 1 || s.outside == 1; });
  check(d.of_material[2], [](Sides s) { return s.inside == 2 || s.outside == 2; });
  check(d.overall, [](Sides) { return true; });
  CHECK(d.overall.voxels.mesh_to_reference.max < d.of_pair.at(inner).voxels.mesh_to_reference.max);
}

TEST_CASE("measure_distances: a peak between all samples is found, with its place",
          "[metrics][unit]") {
  // The reference is a square with a hole around (5.3, 4.7) that a sheet with walls of 2 mm closes:
  // the mesh is the square without the hole. Only points near the middle of the hole are far away,
  // and with one sample per facet none is taken there.
  const auto ring = [](double size) {
    const Vec3 c{5.3, 4.7, 0};
    return std::array<Vec3, 4>{c + Vec3{-size, -size, 0}, c + Vec3{size, -size, 0},
                               c + Vec3{size, size, 0}, c + Vec3{-size, size, 0}};
  };
  InterfaceMesh reference;
  for (const double size : {0.5, 5.0})
    for (const Vec3& p : ring(size))
      reference.points.push_back(p);
  for (std::int32_t k = 0; k < 4; ++k) {
    const std::int32_t next = (k + 1) % 4;
    reference.facets.push_back({k, k + 4, next + 4});
    reference.facets.push_back({k, next + 4, next});
  }
  reference.patch_of.assign(reference.facets.size(), {{1, 0}, 0});
  InterfaceMesh mesh;
  for (const Vec3& p : ring(5))
    mesh.points.push_back(p);
  mesh.facets = {{0, 1, 2}, {0, 2, 3}};
  mesh.patch_of.assign(2, {{1, 0}, 0});

  SurfaceFidelityOptions options;
  options.samples_per_square_voxel = 1e-3;
  options.max_error_vox = 1e-3;
  const DistanceStats stats = measure_distances(mesh, reference, frame_of({1, 1, 1}), 2, options)
                                  .overall.voxels.mesh_to_reference;
  CHECK(stats.max == Approx(0.5).margin(1e-3));
  CHECK(stats.max + stats.max_error >= 0.5);
  CHECK(stats.max_error <= 1e-3);
  CHECK(distance(stats.worst_mm, {5.3, 4.7, 0}) < 2e-3);
  CHECK(stats.worst_sides == Sides{1, 0});
}

TEST_CASE("measure_distances: the mean is within its stated standard error", "[metrics][unit]") {
  // Over a square, the mean distance to a plane that leans by a slope of one half is known.
  InterfaceMesh leaning = simple_meshes::square(40, 0);
  for (Vec3& p : leaning.points) {
    p = 4 * (p - Vec3{20, 20, 0}) + Vec3{20, 20, 0};
    p.z = p.x / 2;
  }
  const double cosine = 2 / std::sqrt(5.0);
  for (const double density : {1.0, 20.0}) {
    SurfaceFidelityOptions options;
    options.samples_per_square_voxel = density;
    const DistanceStats stats =
        measure_distances(simple_meshes::square(30, 0), leaning, frame_of({1, 1, 1}), 2, options)
            .overall.voxels.mesh_to_reference;
    // Distances x / 2 * cosine for x in [0, 30]: mean 7.5 cosine, standard deviation 30 / sqrt(12)
    // / 2 * cosine; the samples are as many as asked for, or a few more.
    CHECK(std::abs(stats.mean - 7.5 * cosine) <= 2 * stats.mean_standard_error);
    CHECK(stats.mean_standard_error ==
          Approx(15 / std::sqrt(12.0) * cosine / std::sqrt(double(stats.samples))).epsilon(0.05));
    CHECK(stats.p95 == Approx(0.95 * 15 * cosine).epsilon(0.01));
    CHECK(stats.max == Approx(15 * cosine));
  }
}

TEST_CASE("measure_distances: an interface is measured against the same interface only",
          "[metrics][unit]") {
  // Material 1 below a square, 2 above another one 3 mm over it, exchanged in the reference: every
  // material and every interface is 3 mm off, all together agree.
  const auto pair = [](Sides lower, Sides upper) {
    InterfaceMesh a = simple_meshes::square(4, 0), b = simple_meshes::square(4, 3);
    for (PatchKey& key : a.patch_of)
      key.sides = lower;
    for (PatchKey& key : b.patch_of)
      key.sides = upper;
    return simple_meshes::together(a, b);
  };
  const SurfaceDistances d =
      measure_distances(pair({2, 1}, {2, 0}), pair({2, 0}, {2, 1}), frame_of({1, 1, 1}), 3, {});
  CHECK(d.overall.voxels.hausdorff_upper_bound() == Approx(0).margin(1e-6));
  CHECK(d.of_material[2].voxels.hausdorff_upper_bound() == Approx(0).margin(1e-6));
  REQUIRE(d.of_pair.size() == 2);
  for (const Sides sides : {Sides{2, 0}, Sides{2, 1}}) {
    CHECK(d.of_pair.at(sides).voxels.mesh_to_reference.mean == Approx(3));
    CHECK(d.of_pair.at(sides).voxels.reference_to_mesh.max == Approx(3));
    CHECK(d.of_pair.at(sides).voxels.reference_to_mesh.worst_sides == sides);
  }
  CHECK(d.of_material[1].voxels.mesh_to_reference.mean == Approx(3));
}

TEST_CASE("measure_distances: a surface far larger than any volume is refused", "[metrics][unit]") {
  CHECK_THROWS_AS(measure_distances(simple_meshes::square(1e6, 0), simple_meshes::square(1, 0),
                                    frame_of({1, 1, 1}), 2, {}),
                  Error);
}

TEST_CASE("measure_distances: a surface far away from any volume is refused", "[metrics][unit]") {
  for (const double away : {1e15, 1e25, 1e200, std::nan("")}) {
    CAPTURE(away);
    const InterfaceMesh far = simple_meshes::square(1, away), near = simple_meshes::square(1, 0);
    CHECK_THROWS_AS(measure_distances(far, near, frame_of({1, 1, 1}), 2, {}), Error);
    CHECK_THROWS_AS(measure_distances(near, far, frame_of({1, 1, 1}), 2, {}), Error);
  }
  const auto d = measure_distances(simple_meshes::square(1, 1e7), simple_meshes::square(1, 0),
                                   frame_of({1, 1, 1}), 2, {});
  CHECK(d.overall.voxels.hausdorff_lower_bound() == Approx(1e7));
}

TEST_CASE("measure_distances: a density of zero is refused", "[metrics][unit]") {
  SurfaceFidelityOptions options;
  options.samples_per_square_voxel = 0;
  CHECK_THROWS_AS(measure_distances(simple_meshes::square(1, 0), simple_meshes::square(1, 0),
                                    frame_of({1, 1, 1}), 2, options),
                  Error);
}

namespace {

struct PointShapes {
  std::vector<Vec3> at;

  [[nodiscard]] std::size_t size() const { return at.size(); }

  [[nodiscard]] Box3 box(std::size_t i) const { return {at[i], at[i]}; }

  [[nodiscard]] double squared_distance(std::size_t i, const Vec3& p) const {
    return squared_norm(at[i] - p);
  }
};

/// Between 0 and 1.
double noise(int i) {
  return std::fmod(std::abs(std::sin(i) * 43758.5453), 1.0);
}

PointShapes random_points(int count) {
  PointShapes points;
  for (int i = 0; i < count; ++i)
    points.at.push_back({noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)});
  return points;
}

}  // namespace

TEST_CASE("ShapeTree: agrees with brute force, with any guess and any filter", "[metrics][unit]") {
  for (const int count : {0, 1, 2, 4, 5, 16, 17, 63, 300, 5000}) {
    const PointShapes points = random_points(count);
    const ShapeTree<PointShapes> tree(points);
    const auto is_odd = [](std::size_t i) { return i % 2 == 1; };
    for (int q = 0; q < 40; ++q) {
      const Vec3 p{noise(7 * q), noise(7 * q + 1) * 2, noise(7 * q + 2)};
      double best = std::numeric_limits<double>::infinity(), best_odd = best;
      for (int i = 0; i < count; ++i) {
        best = std::min(best, points.squared_distance(i, p));
        if (i % 2 == 1) best_odd = std::min(best_odd, points.squared_distance(i, p));
      }
      const auto all = [](std::size_t) { return true; };
      CHECK(tree.nearest(p, -1, all).squared_distance == best);
      if (count > 0) CHECK(tree.nearest(p, q % count, all).squared_distance == best);
      CHECK(tree.nearest(p, -1, is_odd).squared_distance == best_odd);
      // A region holds every shape within its reach of its box, and shows those within a bound of
      // any box inside, however the bound shrinks.
      constexpr double kReach = 0.25;
      const Vec3 wide{0.1, 0.1, 0.1}, narrow{0.02, 0.05, 0.03};
      ShapeTree<PointShapes>::Region region;
      tree.find_region({p - wide, p + wide}, kReach, region);
      double nearest = kReach * kReach;
      tree.for_each_near(region, {p, p}, nearest, [&](std::size_t i) {
        return nearest = std::min(nearest, points.squared_distance(i, p));
      });
      CHECK(nearest == std::min(best, kReach * kReach));
      std::vector<bool> is_seen(points.size(), false);
      tree.for_each_near(region, {p - narrow, p + narrow}, kReach * kReach, [&](std::size_t i) {
        is_seen[i] = true;
        return kReach * kReach;
      });
      for (std::size_t i = 0; i < points.size(); ++i)
        if (points.squared_distance(i, p) <= kReach * kReach) CHECK(is_seen[i]);
      const Box3 box{p - Vec3{0.2, 0.2, 0.2}, p + Vec3{0.2, 0.2, 0.2}};
      std::size_t found = 0, expected = 0;
      tree.for_each_overlap(box, [&](std::size_t) { ++found; });
      for (const Vec3& a : points.at)
        expected += box.contains(a) ? 1 : 0;
      CHECK(found == expected);
    }
  }
}

TEST_CASE("ShapeTree: marked kinds change no answer, and one that is far costs few looks",
          "[metrics][unit]") {
  for (const int count : {0, 1, 3, 4, 5, 17, 300, 5000}) {
    PointShapes points = random_points(count);
    const auto is_rare = [&](std::size_t i) { return i % 97 == 3; };
    for (std::size_t i = 0; i < points.size(); ++i)
      if (is_rare(i)) points.at[i].x += 5;
    const ShapeTree<PointShapes> plain(points);
    ShapeTree<PointShapes> marked(points);
    marked.mark_kinds([&](std::size_t i) { return is_rare(i) ? 2U : 1U; });
    for (int q = 0; q < 40; ++q) {
      const Vec3 p{noise(7 * q), noise(7 * q + 1), noise(7 * q + 2)};
      std::size_t looks = 0, marked_looks = 0;
      const auto expected = plain.nearest(p, -1, [&](std::size_t i) {
        ++looks;
        return is_rare(i);
      });
      const auto found = marked.nearest(
          p, -1,
          [&](std::size_t i) {
            ++marked_looks;
            return is_rare(i);
          },
          2);
      CHECK(found.squared_distance == expected.squared_distance);
      CHECK(found.shape == expected.shape);
      CHECK(marked_looks <= looks);
      if (count == 5000) {
        CHECK(looks >= 4900);
        CHECK(marked_looks <= 100);
      }
      const auto any = [](std::size_t) { return true; };
      CHECK(marked.nearest(p, -1, any).shape == plain.nearest(p, -1, any).shape);
    }
  }
}
