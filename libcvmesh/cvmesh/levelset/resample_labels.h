// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/labels/label_volume.h"

#include <array>
#include <cstddef>

namespace cvmesh {

struct ResampleLabelsOptions {
  double spacing_mm = 1;  ///< wished along every axis; finer axes keep their voxels
};

struct ResampleLabelsStats {
  std::array<int, 3> dims{0, 0, 0};  ///< of the new grid
  Vec3 spacing_mm;
  std::size_t nodes_wished = 0;  ///< where interpolation gives another label than the nearest voxel
  std::size_t nodes_changed = 0;  ///< of these, the ones that got it
  std::size_t nodes_held = 0;     ///< and the ones that did not: a topology would have changed
};

struct ResampleLabelsResult {
  LabelVolume labels;
  Vec3 offset_mm;  ///< native grid mm = new grid mm + offset_mm
  ResampleLabelsStats stats;
};

/// The labels on an (almost) isotropic grid over the same box, by shape-based interpolation
/// [Raya 1990], so that thick slices do not end as terraces.
///
/// Along each axis the n voxels of s mm become n' = max(n, round(n s / spacing_mm)) of n s / n' mm;
/// the box faces, half a voxel outside the outermost centres, stay where they are. Every node
/// starts with the label of the voxel it lies in and wishes for the label of the largest signed
/// distance, taken within the planes across the coarsest axis and interpolated linearly. Wishes
/// come true where they are simple changes, so that the topology of every material on the
/// 14-neighbour lattice, the exterior included, is that of `labels`, and no two materials touch
/// that did not touch before.
///
/// We leave the paper in three points: distances are cut off at the depth of the thinnest label
/// around a node, so that what ends between two slices ends half way, and thin parts are not eaten;
/// only labels of the eight voxels around a node stand for election, so that no third label parts
/// two that meet between slices; and a wish is refused where the topology would change.
///
/// `label_of`, `name_of`, `first_voxel` and `input_dims` of the result are those of `labels`: the
/// last two still count voxels of the input.
/// @throws Error BadParameter when spacing_mm is not positive, exceeds the smallest spacing of
///         `labels` by more than a thousandth, or makes a grid of more than 2^31 - 1 voxels (nodes
///         are numbered by 32 bits); Limit when cancelled
/// @note   Linear in the voxels of both grids and of the labels' boxes. Memory beside the two
/// grids: 8 bytes per wish and
///         about 20 bytes per voxel of 33 native planes, where labels take turns, and 16 per node
///         between them that has two labels around it.
ResampleLabelsResult resample_labels(const LabelVolume& labels,
                                     const ResampleLabelsOptions& options,
                                     const StageContext& context);

/// The spacing to resample to unless a user names one: the smallest of the frame. It is the largest
/// that `resample_labels` accepts, and keeps every voxel of the scan.
double auto_spacing_mm(const GridFrame& frame);

}  // namespace cvmesh
