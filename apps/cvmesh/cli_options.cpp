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
    "  cvmesh compare old/scan.metrics.json new/scan.metrics.json\n"
    "                                                         what changed, within tolerances?\n"
    "  cvmesh summary runs --out runs.csv                     many runs in one table\n"
    "  cvmesh defaults > params.json                          a parameter file to start from\n"
    "  cvmesh schema                                          all parameters, as a JSON schema\n"
    "\n"
    "Exit codes: 0 ok, 1 internal error, 2 usage or parameter, 3 bad input, 4 a stage failed,\n"
    "5 a quality gate was missed, or a comparison beyond tolerance, 6 output cannot be written, 7 "
    "time or memory limit, 128+n signal "
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

void add_mesh_command(CLI::App& app, CliOptions& options, std::string& space, std::string& seed) {
  CLI::App* mesh = app.add_subcommand("mesh", "Mesh a label volume");
  mesh->footer(kMeshFooter);
  mesh->add_option("LABELS", options.mesh.input, "Label volume: .nii .nii.gz .mha .mhd .nrrd")
      ->required();
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
  mesh->add_flag("--keep-stages", options.mesh.keep_stages,
                 "Write each stage's result to OUT/stages");
  mesh->add_flag("--surface-only", options.mesh.surface_only, "Stop before the tets")
      ->excludes(formats);
  CLI::Option* quiet = mesh->add_flag("-q,--quiet", options.is_quiet, "Warnings and errors only");
  mesh->add_flag("-v,--verbose", options.is_verbose, "Say more")->excludes(quiet);
}

void add_compare_command(CLI::App& app, CompareCommand& command) {
  CLI::App* compare = app.add_subcommand("compare", "Tell what changed between two reports");
  compare->footer(
      "Compares the results of B with those of A, value by value. Exit code 0 when every change "
      "is\n"
      "within its tolerance, 5 when one is beyond or a value is missing, 3 for a file that is no\n"
      "report. `cvmesh defaults --tolerances` prints the tolerances.");
  compare->add_option("A", command.a, "The report to compare with: NAME.metrics.json")->required();
  compare->add_option("B", command.b, "The report that is judged")->required();
  compare->add_option("--tolerances", command.tolerances_file,
                      "Tolerances by path (JSON), over the built-in ones");
  compare->add_option("--json", command.json_file, "Write the comparison to a file, too");
  compare->add_flag("--timings", command.with_timings, "Compare seconds and memory, too");
  CLI::Option* quiet =
      compare->add_flag("-q,--quiet", command.is_quiet, "Only what is beyond its tolerance");
  compare->add_flag("--all", command.is_all, "What did not change, too")->excludes(quiet);
}

void add_summary_command(CLI::App& app, SummaryCommand& command) {
  CLI::App* summary = app.add_subcommand("summary", "Gather many runs in one CSV");
  summary->footer(
      "One row for each NAME.metrics.json and NAME.failed.json in the folders and below them. "
      "Exit\n"
      "code 0 when all runs succeeded, 5 when one failed, missed a gate or cannot be read.");
  summary->add_option("DIR", command.folders, "Folders of results")->required();
  summary->add_option("--out", command.out_file, "The CSV; default: standard output");
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
  add_compare_command(app, options.compare);
  add_summary_command(app, options.summary);
  CLI::App* schema = app.add_subcommand("schema", "Print the JSON schema of the parameter file");
  CLI::App* defaults = app.add_subcommand("defaults", "Print a parameter file with all defaults");
  defaults->add_flag("--tolerances", options.is_of_tolerances,
                     "The tolerances file of `cvmesh compare` instead");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // CLI11 has exit codes of its own, all above 100; ours says "usage".
    outcome.exit_code = app.exit(error) == 0 ? 0 : static_cast<int>(ErrorCode::BadParameter);
    return outcome;
  }
  if (app.got_subcommand("compare")) options.command = Command::Compare;
  if (app.got_subcommand("summary")) options.command = Command::Summary;
  if (*schema) options.command = Command::Schema;
  if (*defaults) options.command = Command::Defaults;
  options.mesh.space = space_of(space);
  if (!seed.empty()) options.mesh.settings.push_back("seed=" + seed);
  return outcome;
}

RunRequest make_request(const MeshCommand& command) {
  const nlohmann::ordered_json file = command.params_file.empty() ? nlohmann::ordered_json::object()
                                                                  : read_json(command.params_file);
  RunRequest request;
  request.input = command.input;
  request.out_dir = command.out_dir;
  request.parameters = parse_parameters(file, "'" + command.params_file + "'", command.settings);
  request.space = command.space;
  request.keep_stages = command.keep_stages;
  request.surface_only = command.surface_only;
  request.formats.clear();
  for (const std::string& name : command.formats)
    request.formats.insert(formats_by_name().at(name));
  return request;
}

}  // namespace cvmesh::app
