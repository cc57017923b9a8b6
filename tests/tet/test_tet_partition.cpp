// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/tet_partition.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

}  // namespace

TEST_CASE("TetPartition: joined untouched, the mesh is what it was", "[tet][property]") {
  const TetMesh whole = thin_wall();
  for (const std::size_t most : {whole.tets.size(), whole.tets.size() / 2, std::size_t{100}}) {
    CAPTURE(most);
    TetPartition partition(whole, most);
    CHECK((partition.parts.size() == 1) == (most == whole.tets.size()));
    std::size_t tets = 0;
    for (const TetPartition::Part& part : partition.parts) {
      CHECK(part.mesh.tets.size() <= most);
      CHECK(part.mesh.tets.size() >= most / 2);
      tets += part.mesh.tets.size();
    }
    CHECK(tets == whole.tets.size());
    TetMesh back = whole;
    const std::vector<std::int32_t> on_cuts = partition.join(back);
    require_valid(back);
    CHECK(on_cuts.empty() == (most == whole.tets.size()));
    CHECK(back.surface.points == whole.surface.points);
    CHECK(back.surface.facets == whole.surface.facets);
    CHECK(places(back) == places(whole));
  }
}

TEST_CASE(
    "TetPartition: only frozen vertices have tets in several parts, and all facets between "
    "vertices of a part are in it",
    "[tet][property]") {
  const TetMesh whole = thin_wall();
  const TetPartition partition(whole, 300);
  REQUIRE(partition.parts.size() > 10);
  std::map<std::vector<double>, std::set<std::size_t>> parts_of;  // by the place of the vertex
  const auto key = [](const Vec3& p) { return std::vector<double>{p.x, p.y, p.z}; };
  for (std::size_t p = 0; p < partition.parts.size(); ++p)
    for (const auto& tet : partition.parts[p].mesh.tets)
      for (const std::int32_t v : tet)
        parts_of[key(partition.parts[p].mesh.points[at(v)])].insert(p);
  std::size_t frozen = 0;
  for (const auto& [mesh, is_frozen, whole_of, facets] : partition.parts) {
    for (std::size_t v = 0; v < mesh.points.size(); ++v) {
      const bool is_shared = parts_of[key(mesh.points[v])].size() > 1;
      CHECK(is_shared == (v < is_frozen.size() && is_frozen[v]));
      frozen += is_shared;
    }
    std::size_t own = 0;
    for (const auto& facet : whole.surface.facets)
      own += std::all_of(facet.begin(), facet.end(), [&, &ids = whole_of](std::int32_t v) {
        return std::binary_search(ids.begin(), ids.end(), v);
      });
    CHECK(facets.size() == own);
    CHECK(mesh.surface.facets.size() == own);
  }
  CHECK(frozen > 100);
}

TEST_CASE("TetPartition: what changes inside the parts changes in the whole", "[tet][property]") {
  const TetMesh whole = thin_wall();
  TetPartition partition(whole, 300);
  // a new vertex in the middle of the first tet of every part
  const std::size_t count = partition.parts.size();
  for (TetPartition::Part& part : partition.parts) {
    TetMesh& mesh = part.mesh;
    const auto tet = mesh.tets.front();
    const auto middle = static_cast<std::int32_t>(mesh.points.size());
    mesh.points.push_back((mesh.points[at(tet[0])] + mesh.points[at(tet[1])] +
                           mesh.points[at(tet[2])] + mesh.points[at(tet[3])]) /
                          4);
    for (std::size_t k = 0; k < 4; ++k) {
      auto quarter = tet;
      quarter[k] = middle;
      if (k == 0) {
        mesh.tets.front() = quarter;
      } else {
        mesh.tets.push_back(quarter);
        mesh.material_of.push_back(mesh.material_of.front());
      }
    }
  }
  TetMesh back = whole;
  partition.join(back);
  require_valid(back);
  CHECK(back.points.size() == whole.points.size() + count);
  CHECK(back.tets.size() == whole.tets.size() + 3 * count);
  for (std::size_t m = 1; m < 3; ++m)
    CHECK(volumes(back)[m] == Approx(volumes(whole)[m]).epsilon(1e-12));
}
