// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"
#include "cvmesh/report/report.h"

#include <nlohmann/json_fwd.hpp>

namespace cvmesh {

/// Version of the report's layout: raised when a key changes its meaning or goes.
inline constexpr int kReportSchemaVersion = 2;

/// The key of the report under which `Report::run_key` stands.
inline constexpr char kRunKey[] = "run_key";

/// The report of a finished run, NAME.metrics.json:
/// {cvmesh, schema_version, status, libraries, run_key, input, parameters, results, timings}.
///
/// Keys are the fields' names, with their units. `results.labels` has one entry per label with its
/// accounting, volume, topology, counts, distances and quality; the sections beside it hold what
/// concerns the whole mesh; `results.stages` the stats of every stage. Whatever differs between
/// equal runs is in `timings`.
nlohmann::ordered_json report_json(const Report& report);

/// What is known when a run has failed, NAME.failed.json: {cvmesh, schema_version, status, stage,
/// code, exit_code, message, input, parameters, results (of the stages that had finished),
/// timings}. With the signal that stopped it the code is "Signal" and the exit code 128 + signal.
nlohmann::ordered_json failure_json(const Report& report, const Error& error, int signal = 0);

/// "BadInput" and so on.
const char* code_name(ErrorCode code);

}  // namespace cvmesh
