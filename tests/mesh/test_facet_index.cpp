// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/mesh/facet_predicates.h"

#include "support/catch.h"
#include <algorithm>
#include <set>

using namespace cvmesh;

namespace {

Box3 random_box(const CounterRandom& random, std::uint64_t id) {
  // sizes over a factor of a thousand
  const double size = 0.05 * std::pow(1000, random.uniform(id, 3));
  Box3 box;
  for (int k = 0; k < 3; ++k)
    box.lo[k] = 100 * random.uniform(id, k);
  box.hi = box.lo + size * Vec3{1, random.uniform(id, 4), 0.3};
  return box;
}

}  // namespace

TEST_CASE("FacetIndex: finds the boxes that overlap while boxes come and go", "[mesh][property]") {
  const CounterRandom random(1, "boxes");
  // holds the centres, not the boxes
  Box3 bounds;
  bounds.add({0, 0, 0});
  bounds.add({150, 150, 150});
  FacetIndex index(bounds, 1.0);
  std::vector<Box3> box;
  std::set<std::int32_t> living;
  for (std::int32_t id = 0; id < 2000; ++id) {
    box.push_back(random_box(random, id));
    index.insert(id, box.back());
    living.insert(id);
    if (id % 3 == 2) {
      const auto gone = static_cast<std::int32_t>(random.bits(id, 9) % (id + 1));
      if (living.erase(gone) > 0) index.remove(gone);
    }
  }
  for (std::uint64_t q = 0; q < 300; ++q) {
    const Box3 query = random_box(random, 10000 + q);
    std::set<std::int32_t> found, expected;
    index.query(query,
                [&](const FacetIndex::Entry& entry) { CHECK(found.insert(entry.id).second); });
    for (const auto id : living)
      if (box[id].overlaps(query)) expected.insert(id);
    // no random coordinates are within a rounding error of each other
    REQUIRE(found == expected);
  }
}

TEST_CASE("facets_intersect: shared vertices and edges are no intersection, everything else is",
          "[mesh][unit]") {
  //         0         1          2          3           4            5              6
  std::vector<Vec3> p{{0, 0, 0},     {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0.2, 0.2, -1}, {0.2, 0.2, 1},
                      {0.3, 0.1, 1}, {2, 2, 0}, {3, 2, 0}, {2, 3, 0}, {0.1, 0.1, 0}};
  CHECK_FALSE(facets_intersect(p, {0, 1, 2}, {1, 3, 2}));  // neighbours in a plane
  CHECK(facets_intersect(p, {0, 1, 2}, {0, 1, 3}));        // folded onto each other
  CHECK(facets_intersect(p, {0, 1, 2}, {4, 5, 6}));        // pierced
  CHECK_FALSE(facets_intersect(p, {0, 1, 2}, {7, 8, 9}));  // apart in one plane
  CHECK_FALSE(facets_intersect(p, {0, 1, 2}, {0, 5, 6}));  // touch in a vertex
  CHECK(facets_intersect(p, {0, 1, 2}, {2, 4, 5}));        // one vertex shared, and pierced
  CHECK(facets_intersect(p, {0, 1, 2}, {7, 8, 10}));       // a corner inside the other's plane
  CHECK(facets_intersect(p, {0, 1, 2}, {2, 1, 0}));        // the same facet
}

TEST_CASE("is_in_tet: inside, on the boundary, outside; never in a flat tet", "[mesh][unit]") {
  const Vec3 a{0, 0, 0}, b{1, 0, 0}, c{0, 1, 0}, d{0, 0, 1};
  CHECK(is_in_tet({0.1, 0.1, 0.1}, a, b, c, d));
  CHECK(is_in_tet({0.1, 0.1, 0.1}, b, a, c, d));
  CHECK(is_in_tet({0.25, 0.25, 0}, a, b, c, d));
  CHECK_FALSE(is_in_tet({0.5, 0.5, 0.5}, a, b, c, d));
  CHECK_FALSE(is_in_tet({0.1, 0.1, 0}, a, b, c, {1, 1, 0}));
}
