// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/compare_reports.h"

#include "cvmesh/core/error.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <span>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;
using Values = std::vector<std::pair<std::string, ReportValue>>;

/// Keys that tell what an entry of a list is about; the first set that an entry has in full counts.
constexpr std::array<std::string_view, 3> kWall = {"inside_label", "outside_label", "wall"};
constexpr std::array<std::string_view, 2> kSides = {"inside_label", "outside_label"};
constexpr std::array<std::string_view, 2> kPair = {"master_label", "slave_label"};
constexpr std::array<std::string_view, 1> kStage = {"stage"}, kGate = {"gate"}, kLabel = {"label"};
constexpr std::array<std::span<const std::string_view>, 6> kIdentities = {kWall,  kSides, kPair,
                                                                          kStage, kGate,  kLabel};

/// Keys of entries that are one place among many: they have no identity.
constexpr std::array<std::string_view, 2> kPlace = {"first_voxel", "position_grid_mm"};

/// What an entry is about, or nothing.
std::string identity_of(const Json& entry) {
  if (!entry.is_object()) return {};
  for (const std::string_view key : kPlace)
    if (entry.contains(std::string(key))) return {};
  for (const auto& keys : kIdentities) {
    std::string name;
    for (const std::string_view key : keys) {
      const auto found = entry.find(std::string(key));
      if (found == entry.end() || found->is_structured()) {
        name.clear();
        break;
      }
      if (!name.empty()) name += '-';
      name += found->is_string() ? found->get<std::string>() : found->dump();
    }
    if (!name.empty()) return name;
  }
  return {};
}

/// Names for the entries of a list: their identities, if all have one of their own.
std::vector<std::string> names_of(const Json& list) {
  std::vector<std::string> names, places;
  std::set<std::string> distinct;
  for (const Json& entry : list) {
    names.push_back(identity_of(entry));
    places.push_back(std::to_string(places.size()));
    distinct.insert(names.back());
  }
  const bool are_distinct = distinct.size() == names.size() && distinct.count("") == 0;
  return are_distinct ? names : places;
}

void flatten(const Json& json, const std::string& path, Values& values) {
  const auto below = [&](const std::string& key) { return path.empty() ? key : path + "." + key; };
  if (json.is_object()) {
    for (const auto& [key, value] : json.items())
      flatten(value, below(key), values);
  } else if (json.is_array()) {
    const double count = static_cast<double>(json.size());
    values.emplace_back(below("count"), ReportValue{std::to_string(json.size()), count});
    const std::vector<std::string> names = names_of(json);
    for (std::size_t n = 0; n < json.size(); ++n)
      flatten(json[n], below(names[n]), values);
  } else {
    ReportValue value{json.dump(-1, ' ', false, Json::error_handler_t::replace), std::nullopt};
    if (json.is_number()) value.number = json.get<double>();
    values.emplace_back(path, std::move(value));
  }
}

Verdict judge(const ComparedValue& value) {
  if (value.tolerance.is_ignored) return Verdict::Ignored;
  if (!value.b) return Verdict::Missing;
  if (!value.a) return Verdict::New;
  if (value.a->text == value.b->text) return Verdict::Equal;
  if (!value.difference) return Verdict::Beyond;
  if (*value.difference == 0) return Verdict::Equal;  // 2 and 2.0
  const double allowed =
      std::max(value.tolerance.abs, value.tolerance.rel * std::abs(*value.a->number));
  return std::abs(*value.difference) <= allowed ? Verdict::Within : Verdict::Beyond;
}

ComparedValue compare(const std::string& path,
                      const std::optional<ReportValue>& a,
                      const std::optional<ReportValue>& b,
                      const ToleranceRules& rules) {
  ComparedValue value{.path = path,
                      .a = a,
                      .b = b,
                      .difference = {},
                      .relative_difference = {},
                      .tolerance = tolerance_of(rules, path),
                      .verdict = Verdict::Equal};
  if (a && b && a->number && b->number) {
    value.difference = *b->number - *a->number;
    if (*a->number != 0) value.relative_difference = *value.difference / std::abs(*a->number);
  }
  value.verdict = judge(value);
  return value;
}

/// The part `key` of both reports, value by value.
void compare_part(const Json& a,
                  const Json& b,
                  const char* key,
                  const ToleranceRules& rules,
                  std::vector<ComparedValue>& compared) {
  const Values of_a = flatten_report(a.at(key), key), of_b = flatten_report(b.at(key), key);
  std::map<std::string_view, const ReportValue*> found;
  for (const auto& [path, value] : of_b)
    found[path] = &value;
  for (const auto& [path, value] : of_a) {
    const auto match = found.find(path);
    compared.push_back(
        compare(path, value,
                match == found.end() ? std::optional<ReportValue>() : std::optional(*match->second),
                rules));
    if (match != found.end()) found.erase(match);
  }
  for (const auto& [path, value] : of_b)
    if (found.count(path) > 0) compared.push_back(compare(path, std::nullopt, value, rules));
}

Json value_or_null(const std::optional<ReportValue>& value) {
  return value ? Json::parse(value->text) : Json();
}

Json number_or_null(const std::optional<double>& number) {
  return number ? Json(*number) : Json();
}

}  // namespace

Values flatten_report(const Json& json, const std::string& path) {
  Values values;
  flatten(json, path, values);
  return values;
}

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::Equal:
      return "equal";
    case Verdict::Within:
      return "within";
    case Verdict::Beyond:
      return "beyond";
    case Verdict::Missing:
      return "missing";
    case Verdict::New:
      return "new";
    case Verdict::Ignored:
      break;
  }
  return "ignored";
}

std::size_t ReportComparison::count(Verdict verdict) const {
  return static_cast<std::size_t>(
      std::count_if(values.begin(), values.end(),
                    [&](const ComparedValue& value) { return value.verdict == verdict; }));
}

bool ReportComparison::is_within() const {
  return count(Verdict::Beyond) == 0 && count(Verdict::Missing) == 0;
}

ReportComparison compare_reports(const Json& a, const Json& b, const CompareOptions& options) {
  ReportComparison comparison;
  for (const char* part : {"cvmesh", "input", "parameters"}) {
    std::vector<ComparedValue> compared;
    compare_part(a, b, part, {}, compared);
    for (ComparedValue& value : compared)
      if (value.verdict != Verdict::Equal) comparison.conditions.push_back(std::move(value));
  }
  compare_part(a, b, "results", options.tolerances, comparison.values);
  if (options.with_timings) compare_part(a, b, "timings", options.tolerances, comparison.values);
  return comparison;
}

void check_report(const Json& json, const std::string& source, bool with_timings) {
  const auto refuse = [&](const std::string& why) {
    throw Error(ErrorCode::BadInput, "report", source + " " + why);
  };
  if (!json.is_object() || !json.contains("cvmesh") || !json.contains("schema_version"))
    refuse(
        "is no report of cvmesh: it has no keys cvmesh and schema_version; give a "
        "NAME.metrics.json");
  const Json& version = json["schema_version"];
  if (version != kReportSchemaVersion)
    refuse(fmt::format("has schema_version {}, and this cvmesh reads {}; mesh again with it",
                       version.dump(), kReportSchemaVersion));
  const auto text = [&](const char* key) {
    return json.contains(key) && json[key].is_string() ? json[key].get<std::string>() : "?";
  };
  if (text("status") == "failed")
    refuse(fmt::format("is the report of a run that failed and has no results ({}: {})",
                       text("stage"), text("message")));
  std::vector<const char*> parts = {"input", "parameters", "results"};
  if (with_timings) parts.push_back("timings");
  for (const char* part : parts)
    if (!json.contains(part) || !json[part].is_object())
      refuse(fmt::format("is no complete report: it has no object \"{}\"", part));
}

Json comparison_to_json(const ReportComparison& comparison) {
  const auto row = [](const ComparedValue& value) -> Json {
    return {{"path", value.path},
            {"a", value_or_null(value.a)},
            {"b", value_or_null(value.b)},
            {"difference", number_or_null(value.difference)},
            {"relative_difference", number_or_null(value.relative_difference)},
            {"abs", value.tolerance.abs},
            {"rel", value.tolerance.rel},
            {"verdict", verdict_name(value.verdict)}};
  };
  Json conditions = Json::array(), values = Json::array();
  for (const ComparedValue& value : comparison.conditions)
    conditions.push_back(
        {{"path", value.path}, {"a", value_or_null(value.a)}, {"b", value_or_null(value.b)}});
  for (const ComparedValue& value : comparison.values)
    if (value.verdict != Verdict::Equal && value.verdict != Verdict::Ignored)
      values.push_back(row(value));
  return {{"verdict", comparison.is_within() ? "within" : "beyond"},
          {"compared", comparison.values.size() - comparison.count(Verdict::Ignored)},
          {"within", comparison.count(Verdict::Within)},
          {"beyond", comparison.count(Verdict::Beyond)},
          {"missing", comparison.count(Verdict::Missing)},
          {"new", comparison.count(Verdict::New)},
          {"ignored", comparison.count(Verdict::Ignored)},
          {"conditions", conditions},
          {"values", values}};
}

}  // namespace cvmesh
