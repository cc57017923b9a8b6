// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cli_options.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/params/parse_parameters.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <map>

namespace cvmesh::app {

namespace {

constexpr char kExamples[] =
    "Examples:\n"
    "  cvmesh mesh scan.nii.gz --out mesh                     with the default parameters\n"
    "  cvmesh mesh scan.nii.gz --params ct.json --out mesh    with a parameter file\n"
    "  cvmesh mesh scan.nii.gz --set epsilon=4 --out mesh     coarser\n"
    "  cvmesh mesh scan.nii.gz --set target_vertices=20000    by the number of surface vertices\n"
    "  cvmesh check scan.nii.gz                               labels, forecast of time and memory\n"
    "  cvmesh defaults > params.json                          a parameter file to start from\n"
    "  cvmesh schema                                          all parameters, as a JSON schema\n"
    "\n"
    "Exit codes: 0 ok, 1 internal error, 2 usage or parameter, 3 bad input, 4 a stage failed,\n"
    "5 a quality gate was missed, 6 output cannot be written, 7 time or memory limit, 128+n signal "
    "n";

constexpr char kMeshFooter[] =
    "With NAME the input's name without suffix, writes NAME.vtu and NAME.mesh (or what --formats\n"
    "names), NAME.surface.vtp and, last, NAME.metrics.json; a run that fails leaves\n"
    "NAME.failed.json only.";

const std::map<std::string, std::string>& space_choices() {
  static const std::map<std::string, std::string> choices = {
      {"input", "input"}, {"ras", "ras"}, {"lps", "lps"}, {"grid", "grid"}};
  return choices;
}

std::optional<Space> space_of(const std::string& name) {
  if (name == "ras") return Space::Ras;
  if (name == "lps") return Space::Lps;
  if (name == "grid") return Space::Grid;
  return std::nullopt;
}

const std::map<std::string, MeshFormat>& formats_by_name() {
  static const std::map<std::string, MeshFormat> formats = {
      {"vtu", MeshFormat::Vtu}, {"mesh", MeshFormat::Mesh}, {"inp", MeshFormat::Inp}};
  return formats;
}

/// What every command that reads a label volume takes.
void add_reader_options(CLI::App& command, std::string& input, ReadVolumeOptions& read) {
  command.add_option("LABELS", input, "Label volume: .nii .nii.gz .mha .mhd .nrrd")->required();
  command.add_option("--volume", read.volume, "Which volume of a 4-D file, from 0")
      ->check(CLI::NonNegativeNumber);
  command.add_flag("--allow-shear", read.allow_shear,
                   "Take axes that are more than 1 % off a right angle");
  command.add_flag("--allow-detached", read.allow_detached,
                   "Follow a header to voxels in a file beside it");
}

void add_check_command(CLI::App& app, CliOptions& options) {
  CLI::App* check = app.add_subcommand(
      "check", "Read and validate a label volume, print its labels and what meshing would take");
  add_reader_options(*check, options.check.input, options.check.read);
  check->add_option("--params", options.check.params_file, "Parameter file (JSON)");
  check->add_option("--set", options.check.settings, "key=value, over the parameter file")
      ->allow_extra_args(false);
  check->add_option("--threads", options.threads, "Number of threads of the run that is forecast")
      ->check(CLI::Range(1, 4096));
  check->add_flag("--json", options.check.as_json, "Print JSON");
}

void add_mesh_command(CLI::App& app, CliOptions& options, std::string& space, std::string& seed) {
  CLI::App* mesh = app.add_subcommand("mesh", "Mesh a label volume");
  mesh->footer(kMeshFooter);
  add_reader_options(*mesh, options.mesh.input, options.mesh.read);
  mesh->add_option("--params", options.mesh.params_file,
                   "Parameter file (JSON); default: defaults");
  mesh->add_option("--out", options.mesh.out_dir, "Folder of the results, made if needed")
      ->capture_default_str();
  mesh->add_option("--space", space,
                   "Coordinates of the results: the input's own, RAS, LPS, or grid mm")
      ->transform(CLI::IsMember(space_choices(), CLI::ignore_case))
      ->default_str("input");
  CLI::Option* formats =
      mesh->add_option("--formats", options.mesh.formats,
                       "Files of the tets, as in vtu,inp: vtu (VTK), mesh (Medit), inp (Abaqus and "
                       "CalculiX)")
          ->delimiter(',')
          ->allow_extra_args(false)
          ->transform(CLI::IsMember(formats_by_name(), CLI::ignore_case))
          ->default_str("vtu,mesh");
  mesh->add_option("--set", options.mesh.settings,
                   "key=value, over the parameter file; labels.2.epsilon=0.5 for one label")
      ->allow_extra_args(false);
  mesh->add_option("--seed", seed, "Short for --set seed=N");
  mesh->add_option("--threads", options.threads,
                   "Number of threads; default: SLURM_CPUS_PER_TASK or all cores")
      ->check(CLI::Range(1, 4096));
  mesh->add_flag("--force", options.mesh.force, "Replace the results of an earlier run");
  mesh->add_option("--time-limit", options.mesh.limits.time_s, "Most seconds of the run")
      ->check(CLI::PositiveNumber);
  mesh->add_option("--memory-limit", options.mesh.limits.memory_mb,
                   "Most resident memory of the run, in MiB")
      ->check(CLI::PositiveNumber);
  mesh->add_flag("--keep-stages", options.mesh.keep_stages,
                 "Write each stage's result to OUT/stages");
  mesh->add_flag("--surface-only", options.mesh.surface_only, "Stop before the tets")
      ->excludes(formats);
  CLI::Option* quiet = mesh->add_flag("-q,--quiet", options.is_quiet, "Warnings and errors only");
  mesh->add_flag("-v,--verbose", options.is_verbose, "Say more")->excludes(quiet);
}

}  // namespace

CliOutcome parse_command_line(int argc, char** argv) {
  CliOutcome outcome;
  CliOptions& options = outcome.options;
  CLI::App app("Conformal multi-material tetrahedral meshes of segmented images", "cvmesh");
  app.footer(kExamples);
  app.set_version_flag("--version", std::string("cvmesh ") + kVersion);
  app.require_subcommand(1);

  std::string space, seed;
  add_mesh_command(app, options, space, seed);
  add_check_command(app, options);
  CLI::App* schema = app.add_subcommand("schema", "Print the JSON schema of the parameter file");
  CLI::App* defaults = app.add_subcommand("defaults", "Print a parameter file with all defaults");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // CLI11 has exit codes of its own, all above 100; ours says "usage".
    outcome.exit_code = app.exit(error) == 0 ? 0 : static_cast<int>(ErrorCode::BadParameter);
    return outcome;
  }
  if (app.got_subcommand("check")) options.command = Command::Check;
  if (*schema) options.command = Command::Schema;
  if (*defaults) options.command = Command::Defaults;
  options.mesh.space = space_of(space);
  if (!seed.empty()) options.mesh.settings.push_back("seed=" + seed);
  return outcome;
}

Parameters read_parameters(const std::string& file, const std::vector<std::string>& settings) {
  const nlohmann::ordered_json json =
      file.empty() ? nlohmann::ordered_json::object() : read_json(file);
  return parse_parameters(json, "'" + file + "'", settings);
}

RunRequest make_request(const MeshCommand& command) {
  RunRequest request;
  request.input = command.input;
  request.out_dir = command.out_dir;
  request.parameters = read_parameters(command.params_file, command.settings);
  request.space = command.space;
  request.keep_stages = command.keep_stages;
  request.surface_only = command.surface_only;
  request.force = command.force;
  request.read = command.read;
  request.limits = command.limits;
  request.formats.clear();
  for (const std::string& name : command.formats)
    request.formats.insert(formats_by_name().at(name));
  return request;
}

}  // namespace cvmesh::app
