// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/measured_surfaces.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace cvmesh {
namespace {

MaterialId material_at(const Grid<MaterialId>& ids, std::array<std::int32_t, 3> v) {
  return ids.frame.contains(v[0], v[1], v[2]) ? ids(v[0], v[1], v[2]) : kExterior;
}

constexpr std::int32_t kBlock = 8;

// Calls found(face) for the faces between a voxel and its predecessors.
template <typename Found>
void find_faces_before(const Grid<MaterialId>& ids,
                       const std::array<std::int32_t, 3>& voxel,
                       const Found& found) {
  const MaterialId own = material_at(ids, voxel);
  for (std::uint8_t axis = 0; axis < 3; ++axis) {
    std::array<std::int32_t, 3> before = voxel;
    --before[axis];
    const MaterialId other = material_at(ids, before);
    if (own != other) found(VoxelFace{voxel, {std::max(own, other), std::min(own, other)}, axis});
  }
}

}  // namespace

Vec3 FlatPiece::centre() const {
  Vec3 sum = corner[0];
  for (int k = 1; k < corners; ++k)
    sum += corner[k];
  return sum / corners;
}

double FlatPiece::area() const {
  const double triangle = norm(area_vector2(corner[0], corner[1], corner[2])) / 2;
  return corners == 3 ? triangle : 2 * triangle;
}

Vec3 FlatPiece::point(double u, double v) const {
  if (corners == 4) return corner[0] + u * (corner[1] - corner[0]) + v * (corner[3] - corner[0]);
  if (u + v > 1) {  // the other half of the unit square, folded over the diagonal
    u = 1 - u;
    v = 1 - v;
  }
  return corner[0] + u * (corner[1] - corner[0]) + v * (corner[2] - corner[0]);
}

std::array<FlatPiece, 2> halves(const FlatPiece& piece) {
  const auto side2 = [&](int k) {
    return squared_norm(piece.corner[(k + 1) % piece.corners] - piece.corner[k]);
  };
  int k = 0;
  for (int other = 1; other < 3; ++other)
    if (side2(other) > side2(k)) k = other;
  const auto at = [&](int i) { return piece.corner[i % piece.corners]; };
  const Vec3 middle = 0.5 * (at(k) + at(k + 1));
  if (piece.corners == 3)
    return {{{{at(k), middle, at(k + 2), at(k + 2)}, 3},
             {{middle, at(k + 1), at(k + 2), at(k + 2)}, 3}}};
  const Vec3 opposite = 0.5 * (at(k + 2) + at(k + 3));
  return {
      {{{at(k), middle, opposite, at(k + 3)}, 4}, {{middle, at(k + 1), at(k + 2), opposite}, 4}}};
}

FacetSurface::FacetSurface(const InterfaceMesh& mesh, const Vec3& scale)
    : mesh_(mesh), corners_(mesh.facets.size()) {
  parallel_for_each_index(0, size(), [&](std::size_t f) {
    for (int k = 0; k < 3; ++k)
      corners_[f][k] = scaled_by(mesh.points[mesh.facets[f][k]], scale);
  });
}

Box3 FacetSurface::box(std::size_t f) const {
  Box3 result;
  for (const Vec3& corner : corners_[f])
    result.add(corner);
  return result;
}

std::vector<VoxelFace> find_voxel_faces(const Grid<MaterialId>& ids) {
  // One voxel more along each axis: a face lies before its voxel.
  const std::array<std::int32_t, 3> end{ids.frame.dims[0] + 1, ids.frame.dims[1] + 1,
                                        ids.frame.dims[2] + 1};
  const auto blocks_along = [&](int axis) {
    return static_cast<std::size_t>((end[axis] + kBlock - 1) / kBlock);
  };
  const std::size_t rows = blocks_along(1) * blocks_along(2);
  const auto scan_row = [&](std::size_t row, const auto& found) {
    const auto j0 = static_cast<std::int32_t>(row % blocks_along(1)) * kBlock;
    const auto k0 = static_cast<std::int32_t>(row / blocks_along(1)) * kBlock;
    for (std::int32_t i0 = 0; i0 < end[0]; i0 += kBlock)
      for (std::int32_t k = k0; k < std::min(k0 + kBlock, end[2]); ++k)
        for (std::int32_t j = j0; j < std::min(j0 + kBlock, end[1]); ++j)
          for (std::int32_t i = i0; i < std::min(i0 + kBlock, end[0]); ++i)
            find_faces_before(ids, {i, j, k}, found);
  };
  std::vector<std::size_t> first(rows + 1, 0);
  parallel_for_each_index(
      0, rows, [&](std::size_t r) { scan_row(r, [&](const VoxelFace&) { ++first[r + 1]; }); }, 4);
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<VoxelFace> faces(first.back());
  parallel_for_each_index(
      0, rows,
      [&](std::size_t r) {
        std::size_t next = first[r];
        scan_row(r, [&](const VoxelFace& face) { faces[next++] = face; });
      },
      4);
  return faces;
}

VoxelFaceSurface::VoxelFaceSurface(const std::vector<VoxelFace>& faces,
                                   const Vec3& spacing_mm,
                                   const Vec3& scale)
    : faces_(faces), step_(scaled_by(spacing_mm, scale)) {}

FlatPiece VoxelFaceSurface::piece(std::size_t f) const {
  const int u = (faces_[f].axis + 1) % 3, v = (faces_[f].axis + 2) % 3;
  const Box3 b = box(f);
  FlatPiece result{{b.lo, b.lo, b.hi, b.lo}, 4};
  result.corner[1][u] = b.hi[u];
  result.corner[3][v] = b.hi[v];
  return result;
}

MappedFaceSurface::MappedFaceSurface(const std::vector<VoxelFace>& faces,
                                     const Vec3& spacing_mm,
                                     const Affine& mm_to_space)
    : faces_(faces) {
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 voxel{};
    voxel[axis] = spacing_mm[axis];
    step_[static_cast<std::size_t>(axis)] = mm_to_space.linear(voxel);
  }
}

Box3 MappedFaceSurface::box(std::size_t f) const {
  Box3 result;
  for (const Vec3& corner : piece(f).corner)
    result.add(corner);
  return result;
}

FlatPiece MappedFaceSurface::piece(std::size_t f) const {
  const VoxelFace& face = faces_[f];
  const Vec3 corner = (face.voxel[0] - 0.5) * step_[0] + (face.voxel[1] - 0.5) * step_[1] +
                      (face.voxel[2] - 0.5) * step_[2];
  const Vec3 &u = step_[(face.axis + 1) % 3], &v = step_[(face.axis + 2) % 3];
  return {{corner, corner + u, corner + u + v, corner + v}, 4};
}

}  // namespace cvmesh
