// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/params/parameters.h"
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
  bool html_report = false;    ///< NAME.report.html, too
  std::set<MeshFormat> formats{MeshFormat::Vtu, MeshFormat::Mesh};  ///< to write the tets in
};

struct RunResult {
  Report report;
  std::vector<std::filesystem::path> files;  ///< that were written, the metrics file last
};

/// One run from label volume to mesh and report.
///
/// With NAME the input's file name without its suffix, writes the tets in the formats asked for,
/// NAME.surface.vtp, on request NAME.report.html and, last, NAME.metrics.json; files of an earlier
/// run of that NAME are removed when the run starts, and a failed run leaves nothing but
/// NAME.failed.json. The seed of the run is that of the parameters, whatever `context` says.
///
/// @throws Error with the codes of README, "Exit codes"; Output before any long work when
///         `out_dir` cannot be written
RunResult run_pipeline(const RunRequest& request, const StageContext& context);

}  // namespace cvmesh
