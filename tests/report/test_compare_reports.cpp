// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/report/compare_reports.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include "support/catch.h"
#include <string>
#include <vector>

using namespace cvmesh;
using Json = nlohmann::ordered_json;

namespace {

Json report_of(const Json& results) {
  return {{"cvmesh", "1.0.0"},
          {"schema_version", kReportSchemaVersion},
          {"status", "success"},
          {"input", {{"file", "a.nii"}}},
          {"parameters", {{"epsilon", 1}}},
          {"results", results}};
}

ReportComparison compare(const Json& a, const Json& b, const ToleranceRules& rules = {}) {
  return compare_reports(report_of(a), report_of(b), {.tolerances = rules});
}

const ComparedValue& value_at(const ReportComparison& comparison, const std::string& path) {
  for (const ComparedValue& value : comparison.values)
    if (value.path == path) return value;
  FAIL("no value " << path);
  return comparison.values.front();
}

std::string fault_of(const Json& json) {
  try {
    check_report(json, "'x'", false);
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadInput);
    return error.message();
  }
  return {};
}

std::string refusal(const char* text) {
  try {
    parse_tolerances(Json::parse(text), "t.json");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadParameter);
    return error.message();
  }
  return {};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("matches_path: stars stay in one key, double stars span any number", "[report][unit]") {
  CHECK(matches_path("a.b", "a.b"));
  CHECK_FALSE(matches_path("a.b", "a.b.c"));
  CHECK_FALSE(matches_path("a.b.c", "a.b"));
  CHECK(matches_path("a.*.c", "a.b.c"));
  CHECK_FALSE(matches_path("a.*", "a.b.c"));
  CHECK(matches_path("a.*_deg.m*", "a.min_dihedral_deg.max"));
  CHECK(matches_path("*a*a", "banana"));
  CHECK_FALSE(matches_path("*a*b", "banana"));
  CHECK(matches_path("**", "a.b.c"));
  CHECK(matches_path("**.c", "a.b.c"));
  CHECK(matches_path("**.c", "c"));
  CHECK(matches_path("a.**", "a"));
  CHECK(matches_path("a.**.c", "a.c"));
  CHECK(matches_path("a.**.c", "a.c.b.c"));
  CHECK_FALSE(matches_path("a.**.c", "a.c.b"));
  CHECK_FALSE(matches_path("", "a"));
}

TEST_CASE("flatten_report: entries of lists are named by label, labels that meet, stage or place",
          "[report][unit]") {
  const Json json = Json::parse(R"({
    "labels": [{"label": 7, "tets": 1}, {"label": 2, "tets": 2}],
    "interfaces": [{"inside_label": 7, "outside_label": 0, "wall": 0, "particles": 3},
                   {"inside_label": 7, "outside_label": 0, "wall": 5, "particles": 4}],
    "stages": [{"stage": "read", "seconds": 1}],
    "poor": [{"label": 7, "position_grid_mm": [1, 2, 3]}],
    "twice": [{"label": 1, "n": 5}, {"label": 1, "n": 6}],
    "energy": [0.5, 0.25]})");
  std::vector<std::string> paths;
  for (const auto& [path, value] : flatten_report(json, "r"))
    paths.push_back(path + "=" + value.text);
  const auto has = [&](const std::string& path) {
    return std::find(paths.begin(), paths.end(), path) != paths.end();
  };
  CHECK(has("r.labels.7.tets=1"));
  CHECK(has("r.labels.2.tets=2"));
  CHECK(has("r.labels.count=2"));
  CHECK(has("r.interfaces.7-0-0.particles=3"));
  CHECK(has("r.interfaces.7-0-5.particles=4"));
  CHECK(has("r.stages.read.seconds=1"));
  CHECK(has("r.poor.0.position_grid_mm.2=3"));
  CHECK(has("r.twice.1.n=6"));
  CHECK(has("r.energy.0=0.5"));
  CHECK(has("r.energy.count=2"));
}

TEST_CASE("compare_reports: a change counts by the larger of the two bounds, of the last rule",
          "[report][unit]") {
  const ToleranceRules rules = {{"**", {.abs = 100, .rel = 0}},
                                {"results.n", {.abs = 2, .rel = 0.1}}};
  const auto verdict = [&](double a, double b) {
    return value_at(compare({{"n", a}}, {{"n", b}}, rules), "results.n").verdict;
  };
  CHECK(verdict(10, 10) == Verdict::Equal);
  CHECK(verdict(10, 12) == Verdict::Within);  // abs
  CHECK(verdict(10, 12.01) == Verdict::Beyond);
  CHECK(verdict(100, 110) == Verdict::Within);  // rel, of A
  CHECK(verdict(100, 89.9) == Verdict::Beyond);
  CHECK(verdict(-100, -110) == Verdict::Within);
  CHECK(verdict(0, 2) == Verdict::Within);

  const ComparedValue value = value_at(compare({{"n", -8}}, {{"n", -6}}, rules), "results.n");
  CHECK(value.difference == 2.0);
  CHECK(value.relative_difference == 0.25);
  CHECK_FALSE(value_at(compare({{"n", 0}}, {{"n", 1}}), "results.n").relative_difference);
}

TEST_CASE("compare_reports: texts, booleans and types must be equal, whatever the tolerance",
          "[report][unit]") {
  const ToleranceRules rules = {{"**", {.abs = 1e9, .rel = 1}}};
  for (const auto& [a, b] : std::vector<std::pair<Json, Json>>{
           {true, false}, {"x", "y"}, {1, "1"}, {1, nullptr}, {1, true}}) {
    INFO(a << " and " << b);
    CHECK_FALSE(compare({{"v", a}}, {{"v", b}}, rules).is_within());
  }
  CHECK(compare({{"v", 2}}, {{"v", 2.0}}).is_within());
  CHECK(compare({{"v", nullptr}}, {{"v", nullptr}}).is_within());
}

TEST_CASE("compare_reports: what is missing is a fault, what is new is told, a new label is both",
          "[report][unit]") {
  const ReportComparison missing = compare({{"a", 1}, {"b", 2}}, {{"a", 1}});
  CHECK_FALSE(missing.is_within());
  CHECK(value_at(missing, "results.b").verdict == Verdict::Missing);
  const ReportComparison added = compare({{"a", 1}}, {{"a", 1}, {"b", 2}});
  CHECK(added.is_within());
  CHECK(added.count(Verdict::New) == 1);
  CHECK(
      compare({{"a", 1}, {"b", 2}}, {{"a", 1}}, {{"results.b", {.is_ignored = true}}}).is_within());

  // Labels are found by value, not by their place.
  const Json one = Json::parse(R"({"labels": [{"label": 2, "tets": 5}]})");
  const Json two = Json::parse(R"({"labels": [{"label": 1, "tets": 9}, {"label": 2, "tets": 5}]})");
  const ReportComparison more = compare(one, two);
  CHECK(value_at(more, "results.labels.2.tets").verdict == Verdict::Equal);
  CHECK(value_at(more, "results.labels.1.tets").verdict == Verdict::New);
  CHECK(value_at(more, "results.labels.count").verdict == Verdict::Beyond);
}

TEST_CASE("compare_reports: other parameters and versions are told and are no fault",
          "[report][unit]") {
  const Json a = report_of({{"n", 1}});
  Json b = a;
  b["parameters"]["epsilon"] = 2;
  b["cvmesh"] = "1.1.0";
  const ReportComparison comparison = compare_reports(a, b, {});
  CHECK(comparison.is_within());
  REQUIRE(comparison.conditions.size() == 2);
  CHECK(comparison.conditions[0].path == "cvmesh");
  CHECK(comparison.conditions[1].path == "parameters.epsilon");
}

TEST_CASE("compare_reports: timings count on request only", "[report][unit]") {
  Json a = report_of({{"n", 1}});
  a["timings"] = {{"total_seconds", 10}};
  Json b = a;
  b["timings"]["total_seconds"] = 100;
  CHECK(compare_reports(a, b, {}).is_within());
  CHECK_FALSE(compare_reports(a, b, {.with_timings = true}).is_within());
  CHECK(compare_reports(a, a, {.with_timings = true}).is_within());
}

TEST_CASE("check_report: says what a foreign, failed, old or cut file is", "[report][unit]") {
  const Json good = report_of({{"n", 1}});
  CHECK(fault_of(good).empty());
  CHECK(contains(fault_of(Json::array()), "'x' is no report of cvmesh"));
  CHECK(contains(fault_of({{"epsilon", 1}}), "is no report of cvmesh"));
  Json json = good;
  json["schema_version"] = kReportSchemaVersion + 1;
  CHECK(contains(fault_of(json), "has schema_version " + std::to_string(kReportSchemaVersion + 1)));
  json = good;
  json["status"] = "failed";
  json["stage"] = "decimation";
  json["message"] = "label 9 is lost";
  CHECK(contains(fault_of(json), "failed and has no results (decimation: label 9 is lost)"));
  json["stage"] = 7;  // not ours, and no reason to break down
  CHECK(contains(fault_of(json), "(?: label 9 is lost)"));
  json = good;
  json.erase("results");
  CHECK(contains(fault_of(json), "no object \"results\""));
  CHECK_THROWS_AS(check_report(good, "'x'", true), Error);  // it has no timings
}

TEST_CASE("parse_tolerances: refuses what it does not know and what cannot match",
          "[report][unit]") {
  CHECK(contains(refusal("[]"), "holds no JSON object"));
  CHECK(contains(refusal(R"({"a.b": 1})"), "\"a.b\" (1) must be an object"));
  CHECK(contains(refusal(R"({"a.b": {"absolute": 1}})"), "unknown key \"a.b\".absolute"));
  CHECK(contains(refusal(R"({"a.b": {"abs": -1}})"), "\"a.b\".abs (-1) must be a number"));
  CHECK(contains(refusal(R"({"a.b": {"rel": "5 %"}})"), "\"a.b\".rel (\"5 %\") must be a number"));
  CHECK(contains(refusal(R"({"a.b": {"ignore": 1}})"), "must be true or false"));
  CHECK(contains(refusal(R"({"a.b": {"ignore": true, "abs": 1}})"), "give one of the two"));
  CHECK(contains(refusal(R"({"a..b": {"abs": 1}})"), "has an empty key"));
  CHECK(refusal(R"({"comment": "x", "a.b": {"abs": 1, "comment": "why"}})").empty());
}

TEST_CASE("default_tolerances: make a file that parses to the same rules", "[report][unit]") {
  const Json file = tolerances_to_json(default_tolerances());
  CHECK(file.size() == default_tolerances().size());  // no pattern is there twice
  CHECK(tolerances_to_json(parse_tolerances(file, "t.json")) == file);
}

TEST_CASE("default_tolerances: topology and accounting are exact, extremes wider than means",
          "[report][unit]") {
  const auto tolerance = [](const char* path) { return tolerance_of(default_tolerances(), path); };
  for (const char* path : {"results.labels.2.topology.mesh.boundary_euler",
                           "results.labels.2.voxels_kept", "results.checks.surface_is_valid",
                           "results.labels.count", "results.stages.labels.islands_removed"}) {
    INFO(path);
    const Tolerance exact = tolerance(path);
    CHECK_FALSE(exact.is_ignored);
    CHECK(exact.abs == 0);
    CHECK(exact.rel == 0);
  }
  const Tolerance mean = tolerance("results.quality.tets.radius_ratio.mean");
  CHECK(mean.abs > 0);
  CHECK(tolerance("results.quality.tets.radius_ratio.min").abs > mean.abs);
  const Tolerance distance =
      tolerance("results.labels.2.distances.to_dense.voxels.mesh_to_reference.mean");
  CHECK(distance.rel > 0);
  CHECK(tolerance("results.distances.to_dense.voxels.mesh_to_reference.max").rel > distance.rel);
  CHECK(tolerance("results.stages.insertion.snapped").is_ignored);
}
