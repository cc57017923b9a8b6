// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/measure_deviation.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/medial/point_tree.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cvmesh {
namespace {

class DenseSurface {
 public:
  explicit DenseSurface(const InterfaceMesh& dense)
      : dense_(dense), stars_(find_vertex_stars(dense)), tree_(dense.points) {}

  // The nearest point of the facets around the dense vertex nearest to p.
  [[nodiscard]] Vec3 near(const Vec3& p) const {
    const auto v = tree_.nearest(p).index;
    Vec3 best = dense_.points[v];
    for (auto s = stars_.first[v]; s < stars_.first[v + 1]; ++s) {
      const auto& f = dense_.facets[stars_.facet[s]];
      const Vec3 q =
          nearest_on_triangle(p, dense_.points[f[0]], dense_.points[f[1]], dense_.points[f[2]]);
      if (squared_norm(q - p) < squared_norm(best - p)) best = q;
    }
    return best;
  }

 private:
  const InterfaceMesh& dense_;
  VertexStars stars_;
  PointTree tree_;
};

}  // namespace

Deviation measure_deviation(const MaterialSurfaces& surfaces,
                            const InterfaceMesh& dense,
                            double limit_mm) {
  const DenseSurface reference(dense);
  const auto& facets = surfaces.facets();
  std::vector<Deviation> of_facet(facets.size());
  parallel_for_each_index(
      0, facets.size(),
      [&](std::size_t n) {
        if (!facets[n].is_alive) return;
        const auto& v = facets[n].vertices;
        const std::array<Vec3, 3> p{surfaces.points()[v[0]], surfaces.points()[v[1]],
                                    surfaces.points()[v[2]]};
        const auto add = [&](const Vec3& on_dense, const Vec3& on_facet) {
          const double d = distance(on_dense, on_facet);
          of_facet[n].max_mm = std::max(of_facet[n].max_mm, d);
          if (d > limit_mm) of_facet[n].above.push_back({on_dense, d});
        };
        surfaces.for_each_sample(static_cast<std::int32_t>(n), [&](const Vec3& sample) {
          add(sample, nearest_on_triangle(sample, p[0], p[1], p[2]));
        });
        for (const Vec3& q : {(p[0] + p[1] + p[2]) / 3, 0.5 * (p[0] + p[1]), 0.5 * (p[1] + p[2]),
                              0.5 * (p[2] + p[0])})
          add(reference.near(q), q);
      },
      64);
  Deviation all;
  for (const Deviation& one : of_facet) {
    all.max_mm = std::max(all.max_mm, one.max_mm);
    all.above.insert(all.above.end(), one.above.begin(), one.above.end());
  }
  return all;
}

}  // namespace cvmesh
