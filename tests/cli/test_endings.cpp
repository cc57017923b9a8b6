// SPDX-License-Identifier: AGPL-3.0-or-later

// How runs end: limits, signals, kills, full disks. Whatever happens, a file under its final name
// is complete, and no process is left.
#include "cvmesh/core/random.h"
#include "cvmesh/core/timer.h"
#include "cvmesh/io/json_io.h"

#include <nlohmann/json.hpp>

#include "io/image_files.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include "support/run_cli.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <sys/mount.h>
#include <thread>
#include <vector>

using namespace cvmesh;
namespace fs = std::filesystem;

namespace {

using run_cli::Outcome;
using Words = std::vector<std::string>;

constexpr char kMark[] = "CVMESH_TEST_MARK";

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  if (fs::exists(folder))
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

/// Processes with this mark in their environment that still run.
int marked_processes(const std::string& mark) {
  int count = 0;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    // A dead process that nobody has waited for has an empty environment.
    // What is no process, or not ours, cannot be read.
    std::ifstream file(entry.path() / "environ", std::ios::binary);
    const std::string environment{std::istreambuf_iterator<char>(file), {}};
    if (environment.find(std::string(kMark) + "=" + mark) != std::string::npos) ++count;
  }
  return count;
}

/// Waits until none of them is left, at most two seconds.
bool are_gone(const std::string& mark) {
  const Timer timer;
  while (marked_processes(mark) > 0) {
    if (timer.seconds() > 2) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return true;
}

/// Only a complete set of results, a failure file or nothing may have a final name.
void check_final_names(const fs::path& folder, bool may_leave_temporaries) {
  std::vector<std::string> finals;
  for (const std::string& name : names_in(folder)) {
    INFO(name);
    const bool is_temporary = name.front() == '.';
    CHECK((may_leave_temporaries || !is_temporary));
    if (!is_temporary) finals.push_back(name);
  }
  const bool is_nothing = finals.empty();
  const bool is_failure = finals == Words{"a.failed.json"};
  const bool is_complete = finals == Words{"a.mesh", "a.metrics.json", "a.surface.vtp", "a.vtu"};
  CAPTURE(finals);
  CHECK((is_nothing || is_failure || is_complete || may_leave_temporaries));
  // After SIGKILL between two renames some results may stand without the metrics that complete
  // them; each of them is whole.
  for (const std::string& name : finals)
    if (name == "a.metrics.json" || name == "a.failed.json")
      CHECK_NOTHROW(read_json(folder / name));
}

}  // namespace

TEST_CASE("cvmesh mesh: results of an earlier run are replaced by --force only", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const Words words = {"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(),
                       "--quiet"};
  REQUIRE(run_cli::cvmesh(words).exit_code == 0);
  const std::string mesh = image_files::read_file(folder / "out/a.mesh");
  Words coarser = words;
  coarser.insert(coarser.end(), {"--set", "epsilon=3"});
  const Outcome refused = run_cli::cvmesh(coarser);
  CHECK(refused.exit_code == 6);
  CHECK_THAT(refused.err, Catch::Contains("out/a.metrics.json' is there already; give --force"));
  CHECK(image_files::read_file(folder / "out/a.mesh") == mesh);
  CHECK_FALSE(fs::exists(folder / "out/a.failed.json"));
  coarser.emplace_back("--force");
  CHECK(run_cli::cvmesh(coarser).exit_code == 0);
  CHECK(image_files::read_file(folder / "out/a.mesh").size() < mesh.size());
}

TEST_CASE("cvmesh mesh: a full or limited disk gives code 6 and leaves no result", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(10));
  const Outcome outcome = run_cli::cvmesh(
      {"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(), "--quiet"},
      {.largest_file_bytes = 64 << 10});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 6);
  CHECK_THAT(outcome.err, Catch::Contains("out/a.vtu' cannot be written: File too large"));
  CHECK(names_in(folder / "out") == Words{"a.failed.json"});
  const auto failure = read_json(folder / "out/a.failed.json");
  CHECK(failure["code"] == "Output");
  CHECK(failure["exit_code"] == 6);
  CHECK(failure["results"]["labels"][0]["voxels_in"] > 0);

  const Outcome schema = run_cli::cvmesh({"schema"}, {.standard_output = "/dev/full"});
  CHECK(schema.exit_code == 6);
  CHECK_THAT(schema.err, Catch::Contains("standard output"));
}

TEST_CASE("cvmesh mesh: a small and a read-only file system give code 6", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(10));
  const fs::path disk = folder / "disk";
  fs::create_directory(disk);
  if (mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=100k") != 0) {
    WARN("skipped: no right to mount a small file system");
    return;
  }
  const Words words = {"mesh", (folder / "a.nii").string(), "--out", disk.string(), "--quiet"};
  const Outcome full = run_cli::cvmesh(words);
  const Words left = names_in(disk);
  mount("tmpfs", disk.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, nullptr);
  const Outcome read_only = run_cli::cvmesh(words);
  umount(disk.c_str());
  INFO(full.err);
  CHECK(full.exit_code == 6);
  CHECK_THAT(full.err, Catch::Contains("No space left on device"));
  CHECK(left == Words{"a.failed.json"});
  CHECK(read_only.exit_code == 6);
  CHECK_THAT(read_only.err, Catch::Contains("Read-only file system"));
}

TEST_CASE("cvmesh mesh: a helper that fails gives code 4 and says so in the failure file",
          "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  const Outcome outcome = run_cli::cvmesh(
      {"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(), "--quiet"},
      {.environment = {{"CVMESH_TETGEN_HELPER", "/bin/false"}}});
  CHECK(outcome.exit_code == 4);
  CHECK(names_in(folder / "out") == Words{"a.failed.json"});
  const auto failure = read_json(folder / "out/a.failed.json");
  CHECK(failure["stage"] == "tetrahedra");
  CHECK(failure["code"] == "StageFailed");
  CHECK(failure["exit_code"] == 4);
  CHECK(failure["results"]["labels"][0]["voxels_kept"] > 0);
}

TEST_CASE("cvmesh mesh: a fault that is nobody's input gives code 1 and the failure file",
          "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(6));
  // OpenSSL's configuration asks for a provider that is not there: no digest can be computed.
  image_files::write_file(folder / "openssl.cnf",
                          "openssl_conf = all\n[all]\nalg_section = algorithms\n"
                          "[algorithms]\ndefault_properties = fips=yes\n");
  const Outcome outcome = run_cli::cvmesh(
      {"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(), "--quiet"},
      {.environment = {{"OPENSSL_CONF", (folder / "openssl.cnf").string()}}});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK_THAT(outcome.err, Catch::Contains("SHA-256") && Catch::Contains("OPENSSL_CONF"));
  CHECK(names_in(folder / "out") == Words{"a.failed.json"});
  const auto failure = read_json(folder / "out/a.failed.json");
  CHECK(failure["stage"] == "read");
  CHECK(failure["code"] == "Internal");
  CHECK(failure["exit_code"] == 1);
}

TEST_CASE("cvmesh mesh: limits end the run with code 7, before the work or during it", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(16));
  write_volume_file(folder / "small.nii", phantoms::ball(6));
  // So fine that even a third of the forecast, 4 s, is longer than a sanitized build forecasts.
  const std::string epsilon = "epsilon=0.025";
  std::map<std::string, std::string> environment;
  const auto limited = [&](const std::string& option, const std::string& value) {
    const Outcome outcome =
        run_cli::cvmesh({"mesh", (folder / "a.nii").string(), "--out", (folder / "out").string(),
                         "--quiet", "--set", epsilon, option, value},
                        {.environment = environment});
    INFO(outcome.err);
    CHECK(outcome.exit_code == 7);
    CHECK_THAT(outcome.err, Catch::Contains(option));
    CHECK(names_in(folder / "out") == Words{"a.failed.json"});
    const auto failure = read_json(folder / "out/a.failed.json");
    CHECK(failure["code"] == "Limit");
    CHECK(failure["exit_code"] == 7);
    return failure["stage"].get<std::string>();
  };
  // Before the work: the forecast tells that this cannot be.
  CHECK(limited("--time-limit", "0.01") == "labels");
  // During it: a third of the forecast is let through, and a helper that sleeps takes longer.
  const Outcome check =
      run_cli::cvmesh({"check", (folder / "a.nii").string(), "--json", "--set", epsilon});
  REQUIRE(check.exit_code == 0);
  const auto forecast = nlohmann::json::parse(check.out)["forecast"];
  const double seconds = forecast["seconds"].get<double>() / 3.5;
  image_files::write_file(folder / "sleeper", "#!/bin/sh\nexec sleep 1000\n");
  fs::permissions(folder / "sleeper", fs::perms::owner_all);
  environment["CVMESH_TETGEN_HELPER"] = (folder / "sleeper").string();
  CHECK(limited("--time-limit", std::to_string(seconds)) != "labels");
  environment.clear();
  limited("--memory-limit", "1");
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--time-limit", "0"}).exit_code == 2);
  CHECK(run_cli::cvmesh({"mesh", "a.nii", "--memory-limit", "-5"}).exit_code == 2);
  // Limits that are wide enough change nothing.
  CHECK(
      run_cli::cvmesh({"mesh", (folder / "small.nii").string(), "--out", (folder / "out").string(),
                       "--time-limit", "1000", "--memory-limit", "20000"})
          .exit_code == 0);
}

TEST_CASE("cvmesh mesh: a signal is in the failure file, with its exit code", "[cli]") {
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::ball(45));
  for (const int signal : {SIGINT, SIGTERM}) {
    run_cli::Process process({"mesh", (folder / "a.nii").string(), "--out",
                              (folder / "out").string(), "--set", "epsilon=0.3"});
    for (int wait = 0; wait < 200 && !fs::exists(folder / "out"); ++wait)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    process.send_signal(signal);
    CHECK(process.wait().exit_code == 128 + signal);
    CHECK(names_in(folder / "out") == Words{"a.failed.json"});
    const auto failure = read_json(folder / "out/a.failed.json");
    CHECK(failure["code"] == "Signal");
    CHECK(failure["exit_code"] == 128 + signal);
    CHECK_FALSE(failure["stage"].get<std::string>().empty());
  }
}

TEST_CASE("cvmesh mesh: stopped or killed at any moment it leaves nothing behind", "[cli][timed]") {
  constexpr int kMoments = 12;
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "a.nii", phantoms::nested_balls(6, 10));
  const Words words = {"mesh",    (folder / "a.nii").string(),
                       "--out",   (folder / "out").string(),
                       "--force", "--quiet",
                       "--set",   "epsilon=0.5"};
  const Timer whole;
  REQUIRE(run_cli::cvmesh(words).exit_code == 0);
  const double seconds = whole.seconds();
  const CounterRandom random(1, "moments");
  for (int moment = 0; moment < kMoments; ++moment) {
    const int signal = std::array{SIGTERM, SIGINT, SIGKILL}[moment % 3];
    const double delay = random.uniform(static_cast<std::uint64_t>(moment)) * seconds;
    CAPTURE(moment, signal, delay, seconds);
    fs::remove_all(folder / "out");
    const std::string mark = folder.path().filename().string() + std::to_string(moment);
    run_cli::Process process(words, {.environment = {{kMark, mark}}});
    std::this_thread::sleep_for(std::chrono::duration<double>(delay));
    process.send_signal(signal);
    const Timer since_signal;
    const Outcome outcome = process.wait();
    CHECK(since_signal.seconds() < 2);
    // Before the handlers stand a signal ends the process as ever; a run may be over before it.
    CHECK((outcome.exit_code == 128 + signal || outcome.exit_code == 0));
    CHECK(are_gone(mark));
    check_final_names(folder / "out", signal == SIGKILL);
  }
}
