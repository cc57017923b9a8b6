// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/sizing/sizing_field.h"

namespace cvmesh {

struct TetrahedralizeOptions {
  double radius_edge_ratio = 1.4;    ///< TetGen's -q; larger is looser
  double min_dihedral_deg = 10;      ///< TetGen's second -q value
  double interior_growth = 1.0;      ///< interior edge length over the sizing field; 0: no bound
  double time_limit_s = 1800;        ///< of one TetGen run
  double memory_limit_mb = 0;        ///< of the TetGen process; 0: none
};

struct TetrahedralizeStats {
  std::string switches;              ///< those of the run whose result was used
  int attempts = 0;
  std::vector<std::string> failed_attempts;  ///< "switches: what happened", in order
  std::size_t steiner_points = 0;    ///< points that are not on the input surfaces
  double volume_error = 0;           ///< largest |tets - surface integral| / integral of a material
};

struct TetrahedralizeResult {
  TetMesh tets;
  TetrahedralizeStats stats;
};

TetrahedralizeResult tetrahedralize(const InterfaceMesh& surface, std::size_t material_count,
                                    const SizingField& sizing_field,
                                    const TetrahedralizeOptions& options,
                                    const StageContext& context);

}  // namespace cvmesh
