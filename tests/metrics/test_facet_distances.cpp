// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/facet_distances.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <numeric>

using namespace cvmesh;

TEST_CASE("Histogram: keeps all weight, beyond its ends, too", "[metrics][unit]") {
  Histogram histogram(0, 2, 4);
  histogram.add(-1);
  histogram.add(0.6, 2.5);
  histogram.add(2);
  histogram.add(99);
  CHECK(histogram.weights == std::vector<double>{1, 2.5, 0, 2});
}

TEST_CASE("measure_facet_distances: parallel squares are as far apart as they are everywhere",
          "[metrics][unit]") {
  const InterfaceMesh square = simple_meshes::square(4, 1);
  const FacetDistances distances =
      measure_facet_distances(square, simple_meshes::square(9, 1.75), 0.5);
  CHECK(distances.largest_mm == std::vector<float>{0.75F, 0.75F});
  CHECK(distances.mean_mm == Approx(0.75));
  CHECK(distances.max_mm == Approx(0.75));
  const auto& area = distances.area_mm2.weights;
  CHECK(std::accumulate(area.begin(), area.end(), 0.0) == Approx(16));
  CHECK(area.back() == Approx(16));
}

TEST_CASE("measure_facet_distances: facets of a sphere are lowest in their middle",
          "[metrics][unit]") {
  // 80 facets with vertices on the sphere of radius 10, against 20,480: between the chord and the
  // sphere, at the middle of a facet with the corners a, b, c, lies 10 - |a + b + c| / 3.
  const InterfaceMesh coarse = simple_meshes::sphere({}, 10, 1);
  const InterfaceMesh fine = simple_meshes::sphere({}, 10, 5);
  const FacetDistances distances = measure_facet_distances(coarse, fine, 0.25);
  REQUIRE(distances.largest_mm.size() == coarse.facets.size());
  for (std::size_t f = 0; f < coarse.facets.size(); ++f) {
    const auto& [a, b, c] = coarse.facets[f];
    const Vec3 middle = (coarse.points[a] + coarse.points[b] + coarse.points[c]) / 3;
    // The facets are not regular and the fine sphere is a polyhedron itself: 0.01 mm for both.
    CHECK(distances.largest_mm[f] >= 10 - norm(middle) - 0.01);
    CHECK(distances.largest_mm[f] <= 10 - norm(middle) + 0.05);
  }
  CHECK(distances.mean_mm < distances.max_mm);
  CHECK(distances.max_mm ==
        *std::max_element(distances.largest_mm.begin(), distances.largest_mm.end()));
}

TEST_CASE("measure_facet_distances: a surface lies on itself", "[metrics][unit]") {
  const InterfaceMesh sphere = simple_meshes::sphere({}, 5, 2);
  const FacetDistances distances = measure_facet_distances(sphere, sphere, 1);
  CHECK(distances.max_mm < 1e-6);
}
