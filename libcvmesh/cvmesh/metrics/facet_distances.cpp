// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/facet_distances.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/shape_tree.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cvmesh {
namespace {

constexpr std::size_t kBins = 60;
constexpr std::size_t kGrain = 64;  // facets that are measured one after the other

using Corners = std::array<Vec3, 3>;

Corners corners_of(const InterfaceMesh& mesh, std::size_t f) {
  const auto& [i, j, k] = mesh.facets[f];
  return {mesh.points[i], mesh.points[j], mesh.points[k]};
}

// The facets of a mesh as the search tree wants them.
struct FacetShapes {
  const InterfaceMesh& mesh;

  [[nodiscard]] std::size_t size() const { return mesh.facets.size(); }

  [[nodiscard]] Box3 box(std::size_t f) const {
    Box3 result;
    for (const Vec3& corner : corners_of(mesh, f))
      result.add(corner);
    return result;
  }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    const auto [a, b, c] = corners_of(mesh, f);
    return squared_norm(p - nearest_on_triangle(p, a, b, c));
  }
};

int divisions(const Corners& corners, double spacing_mm) {
  const auto& [a, b, c] = corners;
  const double longest = std::max({distance(a, b), distance(b, c), distance(c, a)});
  return std::max(2, static_cast<int>(std::ceil(longest / spacing_mm)));
}

// Calls visit(p) for the centres of the n x n equal triangles that make up a facet.
template <typename Visit>
void for_each_centre(const Corners& corners, int n, const Visit& visit) {
  const auto& [a, b, c] = corners;
  const auto at = [&](double i, double j) { return a + (i / n) * (b - a) + (j / n) * (c - a); };
  constexpr double kThird = 1.0 / 3;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; i + j < n; ++j) {
      visit(at(i + kThird, j + kThird));
      if (i + j + 1 < n) visit(at(i + 2 * kThird, j + 2 * kThird));
    }
  }
}

}  // namespace

FacetDistances measure_facet_distances(const InterfaceMesh& surface,
                                       const InterfaceMesh& reference,
                                       double sample_spacing_mm) {
  const std::size_t count = surface.facets.size();
  const FacetShapes shapes{reference};
  const ShapeTree<FacetShapes> tree(shapes);
  std::vector<std::vector<float>> samples(count);
  parallel_for_each_index(
      0, count,
      [&](std::size_t f) {
        const Corners corners = corners_of(surface, f);
        std::int64_t guess = -1;
        for_each_centre(corners, divisions(corners, sample_spacing_mm), [&](const Vec3& p) {
          const auto hit = tree.nearest(p, guess, [](std::size_t) { return true; });
          guess = hit.shape;
          samples[f].push_back(static_cast<float>(std::sqrt(hit.squared_distance)));
        });
      },
      kGrain);

  FacetDistances result;
  for (const std::vector<float>& of_facet : samples)
    result.largest_mm.push_back(*std::max_element(of_facet.begin(), of_facet.end()));
  for (const float largest : result.largest_mm)
    result.max_mm = std::max(result.max_mm, static_cast<double>(largest));
  // Surfaces that coincide still need bins of some width.
  result.area_mm2 = Histogram(0, result.max_mm > 0 ? result.max_mm : 1, kBins);
  double area_sum = 0;
  for (std::size_t f = 0; f < count; ++f) {
    const auto [a, b, c] = corners_of(surface, f);
    const double area = norm(area_vector2(a, b, c)) / 2;
    const double share = area / static_cast<double>(samples[f].size());
    area_sum += area;
    for (const float d : samples[f]) {
      result.area_mm2.add(d, share);
      result.mean_mm += share * d;
    }
  }
  if (area_sum > 0) result.mean_mm /= area_sum;
  return result;
}

}  // namespace cvmesh
