// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/sort_along_curve.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include "surface/dense_phantoms.h"
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <set>
#include <tuple>
#include <vector>

using namespace cvmesh;

namespace {

using Place = std::array<double, 3>;

// Every facet with its patch, by the places of its vertices in their order.
std::set<std::tuple<PatchKey, std::array<Place, 3>>> facets_of(const InterfaceMesh& mesh) {
  std::set<std::tuple<PatchKey, std::array<Place, 3>>> facets;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    std::array<Place, 3> places;
    for (int c = 0; c < 3; ++c) {
      const Vec3& p = mesh.points[static_cast<std::size_t>(mesh.facets[f][c])];
      places[c] = {p.x, p.y, p.z};
    }
    facets.insert({mesh.patch_of[f], places});
  }
  return facets;
}

double mean_jump(const InterfaceMesh& mesh) {
  double sum = 0;
  for (const auto& facet : mesh.facets) {
    const auto [least, most] = std::minmax_element(facet.begin(), facet.end());
    sum += *most - *least;
  }
  return sum / static_cast<double>(mesh.facets.size());
}

}  // namespace

TEST_CASE("sort_along_curve: the same surface, neighbours close to each other", "[mesh][unit]") {
  InterfaceMesh mesh = dense_phantoms::make(phantoms::touching_balls(12)).mesh;
  const auto facets = facets_of(mesh);
  // numbers that have nothing to do with places
  const std::size_t n = mesh.points.size(), step = 7919;
  REQUIRE(n % step != 0);
  std::vector<Vec3> points(n);
  for (std::size_t v = 0; v < n; ++v)
    points[v * step % n] = mesh.points[v];
  mesh.points = points;
  for (auto& facet : mesh.facets)
    for (auto& v : facet)
      v = static_cast<std::int32_t>(static_cast<std::size_t>(v) * step % n);
  REQUIRE(facets_of(mesh) == facets);
  const double before = mean_jump(mesh);
  sort_along_curve(mesh, 1);
  CHECK(facets_of(mesh) == facets);
  CHECK(mean_jump(mesh) < 0.1 * before);

  const InterfaceMesh once = mesh;
  sort_along_curve(mesh, 1);
  CHECK(mesh.points == once.points);
  CHECK(mesh.facets == once.facets);
}
