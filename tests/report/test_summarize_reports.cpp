// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/report_json.h"
#include "cvmesh/report/summarize_reports.h"

#include <nlohmann/json.hpp>

#include "support/catch.h"
#include <algorithm>
#include <string>

using namespace cvmesh;
using Json = nlohmann::ordered_json;

namespace {

std::string cell(const RunSummary& row, std::string_view column) {
  const auto& columns = summary_columns();
  REQUIRE(row.cells.size() == columns.size());
  const auto found = std::find(columns.begin(), columns.end(), column);
  REQUIRE(found != columns.end());
  return row.cells[static_cast<std::size_t>(found - columns.begin())];
}

Json small_report() {
  return Json::parse(R"({
    "cvmesh": "1.2.3", "schema_version": )" +
                     std::to_string(kReportSchemaVersion) + R"(, "status": "success",
    "input": {"file": "a, b.nii"}, "parameters": {"epsilon": 2.5, "seed": 7},
    "results": {
      "labels": [{"label": 1, "voxels_kept": 9, "volume": {"relative_error": -0.03}},
                 {"label": 2, "voxels_kept": 4, "volume": {"relative_error": 0.01}},
                 {"label": 3, "voxels_kept": 0}],
      "mesh": {"tets": 123, "surface_vertices": 45},
      "quality": {"tets": {"min_dihedral_deg": {"min": 12.5}}}},
    "timings": {"total_seconds": 1.5, "peak_mb": 80}})");
}

}  // namespace

TEST_CASE("summarize_report: a row tells counts, extremes, time and version", "[report][unit]") {
  const RunSummary row = summarize_report(small_report(), "out/a");
  CHECK(row.status == RunStatus::Success);
  CHECK(cell(row, "run") == "out/a");
  CHECK(cell(row, "file") == "\"a, b.nii\"");
  CHECK(cell(row, "labels") == "2");
  CHECK(cell(row, "epsilon") == "2.5");
  CHECK(cell(row, "tets") == "123");
  CHECK(cell(row, "min_dihedral_deg") == "12.5");
  CHECK(cell(row, "max_volume_error_percent") == "3.0");
  CHECK(cell(row, "seconds") == "1.5");
  CHECK(cell(row, "version") == "1.2.3");
  CHECK(cell(row, "message").empty());
  CHECK(cell(row, "points").empty());  // the report does not tell
}

TEST_CASE("summarize_report: failed runs tell why, missed gates are named, others are unreadable",
          "[report][unit]") {
  Json failed = small_report();
  failed["status"] = "failed";
  failed["stage"] = "labels";
  failed["message"] = "label \"x\" is lost";
  const RunSummary failure = summarize_report(failed, "f");
  CHECK(failure.status == RunStatus::Failed);
  CHECK(cell(failure, "message") == "\"labels: label \"\"x\"\" is lost\"");

  Json gated = small_report();
  gated["results"]["gates"] = Json::parse(R"([{"gate": "a", "passed": true},
      {"gate": "b", "passed": false}, {"gate": "c", "passed": false}])");
  const RunSummary missed = summarize_report(gated, "g");
  CHECK(missed.status == RunStatus::MissedGates);
  CHECK(cell(missed, "missed_gates") == "b c");

  for (const char* text : {"[]", "{}", "3", R"({"cvmesh": 1, "schema_version": 99})",
                           R"({"cvmesh": 1, "schema_version": "1", "status": 3})"}) {
    INFO(text);
    const RunSummary row = summarize_report(Json::parse(text), "u");
    CHECK(row.status == RunStatus::Unreadable);
    CHECK_FALSE(cell(row, "message").empty());
  }
  // Keys of the wrong type leave their cells empty.
  Json odd = small_report();
  odd["results"]["labels"] = 5;
  odd["results"]["mesh"] = "x";
  odd["results"]["gates"] = {{"gate", 1}};
  CHECK(summarize_report(odd, "o").status == RunStatus::Success);
}

TEST_CASE("csv_text: quotes what must be quoted and disarms formulas", "[report][unit]") {
  CHECK(csv_text("plain name") == "plain name");
  CHECK(csv_text("a,b") == "\"a,b\"");
  CHECK(csv_text("say \"x\"") == "\"say \"\"x\"\"\"");
  CHECK(csv_text("two\nlines") == "\"two\nlines\"");
  CHECK(csv_text("=1+1") == "'=1+1");
  CHECK(csv_text("-a,b") == "\"'-a,b\"");
  for (const char* name : {"+x", "@x", "\tx"})
    CHECK(csv_text(name) == "'" + std::string(name));
  CHECK(csv_text("").empty());
  CHECK(csv_record({"", "a", ""}) == ",a,\r\n");
}
