// SPDX-License-Identifier: AGPL-3.0-or-later
#include "metrics/simple_meshes.h"

#include <algorithm>
#include <map>
#include <utility>

namespace cvmesh::simple_meshes {
namespace {

using Triangle = std::array<std::int32_t, 3>;

InterfaceMesh with_sides(std::vector<Vec3> points, std::vector<Triangle> facets, Sides sides) {
  InterfaceMesh mesh;
  mesh.points = std::move(points);
  mesh.facets = std::move(facets);
  mesh.patch_of.assign(mesh.facets.size(), {sides, 0});
  return mesh;
}

// One step of subdivision, new vertices at the middles of the edges.
void subdivide(std::vector<Vec3>& points, std::vector<Triangle>& facets) {
  std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middle_of;
  const auto middle = [&](std::int32_t a, std::int32_t b) {
    const auto [entry, is_new] =
        middle_of.try_emplace(std::minmax(a, b), static_cast<std::int32_t>(points.size()));
    if (is_new) points.push_back(0.5 * (points[a] + points[b]));
    return entry->second;
  };
  std::vector<Triangle> result;
  for (const auto& [a, b, c] : facets) {
    const auto ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    result.insert(result.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
  }
  facets = std::move(result);
}

/// The faces between tets of different materials, and the outside.
void find_surface(TetMesh& mesh) {
  constexpr std::array<Triangle, 4> kFaces{{{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
  std::map<Triangle, std::pair<Triangle, MaterialId>> open;
  mesh.surface.points = mesh.points;
  const auto add = [&](const Triangle& t, Sides sides) {
    mesh.surface.facets.push_back(t);
    mesh.surface.patch_of.push_back({sides, 0});
  };
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    for (const Triangle& face : kFaces) {
      const Triangle outward{mesh.tets[t][face[0]], mesh.tets[t][face[1]], mesh.tets[t][face[2]]};
      Triangle key = outward;
      std::sort(key.begin(), key.end());
      const auto found = open.find(key);
      if (found == open.end()) {
        open[key] = {outward, mesh.material_of[t]};
        continue;
      }
      const auto [other, material] = found->second;
      if (material < mesh.material_of[t]) add(outward, {mesh.material_of[t], material});
      if (material > mesh.material_of[t]) add(other, {material, mesh.material_of[t]});
      open.erase(found);
    }
  }
  for (const auto& [key, face] : open)
    add(face.first, {face.second, kExterior});
}

}  // namespace

InterfaceMesh square(double side, double z) {
  return with_sides({{0, 0, z}, {side, 0, z}, {side, side, z}, {0, side, z}},
                    {{0, 1, 2}, {0, 2, 3}}, {1, 0});
}

InterfaceMesh corner_tetrahedron(double size) {
  return with_sides({{0, 0, 0}, {size, 0, 0}, {0, size, 0}, {0, 0, size}},
                    {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}, {1, 0});
}

InterfaceMesh sphere(const Vec3& centre, double radius, int levels, Sides sides) {
  const double t = (1 + std::sqrt(5.0)) / 2;
  std::vector<Vec3> points{{-1, t, 0}, {1, t, 0}, {-1, -t, 0}, {1, -t, 0},
                           {0, -1, t}, {0, 1, t}, {0, -1, -t}, {0, 1, -t},
                           {t, 0, -1}, {t, 0, 1}, {-t, 0, -1}, {-t, 0, 1}};
  std::vector<Triangle> facets{{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                               {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                               {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                               {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int level = 0; level < levels; ++level)
    subdivide(points, facets);
  for (Vec3& p : points)
    p = centre + radius * normalized(p);
  return with_sides(std::move(points), std::move(facets), sides);
}

TetMesh two_material_cube() {
  TetMesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    mesh.points.push_back({double(corner & 1), double(corner >> 1 & 1), double(corner >> 2)});
  }
  // Chains 0, a, b, 7 of corners; odd permutations of the axes need a swap to be positive.
  mesh.tets = {{0, 1, 3, 7}, {0, 5, 1, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 6, 4, 7}};
  // y steps before x: the tets through corner 2, and that through 4 and 6.
  mesh.material_of = {2, 2, 1, 1, 2, 1};
  find_surface(mesh);
  return mesh;
}

TetMesh lattice_box(int n, const std::function<MaterialId(const Vec3&)>& material_at) {
  constexpr int kWays[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  TetMesh mesh;
  const auto number = [n](const std::array<int, 3>& p) {
    return (p[2] * (n + 1) + p[1]) * (n + 1) + p[0];
  };
  for (int k = 0; k <= n; ++k)
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i)
        mesh.points.push_back(Vec3{1.0 * i, 1.0 * j, 1.0 * k});
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        for (const auto& way : kWays) {
          // From one end of the cube's diagonal to the other, along its edges.
          std::array<int, 3> p = {i, j, k};
          std::array<std::int32_t, 4> tet = {number(p), 0, 0, 0};
          for (std::size_t step = 0; step < 3; ++step) {
            ++p[static_cast<std::size_t>(way[step])];
            tet[step + 1] = number(p);
          }
          const auto at = [&](std::size_t c) {
            return mesh.points[static_cast<std::size_t>(tet[c])];
          };
          if (volume6(at(0), at(1), at(2), at(3)) < 0) std::swap(tet[2], tet[3]);
          mesh.tets.push_back(tet);
          mesh.material_of.push_back(material_at({i + 0.5, j + 0.5, k + 0.5}));
        }
  find_surface(mesh);
  return mesh;
}

InterfaceMesh together(const InterfaceMesh& a, const InterfaceMesh& b) {
  InterfaceMesh result = a;
  const auto shift = static_cast<std::int32_t>(a.points.size());
  result.points.insert(result.points.end(), b.points.begin(), b.points.end());
  for (const auto& [i, j, k] : b.facets) {
    result.facets.push_back({i + shift, j + shift, k + shift});
  }
  result.patch_of.insert(result.patch_of.end(), b.patch_of.begin(), b.patch_of.end());
  return result;
}

}  // namespace cvmesh::simple_meshes
