// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parameters.h"
#include "cvmesh/pipeline/watchdog.h"
#include "cvmesh/report/report.h"

#include <filesystem>
#include <optional>
#include <set>
#include <vector>

namespace cvmesh {

/// Files of the tets: NAME.vtu, NAME.mesh (Medit), NAME.inp (Abaqus, CalculiX).
enum class MeshFormat { Vtu, Mesh, Inp };

struct RunRequest {
  std::filesystem::path input;    ///< label volume: .nii, .nii.gz, .mha, .mhd, .nrrd
  std::filesystem::path out_dir;  ///< made with its parents where it does not exist
  Parameters parameters;
  std::optional<Space> space;  ///< of the written coordinates; default: the input's own
  bool keep_stages = false;    ///< each stage's result to out_dir/stages/
  bool surface_only = false;   ///< stop before the tets
  std::set<MeshFormat> formats{MeshFormat::Vtu, MeshFormat::Mesh};  ///< to write the tets in
  ReadVolumeOptions read;
  bool force = false;  ///< replace results of an earlier run, and files of their names
  RunLimits limits;
  /// The signal that set the caller's cancel flag, 0 for none: for messages; may be null.
  const std::atomic<int>* signal = nullptr;
  /// Called from another thread when the stages did not stop in time after a cancel or at a limit.
  /// No file of this run but NAME.failed.json is there then. It is meant to end the process; where
  /// it is empty, the run ends when the stage looks.
  Watchdog::Stuck on_stuck;
};

struct RunResult {
  Report report;
  std::vector<std::filesystem::path> files;  ///< that were written, the metrics file last
};

/// One run from label volume to mesh and report.
///
/// With NAME the input's file name without its suffix, writes the tets in the formats asked for,
/// NAME.surface.vtp and, last, NAME.metrics.json; files of an earlier run of that NAME are removed
/// when the run starts, where `force` allows it, and a failed run leaves nothing but
/// NAME.failed.json. The seed of the run is that of the parameters, whatever `context` says.
///
/// @throws Error with the codes of README, "Exit codes"; Output before any long work when
///         `out_dir` cannot be written or has such files; Limit before most of it when the forecast
///         is far beyond a limit
RunResult run_pipeline(const RunRequest& request, const StageContext& context);

}  // namespace cvmesh
