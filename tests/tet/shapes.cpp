// SPDX-License-Identifier: AGPL-3.0-or-later
#include "tet/shapes.h"

#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/tetrahedralize.h"

#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <utility>

namespace cvmesh::shapes {
namespace {

std::size_t at(std::int32_t i) {
  return static_cast<std::size_t>(i);
}

void add_facet(InterfaceMesh& mesh, std::int32_t a, std::int32_t b, std::int32_t c, Sides sides) {
  mesh.facets.push_back({a, b, c});
  mesh.patch_of.push_back({sides, 0});
}

/// Two copies of one point become one; the order of first appearance stays.
InterfaceMesh merged(const InterfaceMesh& mesh) {
  InterfaceMesh result;
  std::map<std::array<double, 3>, std::int32_t> index_of;
  std::vector<std::int32_t> new_index;
  for (const Vec3& p : mesh.points) {
    const auto [place, is_new] =
        index_of.try_emplace({p.x, p.y, p.z}, static_cast<std::int32_t>(result.points.size()));
    if (is_new) result.points.push_back(p);
    new_index.push_back(place->second);
  }
  std::map<std::array<std::int32_t, 3>, std::size_t> facet_of;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    std::array<std::int32_t, 3> facet;
    for (std::size_t k = 0; k < 3; ++k)
      facet[k] = new_index[at(mesh.facets[f][k])];
    std::array<std::int32_t, 3> key = facet;
    std::sort(key.begin(), key.end());
    const Sides sides = mesh.patch_of[f].sides;
    const auto [place, is_new] = facet_of.try_emplace(key, result.facets.size());
    if (is_new) {
      add_facet(result, facet[0], facet[1], facet[2], sides);
      continue;
    }
    Sides& first = result.patch_of[place->second].sides;
    auto& corners = result.facets[place->second];
    if (sides.inside > first.inside) {
      corners = facet;
      first = {sides.inside, first.inside};
    } else {
      first = {first.inside, sides.inside};
    }
  }
  return result;
}

}  // namespace

InterfaceMesh sphere(const Vec3& centre, double radius, int levels, Sides sides) {
  const double t = std::numbers::phi;
  InterfaceMesh mesh;
  mesh.points = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                 {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
  std::vector<std::array<std::int32_t, 3>> facets = {
      {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
      {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
      {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middle_of;
    const auto middle = [&](std::int32_t a, std::int32_t b) {
      const auto [place, is_new] =
          middle_of.try_emplace(std::minmax(a, b), static_cast<std::int32_t>(mesh.points.size()));
      if (is_new) mesh.points.push_back(mesh.points[at(a)] + mesh.points[at(b)]);
      return place->second;
    };
    for (Vec3& p : mesh.points)
      p = normalized(p);
    std::vector<std::array<std::int32_t, 3>> finer;
    for (const auto& [a, b, c] : facets) {
      const std::int32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.push_back({a, ab, ca});
      finer.push_back({b, bc, ab});
      finer.push_back({c, ca, bc});
      finer.push_back({ab, bc, ca});
    }
    facets = std::move(finer);
  }
  for (Vec3& p : mesh.points)
    p = centre + radius * normalized(p);
  for (const auto& [a, b, c] : facets)
    add_facet(mesh, a, b, c, sides);
  return mesh;
}

InterfaceMesh box(const Vec3& lo, const Vec3& hi, int n, Sides sides) {
  InterfaceMesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (int high = 0; high < 2; ++high) {
      const std::int32_t base = static_cast<std::int32_t>(mesh.points.size());
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
          Vec3 p;
          p[axis] = high ? hi[axis] : lo[axis];
          p[u] = i == n ? hi[u] : lo[u] + (hi[u] - lo[u]) * i / n;
          p[v] = j == n ? hi[v] : lo[v] + (hi[v] - lo[v]) * j / n;
          mesh.points.push_back(p);
        }
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          const std::int32_t a = base + j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
          if (high) {
            add_facet(mesh, a, b, d, sides);
            add_facet(mesh, a, d, c, sides);
          } else {
            add_facet(mesh, a, d, b, sides);
            add_facet(mesh, a, c, d, sides);
          }
        }
    }
  return merged(mesh);
}

InterfaceMesh torus(double major, double minor, int around, int across, Sides sides) {
  InterfaceMesh mesh;
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const double u = 2 * std::numbers::pi * i / around, v = 2 * std::numbers::pi * j / across;
      const double r = major + minor * std::cos(v);
      mesh.points.push_back({r * std::cos(u), r * std::sin(u), minor * std::sin(v)});
    }
  const auto index = [&](int i, int j) { return (i % around) * across + j % across; };
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const std::int32_t a = index(i, j), b = index(i + 1, j), c = index(i, j + 1),
                         d = index(i + 1, j + 1);
      add_facet(mesh, a, b, d, sides);
      add_facet(mesh, a, d, c, sides);
    }
  return mesh;
}

InterfaceMesh single_tet(double size, Sides sides) {
  InterfaceMesh mesh;
  mesh.points = {{0, 0, 0}, {size, 0, 0}, {0, size, 0}, {0, 0, size}};
  add_facet(mesh, 1, 2, 3, sides);
  add_facet(mesh, 0, 3, 2, sides);
  add_facet(mesh, 0, 1, 3, sides);
  add_facet(mesh, 0, 2, 1, sides);
  return mesh;
}

InterfaceMesh join(const InterfaceMesh& a, const InterfaceMesh& b) {
  InterfaceMesh both = a;
  const std::int32_t shift = static_cast<std::int32_t>(a.points.size());
  both.points.insert(both.points.end(), b.points.begin(), b.points.end());
  for (std::size_t f = 0; f < b.facets.size(); ++f)
    add_facet(both, b.facets[f][0] + shift, b.facets[f][1] + shift, b.facets[f][2] + shift,
              b.patch_of[f].sides);
  return merged(both);
}

double enclosed_volume(const InterfaceMesh& mesh, Sides sides) {
  double volume = 0;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f)
    if (mesh.patch_of[f].sides == sides)
      volume += volume6({}, mesh.points[at(mesh.facets[f][0])], mesh.points[at(mesh.facets[f][1])],
                        mesh.points[at(mesh.facets[f][2])]) /
                6;
  return volume;
}

SizingField sizing(const Vec3& hi, const std::function<double(const Vec3&)>& h) {
  constexpr int kNodes = 33;
  GridFrame frame;
  frame.dims = {kNodes, kNodes, kNodes};
  frame.spacing_mm = hi / (kNodes - 1);
  SizingField field;
  field.volume_h_mm = Grid<float>(frame);
  for (int k = 0; k < kNodes; ++k)
    for (int j = 0; j < kNodes; ++j)
      for (int i = 0; i < kNodes; ++i)
        field.volume_h_mm(i, j, k) =
            static_cast<float>(h(scaled_by({double(i), double(j), double(k)}, frame.spacing_mm)));
  return field;
}

TetMesh filled(const InterfaceMesh& surface) {
  find_helper();
  TetrahedralizeOptions options;
  options.improvement_passes = 0;
  return tetrahedralize(surface, 3, sizing({40, 40, 40}, [](const Vec3&) { return 4.0; }), options,
                        silent_context())
      .tets;
}

TetMesh thin_wall() {
  const Vec3 centre{20, 20, 20};
  return filled(join(sphere(centre, 15, 3, {1, 0}), sphere(centre, 13.5, 3, {2, 1})));
}

std::vector<std::pair<std::array<Vec3, 4>, MaterialId>> places(const TetMesh& mesh) {
  const auto is_less = [](const Vec3& a, const Vec3& b) {
    return std::array{a.x, a.y, a.z} < std::array{b.x, b.y, b.z};
  };
  std::vector<std::pair<std::array<Vec3, 4>, MaterialId>> result;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    std::array<Vec3, 4> corners;
    for (std::size_t k = 0; k < 4; ++k)
      corners[k] = mesh.points[static_cast<std::size_t>(mesh.tets[t][k])];
    std::sort(corners.begin(), corners.end(), is_less);
    result.emplace_back(corners, mesh.material_of[t]);
  }
  std::sort(result.begin(), result.end(), [&](const auto& a, const auto& b) {
    return std::lexicographical_compare(a.first.begin(), a.first.end(), b.first.begin(),
                                        b.first.end(), is_less);
  });
  return result;
}

std::vector<double> volumes(const TetMesh& mesh) {
  std::vector<double> sums(3, 0.0);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    sums[mesh.material_of[t]] +=
        volume6(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]) / 6;
  }
  return sums;
}

void require_valid(const TetMesh& mesh) {
  REQUIRE(std::equal(mesh.surface.points.begin(), mesh.surface.points.end(), mesh.points.begin()));
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  REQUIRE(validation.is_valid());
}

void find_helper() {
#ifdef CVMESH_TETGEN_HELPER_BUILD_PATH
  setenv("CVMESH_TETGEN_HELPER", CVMESH_TETGEN_HELPER_BUILD_PATH, 0);
#endif
}

}  // namespace cvmesh::shapes
