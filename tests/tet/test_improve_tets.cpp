// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/angle_bounds.h"
#include "cvmesh/tet/cavity.h"
#include "cvmesh/tet/improve_tets.h"
#include "cvmesh/tet/open_gaps.h"
#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/refine_surface.h"
#include "cvmesh/tet/tet_score.h"
#include "cvmesh/tet/tetrahedralize.h"

#include <tbb/global_control.h>

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

const Vec3 kCentre{20, 20, 20};

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

TetMesh unimproved(const InterfaceMesh& surface, std::size_t material_count, double h) {
  find_helper();
  TetrahedralizeOptions options;
  options.improvement_passes = 0;
  return tetrahedralize(surface, material_count,
                        sizing({40, 40, 40}, [&](const Vec3&) { return h; }), options,
                        silent_context())
      .tets;
}

std::vector<double> volumes(const TetMesh& mesh, std::size_t material_count) {
  std::vector<double> sums(material_count, 0.0);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto corner = [&](std::size_t k) {
      return mesh.points[static_cast<std::size_t>(mesh.tets[t][k])];
    };
    sums[mesh.material_of[t]] += volume6(corner(0), corner(1), corner(2), corner(3)) / 6;
  }
  return sums;
}

double worst_quality(const TetMesh& mesh) {
  double worst = 1;
  for (const auto& tet : mesh.tets)
    worst = std::min(worst, min_dihedral_sine(mesh.points[static_cast<std::size_t>(tet[0])],
                                              mesh.points[static_cast<std::size_t>(tet[1])],
                                              mesh.points[static_cast<std::size_t>(tet[2])],
                                              mesh.points[static_cast<std::size_t>(tet[3])]));
  return worst;
}

/// Octahedron of six surface points around the z axis, cut into four slim tets around its long
/// axis, which lies inside.
TetMesh long_octahedron(double half_axis) {
  TetMesh mesh;
  mesh.points = {{1, 0, 0},  {0, 1, 0},          {-1, 0, 0},
                 {0, -1, 0}, {0, 0, -half_axis}, {0, 0, half_axis}};
  mesh.surface.points = mesh.points;
  for (std::int32_t i = 0; i < 4; ++i) {
    const std::int32_t j = (i + 1) % 4;
    mesh.tets.push_back({4, 5, i, j});
    mesh.material_of.push_back(1);
    mesh.surface.facets.push_back({i, j, 5});
    mesh.surface.facets.push_back({j, i, 4});
    mesh.surface.patch_of.resize(mesh.surface.facets.size(), {{1, 0}, 0});
  }
  return mesh;
}

}  // namespace

TEST_CASE("min_dihedral_sine: known tets", "[tet][unit]") {
  // Regular: all six angles are acos(1/3).
  CHECK(min_dihedral_sine({1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}) ==
        Approx(-std::sqrt(8.0) / 3));
  CHECK(min_dihedral_sine({1, 1, 1}, {-1, 1, -1}, {1, -1, -1}, {-1, -1, 1}) ==
        Approx(std::sqrt(8.0) / 3));
  // The corner of a cube: three right angles, three of acos(1/sqrt 3).
  CHECK(min_dihedral_sine({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}) ==
        Approx(std::sqrt(2.0 / 3)));
  CHECK(min_dihedral_sine({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}) == 0);
}

TEST_CASE("improve_tets: quality rises, volumes and surface stay", "[tet][unit]") {
  const InterfaceMesh surface = join(sphere(kCentre, 16, 3, {1, 0}), sphere(kCentre, 9, 3, {2, 1}));
  const TetMesh before = unimproved(surface, 3, 2.5);
  TetMesh after = before;
  const ImproveTetsStats stats = improve_tets(after, {}, silent_context());
  CHECK(worst_quality(after) > worst_quality(before));
  CHECK(stats.after.min_deg > stats.before.min_deg + 5);  // measured: + 14
  CHECK(stats.after.max_deg < stats.before.max_deg);
  CHECK(stats.after.poor <= stats.before.poor);
  CHECK(stats.edge_removals + stats.face_flips > 0);
  CHECK(stats.moves > 0);
  const auto old_volumes = volumes(before, 3), new_volumes = volumes(after, 3);
  for (std::size_t m = 1; m < 3; ++m)
    CHECK(new_volumes[m] == Approx(old_volumes[m]).epsilon(1e-10));
  CHECK(std::equal(surface.points.begin(), surface.points.end(), after.points.begin()));
  const Validation validation = validate(after, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: flat walls stay flat and covered", "[tet][unit]") {
  const InterfaceMesh surface =
      join(box({0, 0, 0}, {10, 10, 10}, 5, {1, 0}), box({10, 0, 0}, {20, 10, 10}, 5, {2, 0}));
  TetMesh mesh = unimproved(surface, 3, 2);
  const double before = worst_quality(mesh);
  improve_tets(mesh, {}, silent_context());
  CHECK(worst_quality(mesh) > before);
  const auto sums = volumes(mesh, 3);
  CHECK(sums[1] == Approx(1000).epsilon(1e-10));
  CHECK(sums[2] == Approx(1000).epsilon(1e-10));
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: a long edge is replaced by the better diagonal", "[tet][unit]") {
  TetMesh mesh = long_octahedron(4);
  const double before = worst_quality(mesh);
  const ImproveTetsStats stats = improve_tets(mesh, {}, silent_context());
  // Four tets around the long axis, each with an angle of 90 degrees there, but with sharp ones
  // along the rim, become four around a short diagonal.
  CHECK(stats.edge_removals == 1);
  CHECK(mesh.tets.size() == 4);
  CHECK(worst_quality(mesh) > before);
  for (const auto& tet : mesh.tets)
    CHECK_FALSE(
        (std::count(tet.begin(), tet.end(), 4) == 1 && std::count(tet.begin(), tet.end(), 5) == 1));
  CHECK(volumes(mesh, 2)[1] == Approx(2.0 * 4 * 2 / 3));
}

TEST_CASE("improve_tets: an inner vertex that lies badly moves to the middle", "[tet][unit]") {
  // One vertex inside an icosahedron, close to a face; without it the tets would be poorer.
  TetMesh mesh;
  mesh.surface = sphere({0, 0, 0}, 1, 0, {1, 0});
  mesh.points = mesh.surface.points;
  const auto centre = static_cast<std::int32_t>(mesh.points.size());
  mesh.points.push_back({0.3, 0.3, 0.3});
  for (const auto& facet : mesh.surface.facets) {
    mesh.tets.push_back({facet[0], facet[2], facet[1], centre});
    mesh.material_of.push_back(1);
  }
  ImproveTetsOptions options;
  options.passes = 20;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.moves > 0);
  CHECK(norm(mesh.points.back()) < 0.05);  // by symmetry the best place is the centre
  CHECK(mesh.tets.size() == 20);
}

namespace {

/// A half drum with a flat tet as its roof: the upper edge 0-1 lies `height` above the diagonal
/// 2-3, which so many tets surround that no edge removal takes it away. With `is_covered`, another
/// material lies on the two facets at the upper edge.
TetMesh flat_roof(double height, bool is_covered) {
  constexpr std::int32_t kBelow = 9;
  TetMesh mesh;
  mesh.points = {{-1.5, 0, height}, {1.5, 0, height}, {0, -1, 0}, {0, 1, 0}};
  std::vector<std::int32_t> arc{0};
  for (std::int32_t i = 1; i <= kBelow; ++i) {
    const double angle = std::numbers::pi * (1 + i / (kBelow + 1.0));
    arc.push_back(static_cast<std::int32_t>(mesh.points.size()));
    mesh.points.push_back({1.5 * std::cos(angle), 0, 1.5 * std::sin(angle)});
  }
  arc.push_back(1);
  const auto add_tet = [&](std::array<std::int32_t, 4> tet, MaterialId material) {
    const auto p = [&](std::size_t k) { return mesh.points[at(tet[k])]; };
    if (volume6(p(0), p(1), p(2), p(3)) < 0) std::swap(tet[2], tet[3]);
    mesh.tets.push_back(tet);
    mesh.material_of.push_back(material);
  };
  const auto add_facet = [&](std::array<std::int32_t, 3> facet, Sides sides) {
    mesh.surface.facets.push_back(facet);
    mesh.surface.patch_of.push_back({sides, 0});
  };
  add_tet({0, 1, 2, 3}, 1);
  if (is_covered) {
    add_facet({0, 1, 2}, {2, 1});
    add_facet({0, 3, 1}, {2, 1});
  } else {
    add_facet({0, 2, 1}, {1, 0});
    add_facet({0, 1, 3}, {1, 0});
  }
  for (std::size_t i = 0; i + 1 < arc.size(); ++i) {
    add_tet({arc[i], arc[i + 1], 2, 3}, 1);
    add_facet({arc[i], arc[i + 1], 2}, {1, 0});
    add_facet({arc[i + 1], arc[i], 3}, {1, 0});
  }
  if (is_covered) {
    const auto top = static_cast<std::int32_t>(mesh.points.size());
    mesh.points.push_back({0, 0, 1.5});
    add_tet({0, 2, 1, top}, 2);
    add_tet({0, 1, 3, top}, 2);
    for (const auto& [u, v] : {std::pair(0, 2), std::pair(2, 1), std::pair(1, 3), std::pair(3, 0)})
      add_facet({u, v, top}, {2, 0});
  }
  mesh.surface.points = mesh.points;
  return mesh;
}

bool has_edge(const InterfaceMesh& surface, std::int32_t a, std::int32_t b) {
  return std::any_of(surface.facets.begin(), surface.facets.end(), [&](const auto& f) {
    return std::count(f.begin(), f.end(), a) == 1 && std::count(f.begin(), f.end(), b) == 1;
  });
}

}  // namespace

TEST_CASE("improve_tets: a flat tet between two facets goes by a flip of their edge",
          "[tet][unit]") {
  for (const bool is_covered : {false, true}) {
    const std::size_t materials = is_covered ? 3 : 2;
    TetMesh mesh = flat_roof(0.02, is_covered);
    const Validation sound = validate(mesh, materials);
    INFO(sound.summary());
    REQUIRE(sound.is_valid());
    const double before = worst_quality(mesh);
    const auto volumes_before = volumes(mesh, materials);
    ImproveTetsOptions options;
    options.max_surface_shift_mm = 0.03;
    const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
    CHECK(stats.surface_flips == 1);
    CHECK(worst_quality(mesh) > 10 * before);
    CHECK(has_edge(mesh.surface, 2, 3));
    CHECK_FALSE(has_edge(mesh.surface, 0, 1));
    const Validation validation = validate(mesh, materials);
    INFO(validation.summary());
    CHECK(validation.is_valid());
    // What the roof held, one sixth of 3 x 2 x height, has changed sides.
    const double roof = 3 * 2 * 0.02 / 6;
    CHECK(volumes(mesh, materials)[1] == Approx(volumes_before[1] - roof));
    if (is_covered) CHECK(volumes(mesh, materials)[2] == Approx(volumes_before[2] + roof));
  }
}

TEST_CASE("improve_tets: the surface stays where it would move too far, or lies on the border",
          "[tet][unit]") {
  ImproveTetsOptions options;
  TetMesh mesh = flat_roof(0.02, true);
  CHECK(improve_tets(mesh, options, silent_context()).surface_flips == 0);
  options.max_surface_shift_mm = 0.01;
  mesh = flat_roof(0.02, true);
  CHECK(improve_tets(mesh, options, silent_context()).surface_flips == 0);
  options.max_surface_shift_mm = 0.03;
  mesh = flat_roof(0.02, false);
  for (PatchKey& patch : mesh.surface.patch_of)
    patch.wall = 6;
  CHECK(improve_tets(mesh, options, silent_context()).surface_flips == 0);
  // Two patches meet at the upper edge: it is a curve.
  mesh = flat_roof(0.02, false);
  mesh.surface.patch_of[0].wall = 1;
  CHECK(improve_tets(mesh, options, silent_context()).surface_flips == 0);
}

namespace {

/// The longest way of a point of the surface from where it was.
double longest_shift(const TetMesh& mesh, const InterfaceMesh& before) {
  double longest = 0;
  for (std::size_t v = 0; v < before.points.size(); ++v)
    longest = std::max(longest, distance(mesh.surface.points[v], before.points[v]));
  return longest;
}

/// A tet of material 2 above the flat roof, its lower facet at the given height.
void add_ceiling(TetMesh& mesh, double height) {
  const auto first = static_cast<std::int32_t>(mesh.points.size());
  for (const Vec3& p :
       {Vec3{-3, -2, height}, Vec3{3, -2, height}, Vec3{0, 4, height}, Vec3{0, 0, height + 3}})
    mesh.points.push_back(p);
  mesh.surface.points = mesh.points;
  const std::array<std::int32_t, 4> tet{first, first + 1, first + 2, first + 3};
  mesh.tets.push_back(tet);
  mesh.material_of.push_back(2);
  for (const auto& [a, b, c] : {std::array{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}) {
    mesh.surface.facets.push_back({first + a, first + b, first + c});
    mesh.surface.patch_of.push_back({{2, 0}, 0});
  }
}

}  // namespace

TEST_CASE(
    "improve_tets: vertices of the surface move where it presses a tet flat, and no farther "
    "than allowed",
    "[tet][unit]") {
  for (const double shift : {0.01, 0.5}) {
    TetMesh mesh = flat_roof(0.02, true);
    const TetMesh start = mesh;
    ImproveTetsOptions options;
    options.insert_below_deg = 0;  // here a new vertex would do, too
    options.max_vertex_shift_mm = shift;
    const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
    CHECK(stats.shifted_vertices > 0);
    CHECK(stats.after.min_deg > stats.before.min_deg);
    CHECK(stats.max_vertex_shift_mm == longest_shift(mesh, start.surface));
    CHECK(stats.max_vertex_shift_mm <= shift * (1 + 1e-12));
    if (shift == 0.5) {
      CHECK(stats.after.poor == 0);
      CHECK(stats.max_vertex_shift_mm < shift);  // as far as it takes, and no farther
    }
    CHECK(std::equal(mesh.surface.points.begin(), mesh.surface.points.end(), mesh.points.begin()));
    const Validation validation = validate(mesh, 3);
    INFO(validation.summary());
    CHECK(validation.is_valid());
  }
}

TEST_CASE("improve_tets: vertices on the border of the image move along it", "[tet][unit]") {
  ImproveTetsOptions options;
  options.insert_below_deg = 0;
  options.max_vertex_shift_mm = 0.5;
  // What would rise out of the border stays in it; along another border it may rise.
  for (const std::uint16_t wall : {6, 1}) {
    TetMesh mesh = flat_roof(0.02, false);
    for (PatchKey& patch : mesh.surface.patch_of)
      patch.wall = wall;
    const InterfaceMesh before = mesh.surface;
    const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
    for (std::size_t v = 0; v < before.points.size(); ++v)
      CHECK(mesh.points[v][(wall - 1) / 2] == before.points[v][(wall - 1) / 2]);
    if (wall == 1) CHECK(stats.shifted_vertices > 0);
    const Validation validation = validate(mesh, 3);
    INFO(validation.summary());
    CHECK(validation.is_valid());
  }
}

TEST_CASE("improve_tets: vertices in a corner of the image stay", "[tet][unit]") {
  TetMesh mesh = flat_roof(0.02, false);
  for (std::size_t f = 0; f < mesh.surface.facets.size(); ++f)
    mesh.surface.patch_of[f].wall = static_cast<std::uint16_t>(2 * (f % 3) + 1);
  const InterfaceMesh before = mesh.surface;
  std::vector<std::array<bool, 3>> is_fixed(before.points.size(), {false, false, false});
  for (std::size_t f = 0; f < before.facets.size(); ++f)
    for (const auto v : before.facets[f])
      is_fixed[at(v)][f % 3] = true;
  ImproveTetsOptions options;
  options.max_vertex_shift_mm = 0.5;
  improve_tets(mesh, options, silent_context());
  for (std::size_t v = 0; v < before.points.size(); ++v)
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (is_fixed[v][axis])
        CHECK(mesh.points[v][static_cast<int>(axis)] == before.points[v][static_cast<int>(axis)]);
}

TEST_CASE("improve_tets: vertices that move leave room to what is across the exterior",
          "[tet][unit]") {
  // The upper edge of the roof would rise by more than the gap above it.
  const double gap = 0.05;
  ImproveTetsOptions options;
  options.insert_below_deg = 0;
  options.max_vertex_shift_mm = 1;
  TetMesh open = flat_roof(0.02, false);
  const auto highest = [](const TetMesh& mesh) {
    return std::max(mesh.points[0].z, mesh.points[1].z);
  };
  improve_tets(open, options, silent_context());
  REQUIRE(highest(open) > 0.02 + gap);

  TetMesh mesh = flat_roof(0.02, false);
  add_ceiling(mesh, 0.02 + gap);
  improve_tets(mesh, options, silent_context());
  CHECK(highest(mesh) < 0.02 + gap);
  CHECK(find_intersections(mesh.surface).empty());
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: vertices move where the exterior is narrower than the room they leave it",
          "[tet][unit]") {
  const double gap = 0.005;  // facets keep 0.01 elsewhere, with this `max_vertex_shift_mm`
  ImproveTetsOptions options;
  options.insert_below_deg = 0;
  options.max_vertex_shift_mm = 1;
  TetMesh mesh = flat_roof(0.02, false);
  add_ceiling(mesh, 0.02 + gap);
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.shifted_vertices > 0);
  CHECK(stats.after.min_deg > stats.before.min_deg + 1);
  CHECK(std::max(mesh.points[0].z, mesh.points[1].z) < 0.02 + gap);
  CHECK(find_intersections(mesh.surface).empty());
}

TEST_CASE("GapOpener: a move that is barred goes in part, where it may", "[tet][unit]") {
  // One end of the upper edge would rise by far more than the gap above it.
  const double height = 0.02, gap = 0.03, enough = std::sin(std::numbers::pi / 12);
  TetMesh start = flat_roof(height, false);
  add_ceiling(start, height + gap);
  std::vector<bool> is_frozen(start.surface.points.size(), true);
  is_frozen[0] = false;
  const auto opened = [&](GapOpener::Barred barred) {
    TetMesh mesh = start;
    OpenTets tets(mesh);
    GapOpener opener(tets, start.surface.points, is_frozen, 0.5, enough, 100);
    opener.open(1, barred);
    tets.close();
    return mesh;
  };
  const auto flattest = [](const TetMesh& mesh) {
    const auto& p = mesh.points;
    return min_dihedral_sine(p[0], p[1], p[2], p[3]);
  };
  CHECK(opened(GapOpener::Barred::Stays).points == start.points);
  const TetMesh mesh = opened(GapOpener::Barred::GoesInPart);
  CHECK(flattest(mesh) > 1.2 * flattest(start));
  CHECK(mesh.points[0].z > height);
  CHECK(mesh.points[0].z < height + gap);
  CHECK(find_intersections(mesh.surface).empty());
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("refine_surface: where no edge is split, vertices move as far as they may",
          "[tet][unit]") {
  TetMesh mesh = flat_roof(0.02, false);
  add_ceiling(mesh, 0.05);
  const TetMesh start = mesh;
  ImproveTetsOptions options;
  options.max_vertex_shift_mm = 0.5;
  options.max_splits_per_vertex = 1;
  options.min_split_edge_mm = 100;
  ImproveTetsStats stats;
  refine_surface(mesh, start.surface.points, options, silent_context(), stats);
  CHECK(stats.edge_splits == 0);
  CHECK(stats.shifted_vertices > 0);
  CHECK(stats.max_vertex_shift_mm == longest_shift(mesh, start.surface));
  CHECK(stats.after.poor == 0);
  CHECK(find_intersections(mesh.surface).empty());
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE(
    "improve_tets: two sheets that nearly touch are drawn apart, the same way at any number "
    "of threads",
    "[tet][determinism]") {
  const InterfaceMesh surface =
      join(sphere(kCentre, 15, 3, {1, 0}), sphere(kCentre, 14.9, 3, {2, 1}));
  const TetMesh start = unimproved(surface, 3, 4);
  TetMesh frozen = start;
  const ImproveTetsStats without = improve_tets(frozen, {}, silent_context());
  ImproveTetsOptions options;
  options.max_vertex_shift_mm = 0.4;
  TetMesh first = start;
  const ImproveTetsStats stats = improve_tets(first, options, silent_context());
  CHECK(without.after.poor > 100);
  CHECK(stats.after.poor < without.after.poor / 10);
  CHECK(longest_shift(first, surface) <= 0.4 * (1 + 1e-12));
  CHECK(find_intersections(first.surface).empty());
  const Validation validation = validate(first, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    TetMesh second = start;
    improve_tets(second, options, silent_context());
    CHECK(first.tets == second.tets);
    CHECK(first.points == second.points);
    CHECK(first.surface.points == second.surface.points);
  }
}

TEST_CASE("OpenTets: a trial that is undone leaves nothing behind", "[tet][unit]") {
  TetMesh mesh = unimproved(sphere(kCentre, 15, 2, {1, 0}), 2, 6);
  const TetMesh start = mesh;
  OpenTets tets(mesh);
  std::vector<std::int32_t> star;
  OpenTets::Ring ring;
  std::size_t trials = 0;
  for (std::int32_t t = 0; static_cast<std::size_t>(t) < start.tets.size(); t += 7) {
    Vec3 p;
    for (const std::int32_t v : tets.tet(t))
      p += tets.point(v) / 4;
    const Cavity cavity = dig_cavity(tets, t, p);
    if (cavity.tets.empty()) continue;
    ++trials;
    tets.begin_trial();
    const std::int32_t v = tets.add_point(p);
    tets.replace(cavity.tets, cavity.tets_with(v));
    tets.find_star(v, star);
    CHECK(star.size() == cavity.walls.size());
    tets.move_point(v, p + Vec3{0.01, 0, 0}, star);
    const auto [before, after] = tets.compare_trial(1);
    CHECK(before.worst <= 1);
    CHECK(after.worst <= 1);
    tets.undo_trial();
  }
  REQUIRE(trials > 10);
  tets.close();
  CHECK(mesh.points == start.points);
  CHECK(mesh.tets == start.tets);
  CHECK(mesh.material_of == start.material_of);
}

TEST_CASE("measure_dihedral_angles: poor tets in narrow wedges are told apart", "[tet][unit]") {
  // One tet whose facets meet at 5 degrees along its first edge.
  const double angle = 5 * std::numbers::pi / 180;
  TetMesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {0.5, 1, 0}, {0.5, std::cos(angle), std::sin(angle)}};
  mesh.tets = {{0, 1, 2, 3}};
  mesh.material_of = {1};
  mesh.surface.points = mesh.points;
  mesh.surface.facets = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  mesh.surface.patch_of.assign(4, {{1, 0}, 0});
  const DihedralAngles wedge = measure_dihedral_angles(OpenTets(mesh));
  CHECK(wedge.poor == 0);
  CHECK(wedge.poor_in_wedges == 1);
  CHECK(wedge.min_deg == Approx(5));
  CHECK(wedge.least_share_of_wedge == Approx(1));
  REQUIRE(wedge.places.size() == 1);
  CHECK(wedge.places[0].wedge_deg == Approx(5));
  CHECK(wedge.places[0].material == 1);

  // The flat roof is poor, but no wedge is to blame.
  TetMesh roof = flat_roof(0.02, true);
  const DihedralAngles flat = measure_dihedral_angles(OpenTets(roof));
  CHECK(flat.poor == 1);
  CHECK(flat.poor_in_wedges == 0);
  CHECK(flat.min_outside_wedges_deg == flat.min_deg);
  CHECK(flat.max_deg > 170);
}

TEST_CASE("measure_dihedral_angles: what all tets one by one give", "[tet][property]") {
  const InterfaceMesh surface = join(sphere(kCentre, 16, 3, {1, 0}), sphere(kCentre, 9, 3, {2, 1}));
  const TetMesh start = unimproved(surface, 3, 2.5);
  TetMesh improved = start;
  improve_tets(improved, {}, silent_context());
  for (TetMesh mesh : {start, improved}) {
    double min = 180, max = 0, min_sound = 180, max_sound = 0;
    std::size_t poor = 0;
    for (const auto& tet : mesh.tets) {
      double least = 180, most = 0;
      for (const auto& [i, j, k, l] : OpenTets::kEdges) {
        const Vec3 &a = mesh.points[at(tet[i])], &b = mesh.points[at(tet[j])];
        const Vec3 m = cross(b - a, mesh.points[at(tet[k])] - a);
        const Vec3 n = cross(b - a, mesh.points[at(tet[l])] - a);
        const double angle = std::atan2(norm(cross(m, n)), dot(m, n)) * 180 / std::numbers::pi;
        least = std::min(least, angle);
        most = std::max(most, angle);
      }
      min = std::min(min, least);
      max = std::max(max, most);
      if (least < kPoorMinDeg || most > kPoorMaxDeg) {
        ++poor;
        continue;
      }
      min_sound = std::min(min_sound, least);
      max_sound = std::max(max_sound, most);
    }
    const DihedralAngles angles = measure_dihedral_angles(OpenTets(mesh));
    CHECK(angles.min_deg == Approx(min).epsilon(1e-9));
    CHECK(angles.max_deg == Approx(max).epsilon(1e-9));
    CHECK(angles.poor + angles.poor_in_wedges == poor);
    CHECK(angles.min_outside_wedges_deg <= min_sound + 1e-7);
    CHECK(angles.max_outside_wedges_deg >= max_sound - 1e-7);
  }
}

TEST_CASE("AngleBounds: a sheet above a facet, and a wedge at its edge, bound the tet on it",
          "[tet][unit]") {
  // An equilateral facet of side 1 with a large one at some height above: the pyramid's tip, above
  // the centre of the inscribed circle, meets it first.
  const double root3 = std::sqrt(3.0), inner_radius = root3 / 6;
  for (const double height : {0.01, 0.05, 0.2}) {
    InterfaceMesh surface;
    surface.points = {{-0.5, -inner_radius, 0}, {0.5, -inner_radius, 0}, {0, root3 / 3, 0},
                      {-9, -9, height},         {9, -9, height},         {0, 9, height}};
    surface.facets = {{0, 1, 2}, {3, 4, 5}};
    surface.patch_of.assign(2, {{1, 0}, 0});
    const AngleBounds bounds(surface);
    const double expected = std::atan(height / inner_radius) * 180 / std::numbers::pi;
    CHECK(bounds.of_tet_on({0, 1, 2}, 80) == Approx(expected));
    CHECK(bounds.of_tet_on({0, 1, 2}, 1) == 1);
    CHECK(bounds.of_tet_on({0, 2, 1}, 80) == 80);  // nothing on the other side
  }
  for (const double wedge : {3.0, 14.0, 70.0}) {
    const double angle = wedge * std::numbers::pi / 180;
    InterfaceMesh surface;
    surface.points = {{0, 0, 0}, {1, 0, 0}, {0.5, 1, 0}, {0.5, std::cos(angle), std::sin(angle)}};
    surface.facets = {{0, 1, 2}, {0, 3, 1}};
    surface.patch_of.assign(2, {{1, 0}, 0});
    CHECK(AngleBounds(surface).of_tet_on({0, 1, 2}, 80) == Approx(wedge));
  }
}

TEST_CASE("AngleBounds: no tet beats the bound of its facet", "[tet][unit]") {
  const InterfaceMesh surface =
      join(sphere(kCentre, 15, 3, {1, 0}), sphere(kCentre, 14.9, 3, {2, 1}));
  TetMesh mesh = unimproved(surface, 3, 4);
  const DihedralAngles angles = improve_tets(mesh, {}, silent_context()).after;
  CHECK(angles.poor > 0);
  CHECK(angles.poor_bound_by_surface > 0);
  CHECK(angles.poor_bound_by_surface <= angles.poor);
  const OpenTets tets(mesh);
  const AngleBounds bounds(mesh.surface);
  std::size_t on_facets = 0, bound = 0;
  for (std::int32_t t = 0; at(t) < tets.slot_count(); ++t)
    for (std::size_t k = 0; k < 4; ++k) {
      if (tets.neighbour(t, k) != OpenTets::kNone) continue;
      const auto [a, b, c] = tet_face(tets.tet(t), k);
      const double most = bounds.of_tet_on({a, c, b}, 80);
      // The smallest sine is that of the smallest angle, or of a larger one near 180 degrees.
      CHECK(std::asin(tets.score(t).min_sine) * 180 / std::numbers::pi <= most * (1 + 1e-9));
      ++on_facets;
      if (most < 12) ++bound;
    }
  CHECK(on_facets > 2000);
  CHECK(bound > 100);
}

TEST_CASE("improve_tets: a new vertex helps where flips and moves cannot", "[tet][unit]") {
  // A flat disc of few facets: TetGen adds no point close to them, so tets span the whole
  // thickness (measured: smallest angle 8.2 degrees, with new vertices 21.7).
  InterfaceMesh surface = sphere({0, 0, 0}, 1, 2, {1, 0});
  for (Vec3& p : surface.points)
    p = scaled_by(p, {10, 10, 3});
  const TetMesh start = unimproved(surface, 2, 100);
  ImproveTetsOptions options;
  options.insert_below_deg = 0;
  TetMesh without = start, with = start;
  const ImproveTetsStats plain = improve_tets(without, options, silent_context());
  const ImproveTetsStats stats = improve_tets(with, {}, silent_context());
  CHECK(plain.insertions == 0);
  CHECK(stats.insertions > 0);
  CHECK(stats.after.min_deg > plain.after.min_deg + 5);
  CHECK(volumes(with, 2)[1] == Approx(volumes(start, 2)[1]).epsilon(1e-10));
  const Validation validation = validate(with, 2);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: the bound on new vertices holds", "[tet][unit]") {
  TetMesh mesh = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 100);
  const std::size_t before = mesh.points.size();
  ImproveTetsOptions options;
  options.insert_below_deg = 80;
  options.max_insertions_per_vertex = 0.02;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.insertions == static_cast<std::size_t>(0.02 * static_cast<double>(before)));
}

TEST_CASE("improve_tets: the bound on tries of new vertices holds, and few are always allowed",
          "[tet][unit]") {
  const TetMesh start = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 100);
  ImproveTetsOptions options;
  options.insert_below_deg = 80;  // more than can be had, so that nearly every tet asks for tries
  options.max_insertion_tries_per_vertex = 0.05;
  const auto bound = static_cast<std::size_t>(0.05 * static_cast<double>(start.points.size()));
  for (const std::size_t few : {std::size_t{3}, bound + 50}) {
    options.few_insertion_tries = few;
    TetMesh mesh = start;
    const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
    CHECK(stats.insertion_tries == std::max(few, bound));
    CHECK(stats.insertions <= stats.insertion_tries);
  }
}

TEST_CASE("improve_tets: a thin wall between two sparse sheets keeps its surface", "[tet][unit]") {
  const InterfaceMesh surface =
      join(sphere(kCentre, 15, 3, {1, 0}), sphere(kCentre, 14.5, 3, {2, 1}));
  TetMesh mesh = unimproved(surface, 3, 4);
  const double before = worst_quality(mesh);
  improve_tets(mesh, {}, silent_context());
  CHECK(worst_quality(mesh) >= before);
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: no pass changes nothing", "[tet][unit]") {
  TetMesh mesh = long_octahedron(4);
  const TetMesh before = mesh;
  ImproveTetsOptions options;
  options.passes = 0;
  improve_tets(mesh, options, silent_context());
  CHECK(mesh.tets == before.tets);
  CHECK(mesh.points == before.points);
}

TEST_CASE(
    "improve_tets: in parts the tets become as good as in one piece, and so they do on the cuts",
    "[tet][property]") {
  const TetMesh start =
      unimproved(join(sphere(kCentre, 15, 3, {1, 0}), sphere(kCentre, 14.2, 3, {2, 1})), 3, 2);
  const auto mean_quality = [](const TetMesh& mesh) {
    double sum = 0;
    for (const auto& [a, b, c, d] : mesh.tets)
      sum +=
          score_tet(mesh.points[at(a)], mesh.points[at(b)], mesh.points[at(c)], mesh.points[at(d)])
              .radius_ratio;
    return sum / static_cast<double>(mesh.tets.size());
  };
  ImproveTetsOptions options;
  options.max_surface_shift_mm = 0.1;
  options.max_vertex_shift_mm = 0.1;
  TetMesh whole = start;
  const ImproveTetsStats in_one = improve_tets(whole, options, silent_context());
  options.most_tets_of_part = start.tets.size() / 10;
  TetMesh joined = start;
  const ImproveTetsStats in_parts = improve_tets(joined, options, silent_context());
  const Validation validation = validate(joined, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
  CHECK(joined.tets != whole.tets);
  CHECK(in_parts.before.min_deg == in_one.before.min_deg);
  CHECK(in_parts.after.min_deg > 0.9 * in_one.after.min_deg);
  CHECK(mean_quality(joined) > mean_quality(whole) - 0.01);
  CHECK(in_parts.moves + in_parts.edge_removals > (in_one.moves + in_one.edge_removals) / 2);
}

TEST_CASE("improve_tets: a cancel ends it, in one piece and in parts", "[tet][unit]") {
  const TetMesh start = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 3);
  const std::atomic<bool> cancel = true;
  StageContext context = silent_context();
  context.cancel = &cancel;
  ImproveTetsOptions options;
  for (const std::size_t parts : {1U, 12U}) {
    options.most_tets_of_part = start.tets.size() / parts;
    TetMesh mesh = start;
    REQUIRE_THROWS_AS(improve_tets(mesh, options, context), Error);
  }
}

TEST_CASE("improve_tets: equal input gives equal tets at any number of threads",
          "[tet][determinism]") {
  const TetMesh start = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 3);
  ImproveTetsOptions options;
  for (const std::size_t parts : {1U, 12U}) {
    options.most_tets_of_part = start.tets.size() / parts;
    TetMesh first = start;
    improve_tets(first, options, silent_context());
    for (const std::size_t threads : {1U, 3U, 8U}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      TetMesh second = start;
      improve_tets(second, options, silent_context());
      CHECK(first.tets == second.tets);
      CHECK(first.points == second.points);
    }
  }
}
