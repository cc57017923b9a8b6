// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "cvmesh/core/context.h"
#include "cvmesh/core/label.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/sizing/sizing_field.h"

namespace cvmesh {

/// Sizes that differ for one material.
struct MaterialSizing {
  std::optional<double> epsilon, min_edge_mm, max_edge_mm;
};

struct SizingOptions {
  double epsilon = 1.0;                        ///< edge length over local feature size
  double delta = 0.4;                          ///< gradation: largest slope of h
  double min_feature_vox = 0.8;                ///< floor of the local feature size
  std::optional<double> min_edge_mm, max_edge_mm;
  std::map<MaterialId, MaterialSizing> per_material;
};

struct SizingStats {
  double lfs_min_mm = 0, lfs_median_mm = 0, lfs_max_mm = 0;
  double h_min_mm = 0, h_median_mm = 0, h_max_mm = 0;
  double expected_vertices = 0;                ///< (2 / sqrt 3) * integral of dA / h^2
};

struct SizingResult {
  SizingField sizing_field;
  SizingStats stats;
};

/// Distance of every dense vertex to the medial axis, in mm; near junction curves corrected as
/// design.md, "medial axis and sizing", says. Independent of epsilon.
std::vector<double> local_feature_size(const InterfaceMesh& dense, const Strata& strata,
                                       const MedialAxis& medial_axis, double voxel_mm,
                                       const StageContext& context);

/// h(x) = min over y of clamp(epsilon max(LFS(y), floor), min, max) + delta |x - y|, on the dense
/// vertices and on the grid [Persson 2006, Meyer 2007].
SizingResult compute_sizing_field(const InterfaceMesh& dense, const Strata& strata,
                                  std::vector<double> lfs_mm, const GridFrame& frame,
                                  const SizingOptions& options, const StageContext& context);

}  // namespace cvmesh
