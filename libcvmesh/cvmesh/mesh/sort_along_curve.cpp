// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/sort_along_curve.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>

namespace cvmesh {
namespace {

// Two zero bits between any two of the lowest 21 bits.
std::uint64_t spread(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffff;
  x = (x | x << 16) & 0x1f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  x = (x | x << 2) & 0x1249249249249249;
  return x;
}

using Ranked = std::pair<std::uint64_t, std::int32_t>;  // where on the curve, old number

// Where the cell of a point is on the curve.
std::uint64_t place_on_curve(const Vec3& p, const Vec3& origin, double cell_mm) {
  const Vec3 cell = (p - origin) / cell_mm;
  return spread(static_cast<std::uint64_t>(cell.x)) |
         spread(static_cast<std::uint64_t>(cell.y)) << 1 |
         spread(static_cast<std::uint64_t>(cell.z)) << 2;
}

Box3 bounds_of(const std::vector<Vec3>& points) {
  Box3 box;
  for (const Vec3& p : points)
    box.add(p);
  return box;
}

}  // namespace

void sort_along_curve(InterfaceMesh& mesh, double cell_mm) {
  const Box3 box = bounds_of(mesh.points);
  std::vector<Ranked> order(mesh.points.size());
  parallel_for_each_index(0, order.size(), [&](std::size_t v) {
    order[v] = {place_on_curve(mesh.points[v], box.lo, cell_mm), static_cast<std::int32_t>(v)};
  });
  parallel_sort(order.begin(), order.end());
  std::vector<Vec3> points(order.size());
  std::vector<std::int32_t> new_number(order.size());
  parallel_for_each_index(0, order.size(), [&](std::size_t n) {
    const auto old = static_cast<std::size_t>(order[n].second);
    points[n] = mesh.points[old];
    new_number[old] = static_cast<std::int32_t>(n);
  });
  mesh.points = std::move(points);

  std::vector<Ranked> facet_order(mesh.facets.size());
  parallel_for_each_index(0, facet_order.size(), [&](std::size_t f) {
    auto& vertices = mesh.facets[f];
    for (auto& v : vertices)
      v = new_number[static_cast<std::size_t>(v)];
    facet_order[f] = {
        static_cast<std::uint64_t>(*std::min_element(vertices.begin(), vertices.end())),
        static_cast<std::int32_t>(f)};
  });
  parallel_sort(facet_order.begin(), facet_order.end());
  std::vector<std::array<std::int32_t, 3>> facets(facet_order.size());
  std::vector<PatchKey> patch_of(facet_order.size());
  parallel_for_each_index(0, facet_order.size(), [&](std::size_t n) {
    const auto old = static_cast<std::size_t>(facet_order[n].second);
    facets[n] = mesh.facets[old];
    patch_of[n] = mesh.patch_of[old];
  });
  mesh.facets = std::move(facets);
  mesh.patch_of = std::move(patch_of);
}

void sort_along_curve(TetMesh& mesh, double cell_mm) {
  const Box3 box = bounds_of(mesh.points);
  const std::size_t first = mesh.surface.points.size();
  std::vector<Ranked> order(mesh.points.size() - first);
  parallel_for_each_index(0, order.size(), [&](std::size_t n) {
    order[n] = {place_on_curve(mesh.points[first + n], box.lo, cell_mm),
                static_cast<std::int32_t>(first + n)};
  });
  parallel_sort(order.begin(), order.end());
  std::vector<Vec3> points(mesh.points.begin(),
                           mesh.points.begin() + static_cast<std::ptrdiff_t>(first));
  std::vector<std::int32_t> new_number(mesh.points.size());
  std::iota(new_number.begin(), new_number.end(), 0);
  for (const Ranked& ranked : order) {
    new_number[static_cast<std::size_t>(ranked.second)] = static_cast<std::int32_t>(points.size());
    points.push_back(mesh.points[static_cast<std::size_t>(ranked.second)]);
  }
  mesh.points = std::move(points);

  std::vector<Ranked> tet_order(mesh.tets.size());
  parallel_for_each_index(0, tet_order.size(), [&](std::size_t t) {
    Vec3 centroid;
    for (std::int32_t& v : mesh.tets[t]) {
      v = new_number[static_cast<std::size_t>(v)];
      centroid += mesh.points[static_cast<std::size_t>(v)] / 4;
    }
    tet_order[t] = {place_on_curve(centroid, box.lo, cell_mm), static_cast<std::int32_t>(t)};
  });
  parallel_sort(tet_order.begin(), tet_order.end());
  std::vector<std::array<std::int32_t, 4>> tets(tet_order.size());
  std::vector<MaterialId> material_of(tet_order.size());
  parallel_for_each_index(0, tet_order.size(), [&](std::size_t n) {
    const auto old = static_cast<std::size_t>(tet_order[n].second);
    tets[n] = mesh.tets[old];
    material_of[n] = mesh.material_of[old];
  });
  mesh.tets = std::move(tets);
  mesh.material_of = std::move(material_of);
}

}  // namespace cvmesh
