// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/second_order.h"
#include "cvmesh/tet/split_contacts.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <map>
#include <set>

using namespace cvmesh;

namespace {

constexpr int kSide = 4;

/// Three materials around the line x = y = 2: 1 and 2 share the half plane x = 2, y < 2, and 3 lies
/// across both of them.
TetMesh wedge(bool is_second_order) {
  TetMesh mesh = simple_meshes::lattice_box(kSide, [](const Vec3& p) -> MaterialId {
    return p.y > 2 ? 3 : p.x > 2 ? 2 : 1;
  });
  if (is_second_order) make_second_order(mesh, nullptr, {});
  return mesh;
}

Vec3 position(const TetMesh& mesh, std::int32_t node) {
  const auto i = static_cast<std::size_t>(node);
  return i < mesh.points.size() ? mesh.points[i] : mesh.mid_points[i - mesh.points.size()];
}

/// All nodes of a tet, mid nodes after the corners.
std::vector<std::int32_t> nodes_of(const TetMesh& mesh, std::size_t tet) {
  std::vector<std::int32_t> nodes(mesh.tets[tet].begin(), mesh.tets[tet].end());
  if (!mesh.mid_of.empty())
    for (const std::int32_t mid : mesh.mid_of[tet])
      nodes.push_back(mid + static_cast<std::int32_t>(mesh.points.size()));
  return nodes;
}

std::map<std::set<std::int32_t>, std::vector<MaterialId>> faces_of(const TetMesh& mesh) {
  std::map<std::set<std::int32_t>, std::vector<MaterialId>> faces;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (std::size_t left_out = 0; left_out < 4; ++left_out) {
      std::set<std::int32_t> face(mesh.tets[t].begin(), mesh.tets[t].end());
      face.erase(mesh.tets[t][left_out]);
      faces[face].push_back(mesh.material_of[t]);
    }
  return faces;
}

/// What holds of every cut: geometry stays, no tet reaches across, pairs lie in one place.
void check_cut(const TetMesh& before, const TetMesh& after, const std::set<Sides>& cut) {
  REQUIRE(after.tets.size() == before.tets.size());
  CHECK(after.material_of == before.material_of);
  for (std::size_t t = 0; t < before.tets.size(); ++t) {
    const auto old = nodes_of(before, t), now = nodes_of(after, t);
    for (std::size_t k = 0; k < old.size(); ++k)
      CHECK(position(before, old[k]) == position(after, now[k]));
  }
  std::size_t shared_before = 0, shared_after = 0, facets_cut = 0;
  for (const auto& [face, materials] : faces_of(before)) {
    if (materials.size() < 2) continue;
    const Sides sides{std::max(materials[0], materials[1]), std::min(materials[0], materials[1])};
    (cut.contains(sides) ? facets_cut : shared_before) += 1;
  }
  const auto faces = faces_of(after);
  for (const auto& [face, materials] : faces) {
    if (materials.size() < 2) continue;
    ++shared_after;
    CHECK_FALSE(
        cut.contains({std::max(materials[0], materials[1]), std::min(materials[0], materials[1])}));
  }
  CHECK(facets_cut > 0);
  CHECK(shared_after == shared_before);  // and nothing else came apart

  // The surface: its points first, each facet a face of a tet of its inside, cut ones twice.
  const InterfaceMesh& surface = after.surface;
  CHECK(surface.facets.size() == before.surface.facets.size() + facets_cut);
  REQUIRE(surface.points.size() <= after.points.size());
  CHECK(std::equal(surface.points.begin(), surface.points.end(), after.points.begin()));
  for (std::size_t i = 0; i < surface.facets.size(); ++i) {
    const auto& f = surface.facets[i];
    const auto found = faces.find({f.begin(), f.end()});
    REQUIRE(found != faces.end());
    const MaterialId inside = surface.patch_of[i].sides.inside;
    CHECK(std::count(found->second.begin(), found->second.end(), inside) == 1);
  }
  // Facets seen from each material close around it.
  for (MaterialId material = 1; material <= 3; ++material) {
    Vec3 area;
    for (std::size_t i = 0; i < surface.facets.size(); ++i) {
      const auto at = [&](std::size_t k) {
        return surface.points[static_cast<std::size_t>(surface.facets[i][k])];
      };
      const Sides& sides = surface.patch_of[i].sides;
      const Sides normal{std::max(sides.inside, sides.outside),
                         std::min(sides.inside, sides.outside)};
      if (sides.inside == material) area += area_vector2(at(0), at(1), at(2));
      if (sides.outside == material && !cut.contains(normal))
        area -= area_vector2(at(0), at(1), at(2));
    }
    CHECK(norm(area) < 1e-12);
  }
  for (const Contact& contact : after.contacts)
    for (const auto& [inner, outer] : contact.pairs)
      CHECK(position(after, inner) == position(after, outer));
  REQUIRE(after.original_of.size() == after.points.size() + after.mid_points.size());
  for (std::size_t node = 0; node < after.original_of.size(); ++node)
    CHECK(position(after, static_cast<std::int32_t>(node)) ==
          position(after, after.original_of[node]));
}

}  // namespace

TEST_CASE("split_contacts: a third material holds the rim of a cut together", "[tet][unit]") {
  for (const bool is_second_order : {false, true}) {
    CAPTURE(is_second_order);
    const TetMesh before = wedge(is_second_order);
    TetMesh after = before;
    const SplitContactsStats stats = split_contacts(after, {{2, 1}});
    check_cut(before, after, {{2, 1}});
    // Of the plane x = 2, the nodes with y < 2; those with y = 2 stay single.
    std::set<std::int32_t> on_cut;
    for (std::size_t t = 0; t < before.tets.size(); ++t)
      for (const std::int32_t node : nodes_of(before, t)) {
        const Vec3 p = position(before, node);
        if (p.x == 2 && p.y < 2) on_cut.insert(node);
      }
    CHECK(stats.nodes_added == on_cut.size());
    CHECK(stats.node_pairs == on_cut.size());
    REQUIRE(after.contacts.size() == 1);
    for (const auto& [inner, outer] : after.contacts[0].pairs)
      CHECK((inner == outer) == (position(after, inner).y == 2));
  }
}

TEST_CASE("split_contacts: where three interfaces are cut, their curve has three copies",
          "[tet][unit]") {
  for (const bool is_second_order : {false, true}) {
    CAPTURE(is_second_order);
    const TetMesh before = wedge(is_second_order);
    TetMesh after = before;
    split_contacts(after, {{2, 1}, {3, 1}, {3, 2}, {2, 1}});
    check_cut(before, after, {{2, 1}, {3, 1}, {3, 2}});
    CHECK(after.contacts.size() == 3);
    std::map<std::int32_t, int> copies;
    for (std::size_t node = 0; node < after.original_of.size(); ++node)
      ++copies[after.original_of[node]];
    for (const auto& [original, count] : copies) {
      const Vec3 p = position(after, original);
      const bool is_on_curve = p.x == 2 && p.y == 2;
      const bool is_on_plane = p.y == 2 || (p.x == 2 && p.y < 2);
      CHECK(count == (is_on_curve ? 3 : is_on_plane ? 2 : 1));
    }
  }
}

TEST_CASE("split_contacts: a ball inside another material comes loose altogether", "[tet][unit]") {
  const TetMesh before = simple_meshes::lattice_box(kSide, [](const Vec3& p) -> MaterialId {
    return std::max({std::abs(p.x - 2), std::abs(p.y - 2), std::abs(p.z - 2)}) < 1 ? 2 : 1;
  });
  TetMesh after = before;
  const SplitContactsStats stats = split_contacts(after, {{2, 1}});
  check_cut(before, after, {{2, 1}});
  CHECK(stats.nodes_added == 26);  // the surface of 2 x 2 x 2 cubes
  std::set<std::int32_t> of_ball, of_shell;
  for (std::size_t t = 0; t < after.tets.size(); ++t)
    (after.material_of[t] == 2 ? of_ball : of_shell)
        .insert(after.tets[t].begin(), after.tets[t].end());
  for (const std::int32_t node : of_ball)
    CHECK_FALSE(of_shell.contains(node));
}

TEST_CASE("split_contacts: materials that do not meet leave the mesh alone", "[tet][unit]") {
  const TetMesh before = wedge(true);
  TetMesh after = before;
  const SplitContactsStats stats = split_contacts(after, {{7, 1}});
  CHECK(stats.facets_cut == 0);
  CHECK(after.points == before.points);
  CHECK(after.contacts.empty());
  CHECK(after.original_of.empty());
}
