// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/lattice_topology.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/lattice_components.h"

#include <array>

namespace cvmesh {
namespace {

// The materials at the eight corners of the cube above (i, j, k); bit 0, 1, 2 of the corner is the
// step along x, y, z. Beyond the grid there is exterior.
std::array<MaterialId, 8> cube_at(const Grid<MaterialId>& ids, int i, int j, int k) {
  std::array<MaterialId, 8> cube{};
  for (int corner = 0; corner < 8; ++corner) {
    const int x = i + (corner & 1), y = j + (corner >> 1 & 1), z = k + (corner >> 2);
    cube[corner] = ids.frame.contains(x, y, z) ? ids(x, y, z) : kExterior;
  }
  return cube;
}

// V - E + F - T over the simplices whose lowest vertex is corner 0. A simplex is a chain of
// corners, each containing the bits of the one before: 7 edges, 12 triangles, 6 tets.
int simplices_above(const std::array<MaterialId, 8>& cube) {
  const MaterialId material = cube[0];
  int sum = 1;
  for (int a = 1; a < 8; ++a) {
    if (cube[a] != material) continue;
    --sum;
    for (int b = a + 1; b < 8; ++b) {
      if ((b & a) != a || cube[b] != material) continue;
      ++sum;
      for (int c = b + 1; c < 8; ++c) {
        if ((c & b) == b && cube[c] == material) --sum;
      }
    }
  }
  return sum;
}

// Euler numbers of all materials from the nodes of slice k.
std::vector<long long> euler_of_slice(const Grid<MaterialId>& ids, int k, std::size_t materials) {
  std::vector<long long> euler(materials, 0);
  const auto [nx, ny, nz] = ids.frame.dims;
  const auto at = [&](int i, int j, int z) { return ids.values[ids.frame.linear(i, j, z)]; };
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      const MaterialId m = at(i, j, k);
      if (m == kExterior) continue;
      // A cube of one material adds 1 - 7 + 12 - 6 = 0: most of a volume ends here.
      if (i + 1 < nx && j + 1 < ny && k + 1 < nz && at(i + 1, j, k) == m && at(i, j + 1, k) == m &&
          at(i + 1, j + 1, k) == m && at(i, j, k + 1) == m && at(i + 1, j, k + 1) == m &&
          at(i, j + 1, k + 1) == m && at(i + 1, j + 1, k + 1) == m) {
        continue;
      }
      euler[m] += simplices_above(cube_at(ids, i, j, k));
    }
  }
  return euler;
}

}  // namespace

std::vector<LatticeTopology> lattice_topology(const Grid<MaterialId>& ids,
                                              std::size_t material_count) {
  std::vector<LatticeTopology> result(material_count);
  const auto add = [](std::vector<long long> a, const std::vector<long long>& b) {
    for (std::size_t m = 0; m < a.size(); ++m)
      a[m] += b[m];
    return a;
  };
  const std::vector<long long> euler = deterministic_reduce(
      0, static_cast<std::size_t>(ids.frame.dims[2]), std::vector<long long>(material_count, 0),
      [&](std::size_t k) { return euler_of_slice(ids, static_cast<int>(k), material_count); }, add,
      16);
  const LatticeComponents components = find_lattice_components(ids);
  for (std::size_t c = 0; c < components.component_count(); ++c) {
    LatticeTopology& topology = result[components.material_of[c]];
    ++topology.components;
    topology.voxels += components.voxels_of[c];
  }
  for (std::size_t m = 0; m < material_count; ++m)
    result[m].euler = euler[m];
  return result;
}

}  // namespace cvmesh
