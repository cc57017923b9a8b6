// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/tetrahedralize.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

const Vec3 kCentre{20, 20, 20};

TetrahedralizeResult fill(const InterfaceMesh& surface,
                          std::size_t material_count,
                          const SizingField& field = {},
                          const TetrahedralizeOptions& options = {}) {
  find_helper();
  return tetrahedralize(surface, material_count, field, options, silent_context());
}

double volume_of(const TetMesh& mesh, MaterialId material) {
  double volume = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (mesh.material_of[t] != material) continue;
    const auto corner = [&](std::size_t k) {
      return mesh.points[static_cast<std::size_t>(mesh.tets[t][k])];
    };
    volume += volume6(corner(0), corner(1), corner(2), corner(3)) / 6;
  }
  return volume;
}

/// The promises of `TetMesh`, checked without the stage's own code.
void check_mesh(const TetMesh& mesh, const InterfaceMesh& surface, std::size_t material_count) {
  const Validation validation = validate(mesh, material_count);
  INFO(validation.summary());
  CHECK(validation.is_valid());
  REQUIRE(mesh.points.size() >= surface.points.size());
  CHECK(std::equal(surface.points.begin(), surface.points.end(), mesh.points.begin()));
  CHECK(mesh.surface.facets == surface.facets);
  std::set<std::array<std::int32_t, 3>> faces;
  std::vector<bool> is_used(mesh.points.size(), false);
  for (const auto& tet : mesh.tets)
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<std::int32_t, 3> face{tet[(k + 1) % 4], tet[(k + 2) % 4], tet[(k + 3) % 4]};
      std::sort(face.begin(), face.end());
      faces.insert(face);
      is_used[static_cast<std::size_t>(tet[k])] = true;
    }
  std::size_t missing = 0;
  for (auto facet : surface.facets) {
    std::sort(facet.begin(), facet.end());
    missing += 1 - faces.count(facet);
  }
  CHECK(missing == 0);
  CHECK(std::count(is_used.begin(), is_used.end(), false) == 0);
  CHECK(std::count(mesh.material_of.begin(), mesh.material_of.end(), kExterior) == 0);
}

std::string failure(const InterfaceMesh& surface,
                    std::size_t material_count,
                    ErrorCode code,
                    const TetrahedralizeOptions& options = {}) {
  try {
    fill(surface, material_count, {}, options);
  } catch (const Error& error) {
    CHECK(error.code() == code);
    return error.message();
  }
  FAIL("no error");
  return {};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

InterfaceMesh nested_spheres() {
  return join(join(sphere(kCentre, 18, 3, {1, 0}), sphere(kCentre, 12, 3, {2, 1})),
              sphere(kCentre, 6, 2, {3, 2}));
}

}  // namespace

TEST_CASE("tetrahedralize: nested spheres keep their materials and volumes", "[tet][unit]") {
  const InterfaceMesh surface = nested_spheres();
  const TetrahedralizeResult result = fill(surface, 4);
  check_mesh(result.tets, surface, 4);
  const double outer = enclosed_volume(surface, {1, 0}), middle = enclosed_volume(surface, {2, 1}),
               inner = enclosed_volume(surface, {3, 2});
  CHECK(volume_of(result.tets, 1) == Approx(outer - middle).epsilon(1e-9));
  CHECK(volume_of(result.tets, 2) == Approx(middle - inner).epsilon(1e-9));
  CHECK(volume_of(result.tets, 3) == Approx(inner).epsilon(1e-9));
  CHECK(result.stats.volume_error < 1e-9);
  CHECK(result.stats.attempts == 1);
  CHECK(result.stats.failed_attempts.empty());
  CHECK(result.stats.steiner_points == result.tets.points.size() - surface.points.size());
}

TEST_CASE("tetrahedralize: two boxes share their wall", "[tet][unit]") {
  const InterfaceMesh surface =
      join(box({0, 0, 0}, {10, 10, 10}, 3, {1, 0}), box({10, 0, 0}, {16, 10, 10}, 3, {2, 0}));
  REQUIRE(surface.facets.size() == 2 * 6 * 18 - 18);
  const TetrahedralizeResult result = fill(surface, 3);
  check_mesh(result.tets, surface, 3);
  CHECK(volume_of(result.tets, 1) == Approx(1000).epsilon(1e-9));
  CHECK(volume_of(result.tets, 2) == Approx(600).epsilon(1e-9));
}

TEST_CASE("tetrahedralize: a flat-walled box of many coplanar facets keeps them all",
          "[tet][unit]") {
  const InterfaceMesh surface = box({0, 0, 0}, {7, 7, 7}, 12, {1, 0});
  const TetrahedralizeResult result = fill(surface, 2);
  check_mesh(result.tets, surface, 2);
  CHECK(volume_of(result.tets, 1) == Approx(343).epsilon(1e-9));
}

TEST_CASE("tetrahedralize: a single tet stays one tet", "[tet][unit]") {
  const InterfaceMesh surface = single_tet(3, {1, 0});
  const TetrahedralizeResult result = fill(surface, 2);
  check_mesh(result.tets, surface, 2);
  CHECK(result.tets.tets.size() == 1);
  CHECK(volume_of(result.tets, 1) == Approx(27.0 / 6).epsilon(1e-12));
}

TEST_CASE("tetrahedralize: a torus keeps its hole", "[tet][unit]") {
  InterfaceMesh surface = torus(10, 3, 40, 14, {1, 0});
  const TetrahedralizeResult result = fill(surface, 2);
  check_mesh(result.tets, surface, 2);
  const double smooth = 2 * std::numbers::pi * std::numbers::pi * 10 * 9;
  CHECK(volume_of(result.tets, 1) == Approx(enclosed_volume(surface, {1, 0})).epsilon(1e-9));
  CHECK(volume_of(result.tets, 1) == Approx(smooth).epsilon(0.05));  // chords cut 4 % off
}

TEST_CASE("tetrahedralize: a void inside a material stays empty", "[tet][unit]") {
  InterfaceMesh hole = sphere(kCentre, 6, 2, {1, 0});
  for (auto& facet : hole.facets)
    std::swap(facet[0], facet[1]);
  const InterfaceMesh shell = sphere(kCentre, 12, 3, {1, 0});
  const InterfaceMesh surface = join(shell, hole);
  const TetrahedralizeResult result = fill(surface, 2);
  check_mesh(result.tets, surface, 2);
  CHECK(volume_of(result.tets, 1) == Approx(enclosed_volume(surface, {1, 0})).epsilon(1e-9));
}

TEST_CASE("tetrahedralize: one material in two parts is filled in both", "[tet][unit]") {
  const InterfaceMesh surface =
      join(sphere({5, 5, 5}, 4, 2, {1, 0}), sphere({15, 5, 5}, 3, 2, {1, 0}));
  const TetrahedralizeResult result = fill(surface, 2);
  check_mesh(result.tets, surface, 2);
  CHECK(volume_of(result.tets, 1) == Approx(enclosed_volume(surface, {1, 0})).epsilon(1e-9));
}

TEST_CASE("tetrahedralize: a graded interior stays sparse", "[tet][unit]") {
  const InterfaceMesh surface = sphere(kCentre, 15, 3, {1, 0});
  const double edge = distance(surface.points[static_cast<std::size_t>(surface.facets[0][0])],
                               surface.points[static_cast<std::size_t>(surface.facets[0][1])]);
  const SizingField graded = sizing({40, 40, 40}, [&](const Vec3& p) {
    return edge + 0.4 * std::abs(distance(p, kCentre) - 15);
  });
  const TetrahedralizeResult result = fill(surface, 2, graded);
  const double per_vertex =
      static_cast<double>(result.tets.tets.size()) / static_cast<double>(surface.points.size());
  // 642 surface vertices; a gradation of 0.4 leaves few points inside (measured: 10).
  CHECK(per_vertex < 12);
  CHECK(per_vertex > 2);
}

TEST_CASE("tetrahedralize: interior edges have the length that the sizing field asks for",
          "[tet][unit]") {
  const InterfaceMesh surface = sphere(kCentre, 15, 4, {1, 0});
  for (const double h : {1.2, 2.0}) {
    const TetrahedralizeResult result = fill(
        surface, 2, sizing({40, 40, 40}, [&](const Vec3&) { return h; }), {.interior_growth = 1});
    double sum = 0;
    std::size_t count = 0;
    const std::int32_t first = static_cast<std::int32_t>(surface.points.size());
    for (const auto& tet : result.tets.tets)
      for (std::size_t a = 0; a < 4; ++a)
        for (std::size_t b = 0; b < a; ++b)
          if (tet[a] >= first && tet[b] >= first) {
            sum += distance(result.tets.points[static_cast<std::size_t>(tet[a])],
                            result.tets.points[static_cast<std::size_t>(tet[b])]);
            ++count;
          }
    REQUIRE(count > 100);
    CHECK(sum / static_cast<double>(count) == Approx(h).epsilon(0.2));
  }
}

TEST_CASE("tetrahedralize: equal input gives equal tets", "[tet][determinism]") {
  const InterfaceMesh surface = nested_spheres();
  const SizingField field = sizing({40, 40, 40}, [](const Vec3&) { return 2.5; });
  const TetrahedralizeResult first = fill(surface, 4, field), second = fill(surface, 4, field);
  CHECK(first.tets.points == second.tets.points);
  CHECK(first.tets.tets == second.tets.tets);
  CHECK(first.tets.material_of == second.tets.material_of);
}

TEST_CASE("tetrahedralize: facets that intersect are named before TetGen sees them",
          "[tet][unit]") {
  InterfaceMesh second = single_tet(3, {2, 0});
  for (Vec3& p : second.points)
    p += Vec3{0.5, 0.5, 0.5};
  const std::string message =
      failure(join(single_tet(3, {1, 0}), second), 3, ErrorCode::StageFailed);
  CHECK(contains(message, "intersect"));
  CHECK(contains(message, "material 2 and material 0"));
}

TEST_CASE("tetrahedralize: an open surface is refused", "[tet][unit]") {
  InterfaceMesh open = sphere(kCentre, 5, 1, {1, 0});
  open.facets.pop_back();
  open.patch_of.pop_back();
  CHECK(contains(failure(open, 2, ErrorCode::StageFailed), "not valid"));
}

TEST_CASE("tetrahedralize: a coordinate that is not a number is refused", "[tet][unit]") {
  InterfaceMesh surface = sphere(kCentre, 5, 1, {1, 0});
  surface.points[5].y = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(failure(surface, 2, ErrorCode::StageFailed), "not valid"));
}

TEST_CASE("tetrahedralize: points that coincide are refused", "[tet][unit]") {
  InterfaceMesh second = single_tet(3, {2, 0});
  for (Vec3& p : second.points)
    p *= -1;
  for (auto& facet : second.facets)
    std::swap(facet[0], facet[1]);
  InterfaceMesh surface = single_tet(3, {1, 0});
  const std::int32_t shift = 4;
  surface.points.insert(surface.points.end(), second.points.begin(), second.points.end());
  for (std::size_t f = 0; f < 4; ++f) {
    auto facet = second.facets[f];
    for (auto& v : facet)
      v += shift;
    surface.facets.push_back(facet);
    surface.patch_of.push_back(second.patch_of[f]);
  }
  CHECK(contains(failure(surface, 3, ErrorCode::StageFailed), "not valid"));
}

TEST_CASE("tetrahedralize: a material without facets is named as lost", "[tet][unit]") {
  CHECK(contains(failure(single_tet(3, {1, 0}), 3, ErrorCode::StageFailed), "material 2"));
}

TEST_CASE("tetrahedralize: options out of range are refused", "[tet][unit]") {
  const InterfaceMesh surface = single_tet(3, {1, 0});
  CHECK(contains(failure(surface, 2, ErrorCode::BadParameter, {.radius_edge_ratio = 0.5}),
                 "radius_edge_ratio (0.5)"));
  CHECK(contains(failure(surface, 2, ErrorCode::BadParameter, {.min_dihedral_deg = 60}),
                 "min_dihedral_deg (60)"));
  CHECK(contains(failure(surface, 2, ErrorCode::BadParameter, {.interior_growth = -1}),
                 "interior_growth (-1)"));
}

TEST_CASE("tetrahedralize: a time limit that no attempt meets ends in a limit error",
          "[tet][unit]") {
  const std::string message =
      failure(sphere(kCentre, 15, 6, {1, 0}), 2, ErrorCode::Limit, {.time_limit_s = 0.05});
  CHECK(contains(message, "time_limit_s"));
  CHECK(contains(message, "pYAJQ:"));      // the loosest set was tried as well
  CHECK_FALSE(contains(message, "pY/2"));  // and none of them in other ways that take as long
}
