// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parameters.h"
#include "cvmesh/pipeline/watchdog.h"
#include "cvmesh/report/report.h"

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace cvmesh {

/// Files of the tets: NAME.vtu, NAME.mesh (Medit), NAME.inp (Abaqus, CalculiX), NAME.msh
/// (Gmsh 4.1), NAME.v22.msh (Gmsh 2.2), NAME.feb (FEBio); and files of each label's boundary and
/// each interface, NAME.label_2.stl and so on.
enum class MeshFormat { Vtu, Mesh, Inp, Msh, Msh22, Feb, Stl, Ply, Vtp };

/// Whether a format is one of surfaces, which a run that stops before the tets can write, too.
constexpr bool is_surface_format(MeshFormat format) {
  return format >= MeshFormat::Stl;
}

struct RunRequest {
  std::filesystem::path input;    ///< label volume: .nii, .nii.gz, .mha, .mhd, .nrrd
  std::filesystem::path out_dir;  ///< made with its parents where it does not exist
  Parameters parameters;
  std::filesystem::path sample;  ///< an image to sample onto the tets; empty: none
  /// Names that are not in the parameters, whose own win; those of absent labels are not used.
  std::map<Label, std::string> label_names;
  std::optional<Space> space;  ///< of the written coordinates; default: the input's own
  bool keep_stages = false;    ///< each stage's result to out_dir/NAME.stages/
  bool surface_only = false;   ///< stop before the tets
  /// To write; with `surface_only` those of tets are left out.
  std::set<MeshFormat> formats{MeshFormat::Vtu, MeshFormat::Mesh};
  bool html_report = false;  ///< NAME.report.html, too
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
/// With NAME the input's file name without its suffix, writes the formats asked for,
/// NAME.surface.vtp, on request NAME.report.html and, last, NAME.metrics.json; files of an earlier
/// run of that NAME are removed when the run starts, where `force` allows it, and a failed run
/// leaves nothing but
/// NAME.failed.json. The seed of the run is that of the parameters, whatever `context` says.
///
/// @throws Error with the codes of README, "Exit codes"; Output before any long work when
///         `out_dir` cannot be written or has such files; Limit before most of it when the forecast
///         is far beyond a limit
RunResult run_pipeline(const RunRequest& request, const StageContext& context);

}  // namespace cvmesh
