// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/lattice_components.h"
#include "cvmesh/labels/lattice_topology.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include <algorithm>
#include <set>

using namespace cvmesh;

namespace {

Grid<MaterialId> ids_of(const InputVolume& volume) {
  Grid<MaterialId> ids(volume.frame);
  for (std::size_t i = 0; i < ids.values.size(); ++i) {
    ids.values[i] = static_cast<MaterialId>(volume.values[i]);
  }
  return ids;
}

Grid<MaterialId> empty(int nx, int ny, int nz) {
  GridFrame frame;
  frame.dims = {nx, ny, nz};
  return Grid<MaterialId>(frame);
}

LatticeTopology topology_of(const Grid<MaterialId>& ids, MaterialId material = 1) {
  return lattice_topology(ids, material + std::size_t{1})[material];
}

// Components and Euler number by the definition, voxel by voxel and simplex by simplex.
LatticeTopology by_definition(const Grid<MaterialId>& ids, MaterialId material) {
  LatticeTopology result;
  const auto [nx, ny, nz] = ids.frame.dims;
  const auto is_in = [&](std::array<int, 3> v) {
    return ids.frame.contains(v[0], v[1], v[2]) && ids(v[0], v[1], v[2]) == material;
  };
  const auto step = [](std::array<int, 3> v, int corner, int sign) {
    return std::array<int, 3>{v[0] + sign * (corner & 1), v[1] + sign * (corner >> 1 & 1),
                              v[2] + sign * (corner >> 2)};
  };
  std::set<std::array<int, 3>> left;
  for (int k = 0; k < nz; ++k) {
    for (int j = 0; j < ny; ++j) {
      for (int i = 0; i < nx; ++i) {
        if (!is_in({i, j, k})) continue;
        left.insert({i, j, k});
        ++result.voxels;
        ++result.euler;
        for (int a = 1; a < 8; ++a) {
          if (!is_in(step({i, j, k}, a, 1))) continue;
          --result.euler;
          for (int b = 1; b < 8; ++b) {
            if ((a & b) != a || a == b || !is_in(step({i, j, k}, b, 1))) continue;
            ++result.euler;
            for (int c = 1; c < 8; ++c) {
              if ((b & c) == b && b != c && is_in(step({i, j, k}, c, 1))) --result.euler;
            }
          }
        }
      }
    }
  }
  while (!left.empty()) {
    ++result.components;
    std::vector<std::array<int, 3>> queue{*left.begin()};
    left.erase(left.begin());
    while (!queue.empty()) {
      const auto v = queue.back();
      queue.pop_back();
      for (int corner = 1; corner < 8; ++corner) {
        for (const int sign : {-1, 1}) {
          const auto w = step(v, corner, sign);
          if (left.erase(w) > 0) queue.push_back(w);
        }
      }
    }
  }
  return result;
}

}  // namespace

TEST_CASE("lattice_topology: one voxel is a point", "[labels][unit]") {
  Grid<MaterialId> ids = empty(3, 3, 3);
  ids(1, 1, 1) = 1;
  const LatticeTopology topology = topology_of(ids);
  CHECK(topology.voxels == 1);
  CHECK(topology.components == 1);
  CHECK(topology.euler == 1);
}

TEST_CASE("lattice_topology: ball, torus and hollow ball have 1, 0 and 2", "[labels][unit]") {
  const auto ball = topology_of(ids_of(phantoms::ball(8)));
  CHECK(ball.components == 1);
  CHECK(ball.euler == 1);
  const auto torus = topology_of(ids_of(phantoms::torus(10, 4)));
  CHECK(torus.components == 1);
  CHECK(torus.euler == 0);
  Grid<MaterialId> nested = ids_of(phantoms::nested_balls(4, 9));
  const auto shell = topology_of(nested, 2);
  CHECK(shell.components == 1);
  CHECK(shell.euler == 2);
}

TEST_CASE("lattice_topology: voxels touch along (1,1,0) and (1,1,1) but not along (1,-1,0)",
          "[labels][unit]") {
  Grid<MaterialId> along = empty(4, 4, 4);
  along(1, 1, 1) = along(2, 2, 2) = 1;
  CHECK(topology_of(along).components == 1);
  CHECK(topology_of(along).euler == 1);
  Grid<MaterialId> across = empty(4, 4, 4);
  across(1, 2, 1) = across(2, 1, 1) = 1;
  CHECK(topology_of(across).components == 2);
  CHECK(topology_of(across).euler == 2);
}

TEST_CASE("lattice_topology: two cubes that touch along the off-diagonal are two components",
          "[labels][unit]") {
  Grid<MaterialId> ids = empty(10, 10, 10);
  for (int k = 1; k < 5; ++k) {
    for (int j = 0; j < 4; ++j) {
      for (int i = 0; i < 4; ++i) {
        ids(1 + i, 5 + j, k) = 1;  // corner (4, 5) against corner (5, 4)
        ids(5 + i, 1 + j, k) = 1;
      }
    }
  }
  CHECK(topology_of(ids).components == 2);
  CHECK(topology_of(ids).euler == 2);
  ids(5, 5, 2) = 1;
  CHECK(topology_of(ids).components == 1);
}

TEST_CASE("lattice_topology: material that fills the grid is a ball", "[labels][unit]") {
  Grid<MaterialId> ids = empty(5, 4, 3);
  std::fill(ids.values.begin(), ids.values.end(), MaterialId{1});
  CHECK(topology_of(ids).euler == 1);
  CHECK(topology_of(ids).components == 1);
  CHECK(topology_of(ids).voxels == 60);
}

TEST_CASE("lattice_topology: agrees with the definition on noise", "[labels][property]") {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    const Grid<MaterialId> ids = ids_of(phantoms::voxel_noise(seed, 3, 11));
    const auto topology = lattice_topology(ids, 4);
    for (MaterialId m = 1; m < 4; ++m) {
      const LatticeTopology expected = by_definition(ids, m);
      CHECK(topology[m].components == expected.components);
      CHECK(topology[m].euler == expected.euler);
      CHECK(topology[m].voxels == expected.voxels);
    }
    CHECK(topology[0].voxels == 0);
  }
}

TEST_CASE("find_lattice_components: components are numbered by their first voxel",
          "[labels][unit]") {
  Grid<MaterialId> ids = empty(8, 2, 2);
  ids(6, 0, 0) = 2;
  ids(1, 0, 1) = ids(2, 0, 1) = 1;
  ids(5, 1, 1) = 2;
  const LatticeComponents c = find_lattice_components(ids);
  REQUIRE(c.component_count() == 3);
  CHECK(c.material_of == std::vector<MaterialId>{2, 1, 2});
  CHECK(c.voxels_of == std::vector<std::size_t>{1, 2, 1});
  CHECK(c.run_at(2, 2) == 1);
  CHECK(c.run_at(2, 3) == -1);
  CHECK(c.run_at(2, 0) == -1);
}
