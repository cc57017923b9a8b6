// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"
#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/core/vec3_pair.h"
#include "cvmesh/grid/grid.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/mesh/flat_triangle.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A flat convex piece of a surface: a triangle, or a rectangle with its corners in order.
struct FlatPiece {
  std::array<Vec3, 4> corner;
  int corners = 3;

  [[nodiscard]] Vec3 centre() const;
  [[nodiscard]] double area() const;
  /// The point at (u, v) of the unit square, which fills the piece evenly.
  [[nodiscard]] Vec3 point(double u, double v) const;
};

/// The two halves of a piece, cut across its longest side.
std::array<FlatPiece, 2> halves(const FlatPiece& piece);

/// The surfaces that distances are measured between have the same members: `size`, `box` and
/// `squared_distance` for the search tree, `sides`, `piece` and `ready` for the measurement.
/// `scale` maps grid mm to the space in which distances are measured: 1 for mm, 1 / spacing for
/// index space. The world of a sheared volume takes a linear map.

/// The facets of an interface mesh, which must outlive this view.
class FacetSurface {
 public:
  FacetSurface(const InterfaceMesh& mesh, const Vec3& scale);

  [[nodiscard]] std::size_t size() const { return corners_.size(); }

  [[nodiscard]] Sides sides(std::size_t f) const { return mesh_.patch_of[f].sides; }

  [[nodiscard]] Box3 box(std::size_t f) const;

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    const auto& [a, b, c] = corners_[f];
    return squared_norm(p - nearest_on_triangle(p, a, b, c));
  }

  using Ready = FlatTriangle;

  [[nodiscard]] FlatTriangle ready(std::size_t f) const {
    const auto& [a, b, c] = corners_[f];
    return {a, b, c};
  }

  [[nodiscard]] FlatPiece piece(std::size_t f) const {
    const auto& [a, b, c] = corners_[f];
    return {{a, b, c, c}, 3};
  }

 private:
  const InterfaceMesh& mesh_;
  std::vector<std::array<Vec3, 3>> corners_;
};

/// One voxel face: between voxel (i, j, k) and its predecessor along `axis`.
struct VoxelFace {
  std::array<std::int32_t, 3> voxel;
  Sides sides;
  std::uint8_t axis;
};

/// All voxel faces between unequal materials, those on the box among them, by blocks of 8^3 voxels,
/// so that what lies together on the boundary lies together in memory.
std::vector<VoxelFace> find_voxel_faces(const Grid<MaterialId>& ids);

/// The staircase of voxel faces, exact rectangles; `faces` must outlive this view.
class VoxelFaceSurface {
 public:
  VoxelFaceSurface(const std::vector<VoxelFace>& faces, const Vec3& spacing_mm, const Vec3& scale);

  [[nodiscard]] std::size_t size() const { return faces_.size(); }

  [[nodiscard]] Sides sides(std::size_t f) const { return faces_[f].sides; }

  [[nodiscard]] Box3 box(std::size_t f) const {
    const VoxelFace& face = faces_[f];
    Box3 result;
    for (int axis = 0; axis < 3; ++axis) {
      result.lo[axis] = (face.voxel[axis] - 0.5) * step_[axis];
      result.hi[axis] =
          axis == face.axis ? result.lo[axis] : (face.voxel[axis] + 0.5) * step_[axis];
    }
    return result;
  }

  /// An axis-aligned rectangle, for two points at a time.
  struct Ready {
    Box3 box;

    [[nodiscard]] DoublePair squared_distance(const Vec3Pair& p) const {
      return squared_gap(p.x, box.lo.x, box.hi.x) + squared_gap(p.y, box.lo.y, box.hi.y) +
             squared_gap(p.z, box.lo.z, box.hi.z);
    }

   private:
    static DoublePair squared_gap(const DoublePair& x, double lo, double hi) {
      const DoublePair gap = larger_of(larger_of(lo - x, x - hi), DoublePair{});
      return gap * gap;
    }
  };

  [[nodiscard]] Ready ready(std::size_t f) const { return {box(f)}; }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    return ready(f).squared_distance({p, p})[0];
  }

  [[nodiscard]] FlatPiece piece(std::size_t f) const;

 private:
  const std::vector<VoxelFace>& faces_;
  Vec3 step_;
};

/// The staircase of voxel faces where a linear map makes them parallelograms; `faces` must outlive
/// this view.
class MappedFaceSurface {
 public:
  MappedFaceSurface(const std::vector<VoxelFace>& faces,
                    const Vec3& spacing_mm,
                    const Affine& mm_to_space);

  [[nodiscard]] std::size_t size() const { return faces_.size(); }

  [[nodiscard]] Sides sides(std::size_t f) const { return faces_[f].sides; }

  [[nodiscard]] Box3 box(std::size_t f) const;

  /// Its two triangles.
  struct Ready {
    FlatTriangle first, second;

    [[nodiscard]] DoublePair squared_distance(const Vec3Pair& p) const {
      return smaller_of(first.squared_distance(p), second.squared_distance(p));
    }
  };

  [[nodiscard]] Ready ready(std::size_t f) const {
    const auto corner = piece(f).corner;
    return {{corner[0], corner[1], corner[2]}, {corner[0], corner[2], corner[3]}};
  }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    return ready(f).squared_distance({p, p})[0];
  }

  [[nodiscard]] FlatPiece piece(std::size_t f) const;

 private:
  const std::vector<VoxelFace>& faces_;
  std::array<Vec3, 3> step_;  // of a voxel along each axis
};

}  // namespace cvmesh
