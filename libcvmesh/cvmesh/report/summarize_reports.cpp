// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/summarize_reports.h"

#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

/// A column whose cell is what the report holds at one place.
struct Column {
  std::string_view name;
  std::string_view pointer;  ///< JSON pointer; empty where a rule of its own gives the cell
};

constexpr std::string_view kRun = "run", kStatus = "status", kLabels = "labels",
                           kVolumeError = "max_volume_error_percent", kMissedGates = "missed_gates",
                           kMessage = "message";

constexpr Column kColumns[] = {
    {kRun, ""},
    {kStatus, ""},
    {"file", "/input/file"},
    {kLabels, ""},
    {"epsilon", "/parameters/epsilon"},
    {"seed", "/parameters/seed"},
    {"points", "/results/mesh/points"},
    {"surface_vertices", "/results/mesh/surface_vertices"},
    {"surface_triangles", "/results/mesh/surface_triangles"},
    {"tets", "/results/mesh/tets"},
    {"kept_vertices", "/results/stages/decimation/kept_count"},
    {"triangle_quality_mean", "/results/quality/triangles/radius_ratio/mean"},
    {"triangle_quality_min", "/results/quality/triangles/radius_ratio/min"},
    {"tet_quality_mean", "/results/quality/tets/radius_ratio/mean"},
    {"tet_quality_min", "/results/quality/tets/radius_ratio/min"},
    {"min_dihedral_deg", "/results/quality/tets/min_dihedral_deg/min"},
    {"max_dihedral_deg", "/results/quality/tets/max_dihedral_deg/max"},
    {"mean_distance_to_dense_vox", "/results/distances/to_dense/voxels/mean_symmetric"},
    {"max_distance_to_dense_vox", "/results/distances/to_dense/voxels/hausdorff_lower_bound"},
    {"mean_distance_to_dense_mm", "/results/distances/to_dense/mm/mean_symmetric"},
    {"max_distance_to_dense_mm", "/results/distances/to_dense/mm/hausdorff_lower_bound"},
    {"mean_distance_to_labels_vox", "/results/distances/to_labels/voxels/mean_symmetric"},
    {"max_distance_to_labels_vox", "/results/distances/to_labels/voxels/hausdorff_lower_bound"},
    {kVolumeError, ""},
    {kMissedGates, ""},
    {"seconds", "/timings/total_seconds"},
    {"peak_mb", "/timings/peak_mb"},
    {"threads", "/timings/threads"},
    {"version", "/cvmesh"},
    {kMessage, ""}};

/// What is at a place, or null.
const Json& at(const Json& json, std::string_view pointer) {
  static const Json null;
  const Json::json_pointer place{std::string(pointer)};
  return json.contains(place) ? json.at(place) : null;
}

std::string text_at(const Json& json, std::string_view pointer) {
  const Json& value = at(json, pointer);
  return value.is_string() ? value.get<std::string>() : std::string();
}

std::string cell(const Json& value) {
  if (value.is_string()) return csv_text(value.get<std::string>());
  return value.is_number() || value.is_boolean() ? value.dump() : std::string();
}

/// Number of labels that were meshed, or would have been.
std::string label_count(const Json& json) {
  const Json& labels = at(json, "/results/labels");
  if (!labels.is_array() || labels.empty()) return {};
  return std::to_string(std::count_if(labels.begin(), labels.end(), [](const Json& label) {
    return at(label, "/voxels_kept").is_number() && at(label, "/voxels_kept") > 0;
  }));
}

std::string largest_volume_error_percent(const Json& json) {
  std::optional<double> largest;
  const Json& labels = at(json, "/results/labels");
  if (labels.is_array())
    for (const Json& label : labels) {
      const Json& error = at(label, "/volume/relative_error");
      if (error.is_number())
        largest = std::max(largest.value_or(0), 100 * std::abs(error.get<double>()));
    }
  return largest ? Json(*largest).dump() : std::string();
}

/// Names of the gates that were missed, in the report's order.
std::string missed_gates(const Json& json) {
  std::string names;
  const Json& gates = at(json, "/results/gates");
  if (gates.is_array())
    for (const Json& gate : gates)
      if (at(gate, "/passed") == false) {
        if (!names.empty()) names += ' ';
        names += text_at(gate, "/gate");
      }
  return names;
}

const char* status_name(RunStatus status) {
  switch (status) {
    case RunStatus::Success:
      return "success";
    case RunStatus::MissedGates:
      return "missed gates";
    case RunStatus::Failed:
      return "failed";
    case RunStatus::Unreadable:
      break;
  }
  return "unreadable";
}

/// Why a document is no report that can be summarised; empty if it can.
std::string fault_of(const Json& json) {
  if (!json.is_object() || !json.contains("cvmesh") || !json.contains("schema_version"))
    return "no report of cvmesh: it has no keys cvmesh and schema_version";
  if (json["schema_version"] != kReportSchemaVersion)
    return fmt::format("schema_version is {}, and this cvmesh reads {}",
                       json["schema_version"].dump(), kReportSchemaVersion);
  const std::string status = text_at(json, "/status");
  if (status != "success" && status != "failed")
    return fmt::format("status is {}, neither success nor failed", at(json, "/status").dump());
  return {};
}

}  // namespace

const std::vector<std::string_view>& summary_columns() {
  static const std::vector<std::string_view> names = [] {
    std::vector<std::string_view> all;
    for (const Column& column : kColumns)
      all.push_back(column.name);
    return all;
  }();
  return names;
}

RunSummary summarize_report(const Json& json, const std::string& run) {
  const std::string fault = fault_of(json);
  if (!fault.empty()) return unreadable_row(run, fault);

  const std::string missed = missed_gates(json);
  RunSummary row;
  row.status = text_at(json, "/status") == "failed" ? RunStatus::Failed
               : missed.empty()                     ? RunStatus::Success
                                                    : RunStatus::MissedGates;
  for (const auto& [name, pointer] : kColumns) {
    if (name == kRun)
      row.cells.push_back(csv_text(run));
    else if (name == kStatus)
      row.cells.emplace_back(status_name(row.status));
    else if (name == kLabels)
      row.cells.push_back(label_count(json));
    else if (name == kVolumeError)
      row.cells.push_back(largest_volume_error_percent(json));
    else if (name == kMissedGates)
      row.cells.push_back(csv_text(missed));
    else if (name == kMessage)
      row.cells.push_back(row.status == RunStatus::Failed
                              ? csv_text(text_at(json, "/stage") + ": " + text_at(json, "/message"))
                              : std::string());
    else
      row.cells.push_back(cell(at(json, pointer)));
  }
  return row;
}

RunSummary unreadable_row(const std::string& run, const std::string& reason) {
  RunSummary row;
  for (const auto& [name, pointer] : kColumns)
    row.cells.push_back(name == kRun       ? csv_text(run)
                        : name == kStatus  ? status_name(RunStatus::Unreadable)
                        : name == kMessage ? csv_text(reason)
                                           : std::string());
  return row;
}

std::string csv_text(const std::string& text) {
  constexpr std::string_view kFormulaStarts = "=+-@\t\r";
  const bool is_formula = !text.empty() && kFormulaStarts.find(text.front()) != std::string::npos;
  const std::string harmless = is_formula ? "'" + text : text;
  if (harmless.find_first_of(",\"\r\n") == std::string::npos) return harmless;
  std::string quoted = "\"";
  for (const char c : harmless) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string csv_record(const std::vector<std::string>& cells) {
  std::string record;
  for (std::size_t n = 0; n < cells.size(); ++n)
    record += (n == 0 ? "" : ",") + cells[n];
  return record + "\r\n";
}

}  // namespace cvmesh
