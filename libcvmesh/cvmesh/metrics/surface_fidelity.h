// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// Distances from samples on one surface to another surface.
///
/// `max` is the largest sampled distance, vertices included: a lower bound of the one-sided
/// Hausdorff distance. The others are weighted by area.
struct DistanceStats {
  double max = 0, p95 = 0, mean = 0, rms = 0;
  std::size_t samples = 0;  ///< points measured, vertices included; 0: nothing to measure
};

/// Both directions between the final surface ("mesh") and a reference.
struct TwoSidedDistance {
  DistanceStats mesh_to_reference, reference_to_mesh;

  /// Sampled Hausdorff distance, a lower bound: the larger maximum.
  [[nodiscard]] double hausdorff_lower_bound() const;
  /// Average of the two means.
  [[nodiscard]] double mean_symmetric() const;
  /// Root of the average of the two mean squares.
  [[nodiscard]] double rms_symmetric() const;
};

/// One comparison, measured in millimetres and, anew, in index space (each axis divided by its
/// spacing), where the nearest point may be another one.
struct SurfaceDistance {
  TwoSidedDistance mm, voxels;
};

/// One comparison for all interfaces together and for each material's boundary against the same
/// material's boundary of the reference; `of_material` is indexed by material id, [0] stays empty.
struct SurfaceDistances {
  SurfaceDistance overall;
  std::vector<SurfaceDistance> of_material;
};

struct SurfaceFidelityOptions {
  double samples_per_square_voxel = 4;  ///< at least; every facet has one sample or more
};

struct SurfaceFidelity {
  SurfaceDistances to_dense;   ///< against the dense surface, where the caller has one
  SurfaceDistances to_labels;  ///< against the voxel faces between unequal labels, box faces too
  double samples_per_square_voxel = 0;  ///< the density that was asked for
};

/// Distances between the final `surface` and the `dense` surface, and between it and the raw
/// boundary of the cleaned labels: voxel faces between unequal labels, the faces of the box among
/// them where a label reaches it.
///
/// Samples are a fixed low-discrepancy pattern on each facet [Roberts 2018] plus all vertices, four
/// on each voxel face plus its corners at the default density; distances are exact. A staircase
/// keeps its distance from any smooth surface: the symmetric mean against the labels of a perfect
/// sphere is about 0.12 voxel.
///
/// O(samples log facets); memory about 40 bytes a facet and 12 bytes a sample.
SurfaceFidelity measure_surface_fidelity(const InterfaceMesh& surface,
                                         const InterfaceMesh& dense,
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
