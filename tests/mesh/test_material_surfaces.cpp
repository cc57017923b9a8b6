// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/material_surfaces.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include "surface/dense_phantoms.h"
#include <algorithm>

using namespace cvmesh;

namespace {

void require_valid(const MaterialSurfaces& surfaces, const dense_phantoms::DensePhantom& dense) {
  const Validation validation = surfaces.validate();
  INFO(validation.summary());
  REQUIRE(validation.is_valid());
  const auto is = boundary_topology(surfaces.to_interface_mesh(), dense.material_count);
  const auto was = boundary_topology(dense.mesh, dense.material_count);
  for (std::size_t m = 0; m < dense.material_count; ++m) {
    CAPTURE(m);
    REQUIRE(is[m].is_closed_manifold);
    REQUIRE(is[m].components == was[m].components);
    REQUIRE(is[m].euler == was[m].euler);
  }
}

std::int32_t nth_living_facet(const MaterialSurfaces& surfaces, std::uint64_t n) {
  const auto count = surfaces.facets().size();
  for (std::size_t tried = 0; tried < count; ++tried) {
    const auto f = static_cast<std::int32_t>((n + tried) % count);
    if (surfaces.facets()[f].is_alive) return f;
  }
  return -1;
}

bool has_edge(const MaterialSurfaces& surfaces, std::int32_t a, std::int32_t b) {
  std::vector<std::int32_t> star;
  surfaces.collect_star(a, star);
  return std::any_of(star.begin(), star.end(), [&](std::int32_t f) {
    const auto& v = surfaces.facets()[f].vertices;
    return std::find(v.begin(), v.end(), b) != v.end();
  });
}

}  // namespace

TEST_CASE("MaterialSurfaces: a copy gives back the same facets", "[mesh][unit]") {
  const auto dense = dense_phantoms::make(phantoms::three_material_wedge(70, 6));
  const MaterialSurfaces surfaces(dense.mesh, dense.material_count);
  const InterfaceMesh copy = surfaces.to_interface_mesh();
  CHECK(copy.points == dense.mesh.points);
  CHECK(copy.facets.size() == dense.mesh.facets.size());
  require_valid(surfaces, dense);
}

TEST_CASE("MaterialSurfaces: splits and flips keep every invariant, edit by edit",
          "[mesh][property]") {
  for (const InputVolume& volume :
       {phantoms::three_material_wedge(60, 4), phantoms::four_material_corner(4),
        phantoms::box_without_background({6, 5, 4}), phantoms::voxel_noise(3, 4, 4)}) {
    const auto dense = dense_phantoms::make(volume);
    MaterialSurfaces surfaces(dense.mesh, dense.material_count);
    const CounterRandom random(5, "edits");
    for (std::uint64_t edit = 0; edit < 60; ++edit) {
      const std::int32_t f = nth_living_facet(surfaces, random.bits(edit));
      const auto v = surfaces.facets()[f].vertices;
      const auto& p = surfaces.points();
      const int c = static_cast<int>(random.bits(edit, 1) % 3);
      const std::int32_t a = v[c], b = v[(c + 1) % 3];
      switch (random.bits(edit, 2) % 3) {
        case 0:
          surfaces.split_facet(f, (p[v[0]] + p[v[1]] + p[v[2]]) / 3);
          break;
        case 1:
          surfaces.split_edge(a, b, 0.5 * (p[a] + p[b]));
          break;
        default: {
          std::int32_t first = -1, second = -1;
          if (!surfaces.facets_of_edge(a, b, first, second)) continue;
          const auto opposite = [&](std::int32_t g) {
            const auto& w = surfaces.facets()[g].vertices;
            return *std::find_if(w.begin(), w.end(), [&](auto x) { return x != a && x != b; });
          };
          if (has_edge(surfaces, opposite(first), opposite(second))) continue;
          surfaces.flip_edge(a, b);
        }
      }
      require_valid(surfaces, dense);
    }
  }
}

TEST_CASE("facet_across: what a search for the facets of the edge finds", "[mesh][property]") {
  for (const InputVolume& volume :
       {phantoms::three_material_wedge(70, 6), phantoms::voxel_noise(3, 4, 4)}) {
    const auto dense = dense_phantoms::make(volume);
    const MaterialSurfaces surfaces(dense.mesh, dense.material_count);
    std::size_t inside = 0, on_curves = 0;
    for (std::size_t f = 0; f < surfaces.facets().size(); ++f) {
      const auto facet = static_cast<std::int32_t>(f);
      const auto v = surfaces.facets()[f].vertices;
      for (std::size_t c = 0; c < 3; ++c) {
        const std::int32_t a = v[c], b = v[(c + 1) % 3];
        const std::int32_t across = surfaces.facet_across(facet, a, b);
        REQUIRE(across == surfaces.facet_across(facet, b, a));
        std::int32_t first = -1, second = -1;
        if (surfaces.facets_of_edge(a, b, first, second)) {
          ++inside;
          REQUIRE(first == facet);
          REQUIRE(across == second);
        } else {
          ++on_curves;
          REQUIRE(across == -1);
        }
      }
      REQUIRE(surfaces.facet_across(facet, v[0], -1) == -1);
    }
    CHECK(inside > 0);
    CHECK(on_curves > 0);
  }
}

TEST_CASE("collect_sheets: an interface vertex has one disk, a curve vertex three half-disks",
          "[mesh][unit]") {
  const auto dense = dense_phantoms::make(phantoms::three_material_wedge(90, 6));
  const MaterialSurfaces surfaces(dense.mesh, dense.material_count);
  std::vector<MaterialSurfaces::Sheet> sheets;
  std::size_t on_curves = 0;
  for (std::size_t v = 0; v < dense.mesh.points.size(); ++v) {
    const bool is_regular = surfaces.collect_sheets(static_cast<std::int32_t>(v), sheets);
    CAPTURE(v);
    REQUIRE(is_regular == (dense.strata.dimension[v] != 0));
    if (!is_regular) continue;
    if (dense.strata.dimension[v] == 2) {
      REQUIRE(sheets.size() == 1);
      REQUIRE(sheets[0].is_disk);
      REQUIRE(sheets[0].ring.size() == sheets[0].facets.size());
    } else {
      ++on_curves;
      REQUIRE(sheets.size() == 3);
      for (const auto& sheet : sheets) {
        REQUIRE_FALSE(sheet.is_disk);
        REQUIRE(sheet.ring.size() == sheet.facets.size() + 1);
      }
    }
    for (const auto& sheet : sheets)
      for (std::size_t i = 0; i < sheet.facets.size(); ++i) {
        // facet i spans ring i, i + 1, in the order of the facet
        auto vertices = surfaces.facets()[sheet.facets[i]].vertices;
        std::rotate(vertices.begin(),
                    std::find(vertices.begin(), vertices.end(), static_cast<std::int32_t>(v)),
                    vertices.end());
        REQUIRE(vertices[1] == sheet.ring[i]);
        REQUIRE(vertices[2] == sheet.ring[(i + 1) % sheet.ring.size()]);
      }
  }
  CHECK(on_curves > 0);
}

TEST_CASE("MaterialSurfaces: an open surface is an internal error", "[mesh][unit]") {
  auto dense = dense_phantoms::make(phantoms::ball(3));
  dense.mesh.facets.pop_back();
  dense.mesh.patch_of.pop_back();
  CHECK_THROWS_AS(MaterialSurfaces(dense.mesh, dense.material_count), Error);
}
