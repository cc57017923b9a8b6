// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include "support/catch.h"

using namespace cvmesh;
using Json = nlohmann::ordered_json;

namespace {

/// A report of two labels, one of them dropped, as a run leaves it before the metrics.
Report small_report() {
  Report report;
  report.version = "1.2.3";
  report.input = {.file = "a.nii.gz",
                  .dims = {4, 5, 6},
                  .spacing_mm = {1, 2, 3},
                  .space = Space::Ras,
                  .output_space = Space::Lps,
                  .labels = {0, 3, 9}};
  report.label_of = {0, 9};
  report.name_of = {"exterior", "bone"};
  report.stages.labels = CleanLabelsStats{
      .accounts = {{.label = 3, .name = "label_3", .voxels_in = 2, .is_dropped = true},
                   {.label = 9, .name = "bone", .voxels_in = 7, .voxels_kept = 7}},
      .islands_removed = 1,
      .island_voxels = 2,
      .holes_filled = 1,
      .hole_voxels = 5,
      .islands = {{.label = 9, .voxels = 2, .given_to = 3, .first_voxel = {1, 2, 3}}},
      .holes = {{.label = 0, .voxels = 5, .given_to = 9, .first_voxel = {4, 4, 4}}}};
  report.stages.tightening =
      TightenStats{.iterations = 3,
                   .nodes_guarded = 2,
                   .guarded = {{.material = 1, .nodes = 2, .position = {1, 2, 3}}}};
  report.stages.sizing_field = SizingStats{.share_below_three_facets = {0, 0.25}};
  report.volumes = {{}, {.voxels_mm3 = 42, .mesh_mm3 = 40, .relative_error = -2.0 / 42}};
  report.timings = {{"read", 0.5, 100}};
  report.total_seconds = 0.75;
  return report;
}

}  // namespace

TEST_CASE("report_json: has its sections, with timings apart from results", "[report][unit]") {
  const Json json = report_json(small_report());
  std::vector<std::string> keys;
  for (const auto& [key, value] : json.items())
    keys.push_back(key);
  CHECK(keys == std::vector<std::string>{"cvmesh", "schema_version", "status", "libraries", "input",
                                         "parameters", "results", "timings"});
  CHECK(json["cvmesh"] == "1.2.3");
  CHECK(json["status"] == "success");
  CHECK(json["input"]["dims"] == Json({4, 5, 6}));
  CHECK(json["input"]["space"] == "RAS");
  CHECK(json["input"]["output_space"] == "LPS");
  CHECK(json["parameters"]["epsilon"] == 1.0);
  CHECK(json["timings"]["stages"][0]["seconds"] == 0.5);
  CHECK(json["timings"]["total_seconds"] == 0.75);

  Report slower = small_report();
  slower.timings[0].seconds = 99;
  slower.total_seconds = 100;
  slower.peak_mb = 12345;
  slower.threads = 3;
  Json other = report_json(slower);
  CHECK(other != json);
  other["timings"] = json["timings"];
  CHECK(other == json);
}

TEST_CASE("report_json: one entry per label, dropped ones with their accounting only",
          "[report][unit]") {
  const Json labels = report_json(small_report())["results"]["labels"];
  REQUIRE(labels.size() == 2);
  CHECK(labels[0]["label"] == 3);
  CHECK(labels[0]["is_dropped"] == true);
  CHECK_FALSE(labels[0].contains("volume"));
  CHECK(labels[1]["name"] == "bone");
  CHECK(labels[1]["volume"]["voxels_mm3"] == 42.0);
  CHECK(labels[1]["share_below_three_facets"] == 0.25);
  CHECK_FALSE(labels[0].contains("share_below_three_facets"));
}

TEST_CASE("report_json: lists every island and hole with its heir and place", "[report][unit]") {
  const Json labels = report_json(small_report())["results"]["stages"]["labels"];
  CHECK(labels["islands_removed"] == 1);
  CHECK(labels["hole_voxels"] == 5);
  const Json island{{"label", 9}, {"voxels", 2}, {"given_to", 3}, {"first_voxel", {1, 2, 3}}};
  CHECK(labels["islands"] == Json::array({island}));
  CHECK(labels["holes"][0]["given_to"] == 9);
  CHECK_FALSE(labels.contains("accounts"));
}

TEST_CASE("report_json: says of each label whether it was merged or cut off", "[report][unit]") {
  Report report = small_report();
  report.stages.labels->accounts[0] = {
      .label = 3, .name = "label_3", .merged_into = 9, .is_outside_region = true};
  const Json labels = report_json(report)["results"]["labels"];
  CHECK(labels[0]["merged_into"] == 9);
  CHECK(labels[0]["is_outside_region"] == true);
  CHECK_FALSE(labels[0].contains("volume"));
  CHECK(labels[1]["merged_into"].is_null());
  CHECK(labels[1]["is_outside_region"] == false);
}

TEST_CASE("failure_json: names stage, code and message and keeps what was known",
          "[report][unit]") {
  const Error error(ErrorCode::StageFailed, "decimation", "label 9 is lost");
  const Json json = failure_json(small_report(), error);
  CHECK(json["status"] == "failed");
  CHECK(json["stage"] == "decimation");
  CHECK(json["code"] == "StageFailed");
  CHECK(json["exit_code"] == 4);
  CHECK(json["message"] == "label 9 is lost");
  const Json& tightening = json["results"]["stages"]["tightening"];
  CHECK(tightening["iterations"] == 3);
  CHECK(tightening["guarded_places"] == 1);
  CHECK(tightening["guarded"][0]["label"] == 9);
  CHECK(tightening["guarded"][0]["position_grid_mm"] == Json({1.0, 2.0, 3.0}));
  CHECK(json["results"]["stages"]["labels"]["islands_removed"] == 1);
  CHECK_FALSE(json["results"]["stages"].contains("decimation"));
}
