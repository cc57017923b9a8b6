// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/pipeline/pipeline.h"

#include "check_command.h"
#include "compare_command.h"
#include "metrics_command.h"
#include "summary_command.h"
#include <optional>
#include <string>
#include <vector>

namespace cvmesh::app {

enum class Command { Mesh, Check, Metrics, Compare, Summary, Schema, Defaults };

struct MeshCommand {
  std::string input, params_file, label_names_file, sample_file, out_dir = ".";
  std::optional<Space> space;         ///< empty: the input's own
  std::vector<std::string> settings;  ///< "key=value", `--seed N` among them
  std::vector<std::string> formats = {"vtu", "mesh"};
  bool formats_given = false;  ///< and not those of the default
  bool keep_stages = false, surface_only = false, html_report = false, resume = false,
       force = false;
  ReadVolumeOptions read;
  RunLimits limits;
};

struct CliOptions {
  Command command = Command::Mesh;
  MeshCommand mesh;
  CheckCommand check;
  MetricsCommand metrics;
  CompareCommand compare;
  SummaryCommand summary;
  bool is_of_tolerances = false;  ///< `defaults` of a tolerances file
  int threads = 0;                ///< 0: as many as the machine, or the Slurm task, has
  bool is_quiet = false, is_verbose = false;
  bool schema_of_metrics = false;  ///< `schema` prints that of the report
};

/// The command line, parsed; or, where it was answered already (help, version), the exit code.
struct CliOutcome {
  CliOptions options;
  std::optional<int> exit_code;
};

/// @throws Error BadParameter for what is no usage of it
CliOutcome parse_command_line(int argc, char** argv);

/// The parameters of a file ("" for none) with "key=value" settings over it.
/// @throws Error BadParameter
Parameters read_parameters(const std::string& file, const std::vector<std::string>& settings);

/// The run that a mesh command asks for: parameter file read, settings applied.
/// @throws Error BadParameter
RunRequest make_request(const MeshCommand& command);

}  // namespace cvmesh::app
