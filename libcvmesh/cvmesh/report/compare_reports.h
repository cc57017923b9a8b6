// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/report/report_tolerances.h"

#include <nlohmann/json_fwd.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace cvmesh {

/// A number, text, boolean or null of a report, as JSON text, and as a number where it is one.
struct ReportValue {
  std::string text;
  std::optional<double> number;
};

/// The values of a JSON document with their paths (see `ToleranceRule`), in its order.
///
/// Entries of a list are named by what they are about, so that they are found again when the list
/// has grown: labels by their value, interfaces and pairs by their two labels, as in `2-0`, stages
/// and gates by name; others by their place, from 0. `count` is the length of a list.
std::vector<std::pair<std::string, ReportValue>> flatten_report(const nlohmann::ordered_json& json,
                                                                const std::string& path);

enum class Verdict {
  Equal,
  Within,   ///< changed, by no more than the tolerance
  Beyond,   ///< changed by more
  Missing,  ///< only A has it: as bad as beyond
  New,      ///< only B has it: told, but no fault, since newer versions report more
  Ignored,  ///< whatever it is
};

const char* verdict_name(Verdict verdict);

/// One value of two reports.
struct ComparedValue {
  std::string path;
  std::optional<ReportValue> a, b;
  std::optional<double> difference;           ///< b - a
  std::optional<double> relative_difference;  ///< over |a|; empty where a is 0
  Tolerance tolerance;
  Verdict verdict = Verdict::Equal;
};

/// Two reports, value by value in the order of A, then what only B has.
struct ReportComparison {
  std::vector<ComparedValue> values;
  /// What differs in version, input and parameters: no fault, but what a reader must know.
  std::vector<ComparedValue> conditions;

  [[nodiscard]] std::size_t count(Verdict verdict) const;

  /// Nothing is beyond its tolerance, and nothing is missing.
  [[nodiscard]] bool is_within() const;
};

struct CompareOptions {
  ToleranceRules tolerances = default_tolerances();
  bool with_timings = false;  ///< the part `timings`, too
};

/// What changed from report `a` to report `b` in their part `results`.
/// @pre both passed `check_report`, with timings where these are compared
ReportComparison compare_reports(const nlohmann::ordered_json& a,
                                 const nlohmann::ordered_json& b,
                                 const CompareOptions& options);

/// Nothing, if `json` is the report of a finished run that this version can read.
/// @param source        name of the file in messages
/// @param with_timings  whether it must have timings; baselines may be stored without
/// @throws Error BadInput that says what it is instead
void check_report(const nlohmann::ordered_json& json, const std::string& source, bool with_timings);

/// The comparison for other programs: {verdict, compared, changed, beyond, missing, new, ignored,
/// conditions, values}; `values` holds what is not equal and not ignored.
nlohmann::ordered_json comparison_to_json(const ReportComparison& comparison);

}  // namespace cvmesh
