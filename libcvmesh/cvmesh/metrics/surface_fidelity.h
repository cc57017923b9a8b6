// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/metrics/distance_samples.h"

#include <cstddef>
#include <map>
#include <optional>
#include <vector>

namespace cvmesh {

/// Both directions between the final surface ("mesh") and a reference.
struct TwoSidedDistance {
  DistanceStats mesh_to_reference, reference_to_mesh;

  /// The Hausdorff distance, the larger of the two largest distances, lies between these.
  [[nodiscard]] double hausdorff_lower_bound() const;
  [[nodiscard]] double hausdorff_upper_bound() const;
  /// Average of the two means.
  [[nodiscard]] double mean_symmetric() const;
  /// Root of the average of the two mean squares.
  [[nodiscard]] double rms_symmetric() const;
};

/// One comparison, measured in grid millimetres and, anew, in index space (each axis divided by its
/// spacing), where the nearest point may be another one. Grid millimetres know no shear: where the
/// axes of the volume are not at right angles (`is_sheared`), it is measured in the world as well.
struct SurfaceDistance {
  TwoSidedDistance mm, voxels;
  std::optional<TwoSidedDistance> world_mm{};

  /// In the millimetres of the world, whatever the axes.
  [[nodiscard]] const TwoSidedDistance& true_mm() const { return world_mm ? *world_mm : mm; }
};

/// One comparison for all interfaces together, for each material's boundary against the same
/// material's boundary of the reference, and for each interface (pair of materials) against the
/// same interface of the reference. `of_material` is indexed by material id, [0] stays empty;
/// `of_pair` has the pairs that both surfaces have.
struct SurfaceDistances {
  SurfaceDistance overall;
  std::vector<SurfaceDistance> of_material;
  std::map<Sides, SurfaceDistance> of_pair;
};

struct SurfaceFidelityOptions {
  double samples_per_square_voxel = 20;  ///< at least; every facet has one sample or more
  double max_error_vox = 0.05;           ///< of each largest distance; a voxel is the least spacing
};

struct SurfaceFidelity {
  std::optional<SurfaceDistances> to_dense;  ///< against the dense surface, where there is one
  SurfaceDistances to_labels;  ///< against the voxel faces between unequal labels, box faces too
  std::optional<SurfaceDistances> to_truth;  ///< against the user's surface, where there is one
  SurfaceFidelityOptions options;            ///< how they were measured
};

/// Distances between the final `surface` and the `dense` surface and the `truth` (each may be null;
/// the truth knows no materials, so that only the overall distance to it is measured), and between
/// it and the raw boundary of the cleaned labels: voxel faces between unequal labels, the faces of
/// the box among them where a label reaches it.
///
/// Means come from samples, low-discrepancy points on pieces of about a voxel [Roberts 2018];
/// maxima from branch and bound [Guthe 2005]. Distances of single points are exact. A staircase
/// keeps its distance from any smooth surface: the symmetric mean against the labels of a perfect
/// sphere is about 0.12 voxel.
///
/// O(area log facets); memory about 40 bytes a facet, 60 bytes a piece and 4 bytes a sample.
/// @throws Error BadParameter for a density or an error out of range; BadInput for a surface that
/// is
///         too large to be sampled
SurfaceFidelity measure_surface_fidelity(const InterfaceMesh& surface,
                                         const InterfaceMesh* dense,
                                         const InterfaceMesh* truth,
                                         const LabelVolume& labels,
                                         const SurfaceFidelityOptions& options,
                                         const StageContext& context);

/// Distances between two surfaces over the same materials, both in the grid mm of `frame`.
SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const InterfaceMesh& reference,
                                   const GridFrame& frame,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options);

/// Distances between a surface and the raw boundary of `ids`.
SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const Grid<MaterialId>& ids,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options);

}  // namespace cvmesh
