// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/embedding_guard.h"

#include "support/catch.h"

using namespace cvmesh;

TEST_CASE("EmbeddingGuard: an apex does not jump over facets that hang in its own ring",
          "[surface][unit]") {
  // A speck of material 1 on a junction curve of four vertices: a cap of four facets around vertex
  // 4 towards material 2, and two facets without a vertex of their own towards the exterior. Above
  // it material 2 ends at vertex 5.
  InterfaceMesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, 1}, {0.5, 0.5, 5}};
  const Sides cap{1, 2}, base{1, 0}, roof{2, 0};
  const auto add = [&](const VertexTriple& facet, Sides sides) {
    mesh.facets.push_back(facet);
    mesh.patch_of.push_back({sides, 0});
  };
  for (std::int32_t k = 0; k < 4; ++k)
    add({k, (k + 1) % 4, 4}, cap);
  add({0, 2, 1}, base);
  add({0, 3, 2}, base);
  for (std::int32_t k = 0; k < 4; ++k)
    add({k, (k + 1) % 4, 5}, roof);
  const double z = GENERATE(0.5, -0.5);
  CAPTURE(z);
  const MaterialSurfaces before(mesh, 3);
  const Vec3 from = mesh.points[4];
  mesh.points[4].z = z;
  const MaterialSurfaces after(mesh, 3);

  const FacetIndex index = index_facets(before, 1);
  EmbeddingGuard guard(after, index, 1e-3);
  Box3 box;
  for (const Vec3& p : mesh.points)
    box.add(p);
  box.add(from);
  const std::vector<std::int32_t> star{0, 1, 2, 3}, ring{0, 1, 2, 3};
  guard.begin(box, star, ring);
  bool is_jump = false;
  for (const auto f : star) {
    const VertexTriple& t = after.facets()[f].vertices;
    CHECK_FALSE(guard.intersects_nearby(t));
    is_jump = is_jump || guard.sweeps_over_part(from, t);
  }
  CHECK(is_jump == (z < 0));
}
