// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parameters.h"
#include "cvmesh/report/report.h"

#include <filesystem>
#include <optional>

namespace cvmesh {

struct JudgeRequest {
  std::filesystem::path mesh;                  ///< tets with labels: .vtu, .mesh, .msh
  std::filesystem::path labels;                ///< the volume that they should fill
  std::optional<std::filesystem::path> truth;  ///< .off, .ply or .stl, in the mesh's coordinates
  std::optional<Space>
      space;               ///< of the mesh, where its file does not state it; default: the volume's
  ReadVolumeOptions read;  ///< of the labels
  Parameters parameters;   ///< of these, those that clean labels are used
};

/// The metrics of a mesh of any program against the label volume: what the report of a run has,
/// measured in the same way, but for the dense surface, which only a run has. Nothing is required
/// of the mesh: its faults are reported.
///
/// @throws Error BadInput when a file cannot be read, the mesh has a label that the volume has not,
///         or lies in other coordinates than the volume; BadParameter for the space
Report judge_mesh(const JudgeRequest& request, const StageContext& context);

}  // namespace cvmesh
