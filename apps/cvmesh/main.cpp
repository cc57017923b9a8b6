// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/cpu_limit.h"
#include "cvmesh/core/error.h"
#include "cvmesh/params/parameters_schema.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/pipeline/run_key.h"
#include "cvmesh/report/metrics_schema.h"
#include "cvmesh/report/report_tolerances.h"

#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include "cli_options.h"
#include "console.h"
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <string>
#include <unistd.h>
#include <vector>

namespace {

using namespace cvmesh;

constexpr int kSignalExitBase = 128;

std::atomic<bool> cancel_requested = false;
std::atomic<int> received_signal = 0;
static_assert(std::atomic<int>::is_always_lock_free, "set from a signal handler");

/// The first signal asks the run to stop and clean up; a second one ends it at once.
void on_signal(int signal) {
  if (received_signal.exchange(signal) != 0) _exit(kSignalExitBase + signal);
  cancel_requested = true;
}

/// For commands whose stages look at `cancel_requested`; others end as any program does.
void watch_signals() {
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
}

/// Threads of this run: as asked for, else all cores that the process and its control group may
/// use, and no more than the Slurm task was given.
std::size_t thread_count(int asked) {
  if (asked > 0) return static_cast<std::size_t>(asked);
  int count = tbb::info::default_concurrency();
  if (const int limit = cgroup_cpu_limit(); limit > 0) count = std::min(count, limit);
  const char* slurm = std::getenv("SLURM_CPUS_PER_TASK");     // NOLINT(concurrency-mt-unsafe)
  const int given = slurm != nullptr ? std::atoi(slurm) : 0;  // NOLINT(cert-err34-c): 0 is fine
  return static_cast<std::size_t>(given > 0 ? std::min(count, given) : count);
}

void print(const nlohmann::ordered_json& json) {
  std::cout << json.dump(2) << "\n" << std::flush;
  require(std::cout.good(), ErrorCode::Output, "write", "standard output cannot be written");
}

int exit_code_of(const Error& error) {
  const int signal = received_signal;
  return signal != 0 ? kSignalExitBase + signal : static_cast<int>(error.code());
}

void tell(const Error& error) {
  std::cerr << "cvmesh: error: " << error.what() << "\n";
}

/// A stage that does not stop cannot be stopped but with its process. The helper dies with it.
[[noreturn]] void end_at_once(const Error& error) {
  tell(error);
  std::cerr << std::flush;
  _exit(exit_code_of(error));
}

void require_gates(const std::vector<GateResult>& gates) {
  const std::string missed = missed_gates_message(gates);
  require(missed.empty(), ErrorCode::QualityGate, "gates", missed);
}

int run_mesh(const app::CliOptions& options) {
  const bool has_bar = !options.is_quiet && !options.is_verbose && app::is_terminal();
  RunRequest request = app::make_request(options.mesh);
  if (options.mesh.resume) {
    if (const auto gates = gates_if_finished(request)) {
      if (!options.is_quiet)
        std::cerr << "cvmesh: " << options.mesh.input
                  << " is done already, with these parameters\n";
      require_gates(*gates);
      return 0;
    }
  }
  watch_signals();
  request.signal = &received_signal;
  request.on_stuck = end_at_once;
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    thread_count(options.threads));
  app::ProgressBar bar;
  StageContext context;
  context.log = app::make_log(options.is_quiet, options.is_verbose, has_bar);
  context.progress = has_bar ? &bar : nullptr;
  context.cancel = &cancel_requested;
  try {
    const RunResult result = run_pipeline(request, context);
    if (!options.is_quiet) std::cerr << app::summary_table(result);
    require_gates(result.report.gates);
  } catch (...) {
    bar.clear();
    throw;
  }
  return 0;
}

int run_metrics(const app::CliOptions& options) {
  watch_signals();
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    thread_count(options.threads));
  StageContext context;
  context.log = app::make_log(!options.is_verbose, options.is_verbose, false);
  context.cancel = &cancel_requested;
  app::run_metrics(options.metrics, context);
  return 0;
}

int run_check(const app::CliOptions& options) {
  const std::size_t count = thread_count(options.threads);
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, count);
  return app::run_check(options.check,
                        app::read_parameters(options.check.params_file, options.check.settings),
                        static_cast<int>(count));
}

int run(int argc, char** argv) {
  const app::CliOutcome outcome = app::parse_command_line(argc, argv);
  if (outcome.exit_code) return *outcome.exit_code;
  switch (outcome.options.command) {
    case app::Command::Schema:
      print(outcome.options.schema_of_metrics ? metrics_schema() : parameters_schema());
      return 0;
    case app::Command::Defaults:
      print(outcome.options.is_of_tolerances ? tolerances_to_json(default_tolerances())
                                             : parameters_to_json(Parameters{}));
      return 0;
    case app::Command::Metrics:
      return run_metrics(outcome.options);
    case app::Command::Compare:
      return app::run_compare(outcome.options.compare);
    case app::Command::Summary:
      return app::run_summary(outcome.options.summary);
    case app::Command::Check:
      return run_check(outcome.options);
    case app::Command::Mesh:
      break;
  }
  return run_mesh(outcome.options);
}

}  // namespace

int main(int argc, char** argv) {
  // A closed pipe and a file that grows beyond its limit are errors of the write, not the end of
  // us.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return run(argc, argv);
  } catch (const Error& error) {
    tell(error);
    return exit_code_of(error);
  } catch (const std::exception& error) {
    std::cerr << "cvmesh: error: " << error.what() << "\n";
  }
  return static_cast<int>(ErrorCode::Internal);
}
