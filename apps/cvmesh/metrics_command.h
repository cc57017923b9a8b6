// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/volume_reader.h"

#include <optional>
#include <string>

namespace cvmesh::app {

/// `cvmesh metrics MESH LABELS`: judges a mesh of any program.
struct MetricsCommand {
  std::string mesh, labels, truth, params_file, out_file;
  std::optional<Space> space;  ///< empty: what the mesh file states, else the volume's own
  ReadVolumeOptions read;      ///< of the labels
  bool as_json = false;        ///< JSON instead of a table on standard output
};

/// Measures, prints, and writes the file that was asked for.
/// @throws Error as `judge_mesh`; Output when the file or standard output cannot be written
void run_metrics(const MetricsCommand& command, const StageContext& context);

}  // namespace cvmesh::app
