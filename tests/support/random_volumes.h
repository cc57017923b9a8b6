// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <cstdint>
#include <string>

/// Label volumes at random: what a mesher meets when nobody has smoothed or cleaned anything.
namespace cvmesh::random_volumes {

/// What the voxels of a random volume are like.
enum class Kind {
  Blobs,         ///< balls that overlap and squeeze each other
  Cells,         ///< a Voronoi diagram that fills the box, label 0 absent
  Noise,         ///< every voxel independent
  SmoothNoise,   ///< noise after a majority vote over the neighbours: ragged parts of all sizes
  Checkerboard,  ///< cubes of 1 to 4 voxels in turn
  Specks,        ///< single voxels, in background or inside one label
  Corners,       ///< small boxes that touch along edges and at corners only
  Walls,         ///< cells parted by walls one voxel thick
  Shells,        ///< nested shells, each one voxel thick
  Threads,       ///< random walks one voxel thick
};

inline constexpr int kKinds = 10;

const char* name_of(Kind kind);

struct RandomVolume {
  Kind kind = Kind::Blobs;
  InputVolume volume;

  /// "noise 31 x 9 x 12, 5 labels": for messages.
  [[nodiscard]] std::string description() const;
};

/// The volume of a seed: kind, dims (8 to 48 per axis, small ones more often), number of labels (2
/// to 200, few more often), spacing (up to 1:5) and orientation all follow from it.
RandomVolume make(std::uint64_t seed);

/// Of this kind and size; spacing and orientation follow from the seed.
RandomVolume make(std::uint64_t seed, Kind kind, const std::array<int, 3>& dims, int labels);

}  // namespace cvmesh::random_volumes
