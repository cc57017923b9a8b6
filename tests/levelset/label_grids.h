// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/grid/grid.h"
#include "cvmesh/labels/lattice_topology.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

/// Grids of material ids for the tests of level sets and interfaces: small, made in index space.
namespace cvmesh::label_grids {

using Labels = Grid<MaterialId>;

/// The materials that `material_at` gives at the nodes (index space).
Labels sample(const std::array<int, 3>& dims,
              const std::function<MaterialId(const Vec3&)>& material_at,
              const Vec3& spacing_mm = {1, 1, 1});

/// A ball of material 1 whose centre is `shift` from the middle node; six nodes of margin.
Labels ball(double radius, const Vec3& shift = {});
/// The centre of such a ball (index space).
Vec3 ball_centre(double radius, const Vec3& shift = {});
/// A ball whose nodes near the boundary are flipped with probability `rate`.
Labels noisy_ball(double radius, double rate, std::uint64_t seed);
/// A rod of material 1 along `direction`, round, flat-ended.
Labels rod(double radius, double half_length, const Vec3& direction);
/// A round disc of material 1 across `direction`.
Labels disc(double radius, double half_thickness, const Vec3& direction);
/// Independent random materials 0..material_count-1, up to the border of the grid.
Labels noise(const std::array<int, 3>& dims, int material_count, std::uint64_t seed);

std::shared_ptr<const Labels> shared(Labels labels);
std::size_t count(const Labels& labels, MaterialId m);
std::size_t material_count(const Labels& labels);

/// Topology of every material, the exterior as well (`lattice_topology` leaves that out).
std::vector<LatticeTopology> topology(const Labels& labels);

/// Volume inside the boundary of each material in a surface, mm^3.
std::vector<double> volumes(const InterfaceMesh& mesh, std::size_t material_count);

struct Named {
  const char* name;
  Labels labels;
};

/// Torus, thin plates, rods, nested balls, blobs that squeeze each other, touching boxes, a cube in
/// the corner of the grid: what "every phantom" means here.
std::vector<Named> phantoms();

}  // namespace cvmesh::label_grids
