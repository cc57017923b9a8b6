// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/labels/label_volume.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

/// Label volumes made in code, each with a shape whose truth is known.
///
/// All shapes are given in mm around the origin and sampled at voxel centres; the world origin is
/// the middle of the grid, the space is RAS and at least `kMargin` voxels of background surround
/// the shape, unless a function says otherwise. Label 0 is the background.
namespace cvmesh::phantoms {

inline constexpr int kMargin = 4;                   ///< voxels of background around a shape
inline constexpr Vec3 kIsotropic{1, 1, 1};          ///< mm
inline constexpr Vec3 kAnisotropic{0.5, 0.4, 0.8};  ///< mm, the femur's spacing

/// A frame of `dims` voxels whose middle is the world origin; RAS, axes along the world's.
GridFrame centred_frame(const std::array<int, 3>& dims, const Vec3& spacing_mm = kIsotropic);

/// `centred_frame` just large enough for a box of half size `half_mm` plus the margin; odd dims, so
/// that a voxel centre lies on the origin.
GridFrame frame_around(const Vec3& half_mm, const Vec3& spacing_mm = kIsotropic);

/// The labels that `label_at` gives at the voxel centres, in mm from the middle of the grid.
InputVolume sample(const GridFrame& frame, const std::function<Label(const Vec3&)>& label_at);

/// A ball of one label.
InputVolume ball(double radius_mm, const Vec3& spacing_mm = kIsotropic, Label label = 1);
/// Label 1 inside the inner radius, label 2 up to the outer radius.
InputVolume nested_balls(double inner_mm, double outer_mm, const Vec3& spacing_mm = kIsotropic);
/// Balls of labels 1 and 2 of one radius, pressed together along x: their common face is a disc of
/// half that radius.
InputVolume touching_balls(double radius_mm, const Vec3& spacing_mm = kIsotropic);
/// Boxes of labels 1 and 2, `size_vox` voxels each, that share a whole face across x.
InputVolume touching_boxes(const std::array<int, 3>& size_vox, const Vec3& spacing_mm = kIsotropic);
/// A ball in which labels 1, 2 and 3 meet along the z axis; label 1 is the wedge of `angle_deg`
/// around +x, labels 2 (y > 0) and 3 (y < 0) share the rest equally.
InputVolume three_material_wedge(double angle_deg,
                                 double radius_mm = 12,
                                 const Vec3& spacing_mm = kIsotropic);
/// A ball whose labels 1 to 4 meet at the origin, each the cone around one direction of a regular
/// tetrahedron.
InputVolume four_material_corner(double radius_mm = 12, const Vec3& spacing_mm = kIsotropic);
/// A torus around z; genus one.
InputVolume torus(double major_mm, double minor_mm, const Vec3& spacing_mm = kIsotropic);
/// A square plate of 24 mm, its normal turned by `tilt_deg` from z towards x (and half that
/// towards y, so that it is not aligned with any lattice plane).
InputVolume thin_plate(double thickness_mm,
                       double tilt_deg = 0,
                       const Vec3& spacing_mm = kIsotropic);
/// A round rod of 24 mm with flat ends, its axis turned by `tilt_deg` from z as for `thin_plate`.
InputVolume rod(double radius_mm, double tilt_deg = 0, const Vec3& spacing_mm = kIsotropic);
/// A ball of label 1 and, detached from it, one more voxel of label 1.
InputVolume one_voxel_island(double radius_mm = 6, const Vec3& spacing_mm = kIsotropic);
/// A ball of label 1 whose middle voxel has label 2.
InputVolume one_voxel_label(double radius_mm = 6, const Vec3& spacing_mm = kIsotropic);
/// A volume without label 0: a ball of label 2 in a box that label 1 fills up to the border.
InputVolume box_without_background(const std::array<int, 3>& dims = {17, 15, 13},
                                   const Vec3& spacing_mm = kIsotropic);
/// Balls of labels 1..n_labels at random places that overlap and squeeze each other; the same
/// volume for the same seed, every label present.
InputVolume random_blobs(std::uint64_t seed,
                         int n_labels,
                         int side_vox = 28,
                         const Vec3& spacing_mm = kIsotropic);
/// Cubes of labels 1 and 2 in turn, `cube_vox` wide and `cubes` along each axis: cubes of one
/// label touch along edges and corners only.
InputVolume checkerboard(int cube_vox, int cubes, const Vec3& spacing_mm = kIsotropic);
/// Independent random labels 0..n_labels per voxel with a margin of background: every local
/// configuration that a lattice method can meet.
InputVolume voxel_noise(std::uint64_t seed, int n_labels, int side_vox = 8);

/// The same voxels with the world axes turned by `angle_deg` around `axis` and the origin moved.
InputVolume rotated(InputVolume volume, const Vec3& axis, double angle_deg, const Vec3& shift_mm);
/// The same voxels with the first voxel axis pointing to -x: a left-handed (mirroring) affine.
InputVolume mirrored(InputVolume volume);

/// Number of voxels of a label, and their volume.
std::size_t voxel_count(const InputVolume& volume, Label label);
double volume_mm3(const InputVolume& volume, Label label);

struct NamedPhantom {
  std::string name;
  InputVolume volume;
};

/// One small phantom of every kind (each below 60,000 voxels): what "on every phantom" means.
std::vector<NamedPhantom> all_small();

}  // namespace cvmesh::phantoms
