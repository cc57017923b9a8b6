// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"
#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/pipeline/warning_log.h"

#include <nlohmann/json.hpp>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <fstream>
#include <iterator>
#include <sstream>

using namespace cvmesh;

TEST_CASE("make_warning_log: keeps warnings and hands everything on as the given log wants it",
          "[pipeline][unit]") {
  std::ostringstream said;
  const auto given = std::make_shared<spdlog::logger>(
      "given", std::make_shared<spdlog::sinks::ostream_sink_mt>(said));
  given->set_pattern("%l %v");
  std::vector<std::string> warnings;

  given->set_level(spdlog::level::info);
  const auto log = make_warning_log(given, warnings);
  log->debug("a detail");
  log->info("a stage");
  log->warn("label {} is thin", 3);
  CHECK(warnings == std::vector<std::string>{"label 3 is thin"});
  CHECK(said.str() == "info a stage\nwarning label 3 is thin\n");

  said.str("");
  given->set_level(spdlog::level::off);
  make_warning_log(given, warnings)->warn("unheard");
  CHECK(warnings.back() == "unheard");
  CHECK(said.str().empty());
}

TEST_CASE("run_pipeline: warnings are in the results, and in the HTML report where it is asked for",
          "[pipeline][unit]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(8));
  RunRequest request;
  request.input = folder / "a.nii";
  request.out_dir = folder / "out";
  request.surface_only = true;
  request.force = true;
  request.parameters.labels[77].epsilon = 0.5;
  run_pipeline(request, silent_context());
  const auto warnings = read_json(folder / "out" / "a.metrics.json")["results"]["warnings"];
  REQUIRE(warnings.size() == 1);
  CHECK(warnings[0].get<std::string>().find("77") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(folder / "out" / "a.report.html"));

  request.html_report = true;
  const RunResult result = run_pipeline(request, silent_context());
  CHECK(result.files.back().filename() == "a.metrics.json");
  std::ifstream file(folder / "out" / "a.report.html");
  const std::string page{std::istreambuf_iterator<char>(file), {}};
  CHECK(page.find(warnings[0].get<std::string>()) != std::string::npos);

  request.html_report = false;
  run_pipeline(request, silent_context());
  CHECK_FALSE(std::filesystem::exists(folder / "out" / "a.report.html"));
}
