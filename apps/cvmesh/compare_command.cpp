// SPDX-License-Identifier: AGPL-3.0-or-later
#include "compare_command.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/report/compare_reports.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iostream>
#include <iterator>
#include <vector>

namespace cvmesh::app {

namespace {

using Row = std::vector<std::string>;

/// Texts longer than this would push the other columns off the screen.
constexpr std::size_t kMostText = 24;

nlohmann::ordered_json read_report(const std::string& path, bool with_timings) {
  nlohmann::ordered_json report = read_json(path, ErrorCode::BadInput, "report");
  check_report(report, "'" + path + "'", with_timings);
  return report;
}

ToleranceRules tolerances_of(const std::string& file) {
  ToleranceRules rules = default_tolerances();
  if (file.empty()) return rules;
  const auto own =
      parse_tolerances(read_json(file, ErrorCode::BadParameter, "tolerances"), "'" + file + "'");
  rules.insert(rules.end(), own.begin(), own.end());
  return rules;
}

std::string value_text(const std::optional<ReportValue>& value) {
  if (!value) return "-";
  if (value->number) return fmt::format("{:.6g}", *value->number);
  if (value->text.size() <= kMostText) return value->text;
  return value->text.substr(0, kMostText - 3) + "...";
}

std::string tolerance_text(const Tolerance& tolerance) {
  if (tolerance.is_ignored) return "ignored";
  if (tolerance.abs == 0 && tolerance.rel == 0) return "exact";
  std::string text;
  if (tolerance.abs > 0) text = fmt::format("{:g}", tolerance.abs);
  if (tolerance.rel > 0)
    text += fmt::format("{}{:g} %", text.empty() ? "" : " or ", 100 * tolerance.rel);
  return text;
}

Row row_of(const ComparedValue& value) {
  return {
      value.path,
      value_text(value.a),
      value_text(value.b),
      value.difference ? fmt::format("{:+.4g}", *value.difference) : "",
      value.relative_difference ? fmt::format("{:+.2f} %", 100 * *value.relative_difference) : "",
      tolerance_text(value.tolerance),
      verdict_name(value.verdict)};
}

/// Left-aligned columns as wide as their widest cell.
std::string table_text(const std::vector<Row>& rows) {
  std::vector<std::size_t> widths(rows.front().size(), 0);
  for (const Row& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c)
      widths[c] = std::max(widths[c], row[c].size());
  std::string text;
  for (const Row& row : rows) {
    std::string line;
    for (std::size_t c = 0; c < row.size(); ++c)
      line += fmt::format("{:<{}}  ", row[c], widths[c]);
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

bool is_shown(Verdict verdict, const CompareCommand& command) {
  switch (verdict) {
    case Verdict::Beyond:
    case Verdict::Missing:
      return true;
    case Verdict::Within:
    case Verdict::New:
      return !command.is_quiet;
    case Verdict::Equal:
    case Verdict::Ignored:
      break;
  }
  return command.is_all;
}

std::string conditions_text(const ReportComparison& comparison) {
  std::string text;
  for (const ComparedValue& value : comparison.conditions)
    text += fmt::format("note: {} differs: {} and {}\n", value.path, value_text(value.a),
                        value_text(value.b));
  return text;
}

std::string comparison_text(const ReportComparison& comparison, const CompareCommand& command) {
  std::string text = command.is_quiet ? "" : conditions_text(comparison);
  std::vector<Row> rows = {{"path", "A", "B", "B - A", "relative", "tolerance", "verdict"}};
  for (const ComparedValue& value : comparison.values)
    if (is_shown(value.verdict, command)) rows.push_back(row_of(value));
  if (rows.size() > 1) text += table_text(rows);
  text += fmt::format(
      "{}: {} values compared, {} beyond their tolerance, {} missing, {} within, {} new, {} "
      "ignored\n",
      comparison.is_within() ? "within" : "beyond",
      comparison.values.size() - comparison.count(Verdict::Ignored),
      comparison.count(Verdict::Beyond), comparison.count(Verdict::Missing),
      comparison.count(Verdict::Within), comparison.count(Verdict::New),
      comparison.count(Verdict::Ignored));
  return text;
}

}  // namespace

int run_compare(const CompareCommand& command) {
  const CompareOptions options{.tolerances = tolerances_of(command.tolerances_file),
                               .with_timings = command.with_timings};
  const ReportComparison comparison =
      compare_reports(read_report(command.a, command.with_timings),
                      read_report(command.b, command.with_timings), options);
  if (!command.json_file.empty()) write_json(command.json_file, comparison_to_json(comparison));
  std::cout << comparison_text(comparison, command) << std::flush;
  require(std::cout.good(), ErrorCode::Output, "write", "standard output cannot be written");
  return comparison.is_within() ? 0 : static_cast<int>(ErrorCode::QualityGate);
}

}  // namespace cvmesh::app
