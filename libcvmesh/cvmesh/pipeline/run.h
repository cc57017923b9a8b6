// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/mesh_names.h"
#include "cvmesh/pipeline/dense_surfaces.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/pipeline/stage_runner.h"
#include "cvmesh/report/report.h"

namespace cvmesh {

/// Everything the steps of one run share.
struct Run {
  const RunRequest& request;
  const StageContext& context;
  OutputFolder& outputs;
  Report& report;
  StageRunner& stage;

  Affine mm_to_out{};
  Space space = Space::Unknown;
};

/// The mesh is a baseline, written with its faults.
inline bool is_baseline(const Run& run) {
  return run.request.parameters.surface == SurfaceMethod::Delaunay;
}

/// What messages call materials and places: by label, and in a space.
/// @param report  is referred to; its labels are known
MeshNames names_in_messages(const Report& report, const Affine& mm_to_space, Space space);

/// The same in the space of the output.
MeshNames names_in_messages(const Run& run);

}  // namespace cvmesh
