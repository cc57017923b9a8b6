// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Values of an image in the tets of a mesh, one per tet.
struct TetSamples {
  std::vector<double> mean, median;
  std::size_t tets_outside = 0;  ///< without any point in the image; their values are 0
};

/// Mean and median of an image in every tet.
///
/// The image is interpolated linearly at the points with barycentric coordinates (i + 1/4, j + 1/4,
/// k + 1/4, l + 1/4) / n, where i + j + k + l = n - 1 and n is the longest edge in voxels of the
/// image, rounded up, at least 2. Those n (n + 1) (n + 2) / 6 points lie no further apart than
/// about a voxel and all count alike; since they are symmetric, the mean of a linear image is its
/// value at the centre of the tet. Points beyond the faces of the image's outer voxels do not
/// count. Of a mesh of second order the straight tets are sampled.
///
/// @param mm_to_index  grid mm of the mesh -> index of the image
/// @note  time and points grow with the volume of the mesh in voxels of the image
TetSamples sample_tets(const TetMesh& mesh, const Grid<float>& image, const Affine& mm_to_index);

/// Elastic materials of equal width in modulus between the lowest and the highest of some tets;
/// each has the mean modulus of its tets, weighted by their volumes. Bins without tets are left
/// out.
/// @param modulus_mpa  per tet of the mesh; those of 0 are in no bin
std::vector<ElasticBin> bin_by_modulus(const TetMesh& mesh,
                                       const std::vector<double>& modulus_mpa,
                                       int bins,
                                       double poisson_ratio);

}  // namespace cvmesh
