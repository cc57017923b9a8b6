// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace cvmesh {

/// How a run ended, as its report tells.
enum class RunStatus { Success, MissedGates, Failed, Unreadable };

/// One row of a summary: a cell for each of `summary_columns()`, already as CSV.
struct RunSummary {
  RunStatus status = RunStatus::Unreadable;
  std::vector<std::string> cells;
};

/// Names of the columns.
const std::vector<std::string_view>& summary_columns();

/// The row of a NAME.metrics.json or NAME.failed.json; what it does not tell stays empty. A
/// document that is no report of this layout gives an unreadable row that says so.
/// @param run  what to call it: the path of NAME
RunSummary summarize_report(const nlohmann::ordered_json& json, const std::string& run);

/// The row of a file that cannot be read, and why.
RunSummary unreadable_row(const std::string& run, const std::string& reason);

/// A text as a CSV field [RFC 4180]: quoted where it holds a comma, a quote or a line break. Names
/// that a spreadsheet would take for a formula (first character =, +, -, @, tab or CR) get an
/// apostrophe in front.
std::string csv_text(const std::string& text);

/// Cells as one CSV record, with its line end (CR LF).
std::string csv_record(const std::vector<std::string>& cells);

}  // namespace cvmesh
