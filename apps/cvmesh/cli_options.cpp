// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cli_options.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/io/label_names.h"
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
    "  cvmesh metrics mesh.vtu scan.nii.gz                    judge a mesh of any program\n"
    "  cvmesh compare old/scan.metrics.json new/scan.metrics.json\n"
    "                                                         what changed, within tolerances?\n"
    "  cvmesh summary runs --out runs.csv                     many runs in one table\n"
    "  cvmesh check scan.nii.gz                               labels, forecast of time and memory\n"
    "  cvmesh defaults > params.json                          a parameter file to start from\n"
    "  cvmesh schema                                          all parameters, as a JSON schema\n"
    "\n"
    "Exit codes: 0 ok, 1 internal error, 2 usage or parameter, 3 bad input, 4 a stage failed,\n"
    "5 a quality gate was missed, or a comparison beyond tolerance, 6 output cannot be written, 7 "
    "time or memory limit, 128+n signal "
    "n";

constexpr char kMeshFooter[] =
    "With NAME the input's name without suffix, writes NAME.vtu and NAME.mesh (or what --formats\n"
    "names), NAME.surface.vtp, with --report NAME.report.html and, last, NAME.metrics.json; a run\n"
    "that fails leaves NAME.failed.json only.";

constexpr char kMetricsFooter[] =
    "Labels of the tets: in .vtu the cell array labels, else material, ref, medit:ref,\n"
    "gmsh:physical, gmsh:geometrical; in .mesh the references; in .msh the physical groups.\n"
    "Faults of the mesh are reported and are no error.";

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
      {"vtu", MeshFormat::Vtu}, {"mesh", MeshFormat::Mesh},   {"inp", MeshFormat::Inp},
      {"msh", MeshFormat::Msh}, {"msh22", MeshFormat::Msh22}, {"feb", MeshFormat::Feb},
      {"stl", MeshFormat::Stl}, {"ply", MeshFormat::Ply},     {"vtp", MeshFormat::Vtp}};
  return formats;
}

/// CLI11's own would tell the largest double there is.
CLI::Validator is_positive() {
  return CLI::Validator(
      [](const std::string& text) {
        double value = 0;
        return CLI::detail::lexical_cast(text, value) && value > 0
                   ? std::string()
                   : "'" + text + "' is no number above 0";
      },
      "POSITIVE");
}

void add_threads_option(CLI::App& command, CliOptions& options) {
  command
      .add_option("--threads", options.threads,
                  "Number of threads; default: SLURM_CPUS_PER_TASK, or all cores that the process "
                  "and its control group (cpu.max) may use")
      ->check(CLI::Range(1, 4096));
}

/// What every command that reads a label volume takes.
/// @param input  a string; or several, where more than one are refused later
template <typename Input>
void add_reader_options(CLI::App& command, Input& input, ReadVolumeOptions& read) {
  command.add_option("LABELS", input, "Label volume: .nii .nii.gz .mha .mhd .nrrd")->required();
  command.add_option("--volume", read.volume, "Which volume of a 4-D file, from 0")
      ->check(CLI::NonNegativeNumber);
  command.add_flag("--allow-shear", read.allow_shear,
                   "Take axes that are more than 1 % off a right angle");
  command.add_flag("--allow-detached", read.allow_detached,
                   "Follow a header to voxels in a file beside it");
}

void add_label_names_option(CLI::App& command, std::string& file) {
  command.add_option("--label-names", file,
                     "Names of labels: an ITK-SNAP label description or a 3D Slicer colour table; "
                     "names in the parameter file win");
}

void add_check_command(CLI::App& app, CliOptions& options) {
  CLI::App* check = app.add_subcommand(
      "check", "Read and validate a label volume, print its labels and what meshing would take");
  add_reader_options(*check, options.check.input, options.check.read);
  check->add_option("--params", options.check.params_file, "Parameter file (JSON)");
  add_label_names_option(*check, options.check.label_names_file);
  check->add_option("--set", options.check.settings, "key=value, over the parameter file")
      ->allow_extra_args(false);
  add_threads_option(*check, options);
  check->add_flag("--json", options.check.as_json, "Print JSON");
}

CLI::App* add_metrics_command(CLI::App& app, CliOptions& options, std::string& space) {
  CLI::App* metrics = app.add_subcommand("metrics", "Judge a mesh of tets against a label volume");
  metrics->footer(kMetricsFooter);
  MetricsCommand& command = options.metrics;
  metrics->add_option("MESH", command.mesh, "Tets: .vtu, .mesh (Medit) or .msh (Gmsh)")->required();
  add_reader_options(*metrics, command.labels, command.read);
  metrics->add_option("--truth", command.truth,
                      "True surface in the mesh's coordinates: .off, .ply or .stl");
  metrics->add_option("--params", command.params_file,
                      "Parameter file (JSON) whose keys for labels are applied to the volume");
  metrics
      ->add_option("--space", space,
                   "Coordinates of the mesh, where its file does not state them; default: the "
                   "volume's own")
      ->transform(CLI::IsMember(space_choices(), CLI::ignore_case))
      ->default_str("input");
  metrics->add_option("--out", command.out_file, "Write the report as JSON to this file");
  metrics->add_flag("--json", command.as_json, "Print the report as JSON instead of a table");
  add_threads_option(*metrics, options);
  metrics->add_flag("-v,--verbose", options.is_verbose, "Say more");
  return metrics;
}

void add_mesh_command(CLI::App& app,
                      CliOptions& options,
                      std::string& space,
                      std::string& seed,
                      std::vector<std::string>& inputs) {
  CLI::App* mesh = app.add_subcommand("mesh", "Mesh a label volume");
  mesh->footer(kMeshFooter);
  add_reader_options(*mesh, inputs, options.mesh.read);
  mesh->add_option("--params", options.mesh.params_file,
                   "Parameter file (JSON); default: the built-in values (cvmesh defaults)");
  add_label_names_option(*mesh, options.mesh.label_names_file);
  mesh->add_option("--sample", options.mesh.sample_file,
                   "An image, such as CT, whose mean and median in each tet are written with the "
                   "tets; laws of density and modulus are in the parameter file");
  mesh->add_option("--out", options.mesh.out_dir, "Folder of the results, made if needed")
      ->capture_default_str();
  mesh->add_option("--space", space,
                   "Coordinates of the results: the input's own, RAS, LPS, or grid mm")
      ->transform(CLI::IsMember(space_choices(), CLI::ignore_case))
      ->default_str("input");
  mesh->add_option("--formats", options.mesh.formats,
                   "Files to write, as in vtu,inp. Tets: vtu (VTK), mesh (Medit), inp (Abaqus and "
                   "CalculiX), msh and msh22 (Gmsh 4.1 and 2.2), feb (FEBio). A surface per label "
                   "and per interface: stl, ply, vtp")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->transform(CLI::IsMember(formats_by_name(), CLI::ignore_case))
      ->default_str("vtu,mesh");
  mesh->add_option("--set", options.mesh.settings,
                   "key=value, over the parameter file; labels.2.epsilon=0.5 for one label")
      ->allow_extra_args(false);
  mesh->add_option("--seed", seed, "Short for --set seed=N");
  add_threads_option(*mesh, options);
  mesh->add_flag("--resume", options.mesh.resume,
                 "End at once where OUT has the results of the same input and parameters");
  mesh->add_flag("--force", options.mesh.force, "Replace the results of an earlier run");
  mesh->add_option("--time-limit", options.mesh.limits.time_s, "Most seconds of the run")
      ->check(is_positive());
  mesh->add_option("--memory-limit", options.mesh.limits.memory_mb,
                   "Most resident memory of the run, in MiB")
      ->check(is_positive());
  mesh->add_flag("--keep-stages", options.mesh.keep_stages,
                 "Write each stage's result to OUT/NAME.stages");
  mesh->add_flag("--surface-only", options.mesh.surface_only, "Stop before the tets");
  mesh->add_flag("--report", options.mesh.html_report,
                 "Write NAME.report.html, too: tables, plots and the mesh in 3-D, for a browser");
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

/// CLI11 would say that a command is missing, whatever word is in its place.
void require_command(const CLI::App& app, const std::string& word) {
  if (word.empty() || word.front() == '-') return;
  std::string names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (command->get_name() == word) return;
    names += (names.empty() ? "" : ", ") + command->get_name();
  }
  throw Error(ErrorCode::BadParameter, "command line",
              "'" + word + "' is none of the commands " + names +
                  "; to mesh a volume: cvmesh mesh scan.nii.gz --out results");
}

}  // namespace

CliOutcome parse_command_line(int argc, char** argv) {
  CliOutcome outcome;
  CliOptions& options = outcome.options;
  CLI::App app("Conformal multi-material tetrahedral meshes of segmented images", "cvmesh");
  app.footer(kExamples);
  app.set_version_flag("--version", std::string("cvmesh ") + kVersion);
  app.require_subcommand(1);

  std::string space, seed, metrics_space;
  std::vector<std::string> inputs;
  add_mesh_command(app, options, space, seed, inputs);
  CLI::App* metrics = add_metrics_command(app, options, metrics_space);
  add_compare_command(app, options.compare);
  add_summary_command(app, options.summary);
  add_check_command(app, options);
  CLI::App* schema = app.add_subcommand("schema", "Print the JSON schema of the parameter file");
  schema->add_flag("--metrics", options.schema_of_metrics, "That of the report, NAME.metrics.json");
  CLI::App* defaults = app.add_subcommand("defaults", "Print a parameter file with all defaults");
  defaults->add_flag("--tolerances", options.is_of_tolerances,
                     "The tolerances file of `cvmesh compare` instead");
  if (argc > 1) require_command(app, argv[1]);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {  // help and version
      outcome.exit_code = app.exit(error);
      return outcome;
    }
    const auto commands = app.get_subcommands();
    const std::string command = commands.empty() ? "" : commands.front()->get_name() + " ";
    throw Error(ErrorCode::BadParameter, "command line",
                std::string(error.what()) + "; cvmesh " + command + "--help lists what there is");
  }
  if (*metrics) options.command = Command::Metrics;
  if (app.got_subcommand("compare")) options.command = Command::Compare;
  if (app.got_subcommand("summary")) options.command = Command::Summary;
  if (app.got_subcommand("check")) options.command = Command::Check;
  if (*schema) options.command = Command::Schema;
  if (*defaults) options.command = Command::Defaults;
  if (inputs.size() > 1)
    throw Error(ErrorCode::BadParameter, "command line",
                "cvmesh mesh takes one volume, and there are " + std::to_string(inputs.size()) +
                    " (" + inputs[0] + ", " + inputs[1] + (inputs.size() > 2 ? ", ..." : "") +
                    "); run it once per subject, as scripts/cohort/slurm_cohort.sh (SLURM) and "
                    "scripts/cohort/Snakefile do");
  if (!inputs.empty()) options.mesh.input = inputs.front();
  options.mesh.space = space_of(space);
  options.metrics.space = space_of(metrics_space);
  options.mesh.formats_given = app.get_subcommand("mesh")->count("--formats") > 0;
  if (!seed.empty()) options.mesh.settings.push_back("seed=" + seed);
  return outcome;
}

Parameters read_parameters(const std::string& file, const std::vector<std::string>& settings) {
  const nlohmann::ordered_json json =
      file.empty() ? nlohmann::ordered_json::object() : read_json(file);
  const std::string source = file.empty() ? "--set" : "'" + file + "'";
  return parse_parameters(json, source, settings);
}

namespace {

/// What is asked of tets has no place where there are none.
void refuse_without_tets(const MeshCommand& command, const Parameters& parameters) {
  const auto refuse = [](const char* option) {
    throw Error(ErrorCode::BadParameter, "command line",
                std::string(option) +
                    " is about tets, which --surface-only does not make; leave "
                    "one of the two out");
  };
  if (!command.sample_file.empty()) refuse("--sample");
  if (parameters.element_order > 1) refuse("element_order 2");
  if (!parameters.contact.empty()) refuse("contact");
}

}  // namespace

RunRequest make_request(const MeshCommand& command) {
  RunRequest request;
  request.input = command.input;
  request.out_dir = command.out_dir;
  request.parameters = read_parameters(command.params_file, command.settings);
  if (command.surface_only) refuse_without_tets(command, request.parameters);
  if (!command.label_names_file.empty())
    request.label_names = read_label_names(command.label_names_file);
  request.sample = command.sample_file;
  request.space = command.space;
  request.keep_stages = command.keep_stages;
  request.surface_only = command.surface_only;
  request.html_report = command.html_report;
  request.force = command.force;
  request.read = command.read;
  request.limits = command.limits;
  request.formats.clear();
  for (const std::string& name : command.formats) {
    const MeshFormat format = formats_by_name().at(name);
    if (command.surface_only && command.formats_given && !is_surface_format(format))
      throw Error(ErrorCode::BadParameter, "command line",
                  "--formats " + name +
                      " is a file of tets, which --surface-only does not make; "
                      "leave one of the two out, or ask for stl, ply or vtp");
    request.formats.insert(format);
  }
  return request;
}

}  // namespace cvmesh::app
