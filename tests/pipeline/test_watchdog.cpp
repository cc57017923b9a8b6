// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/watchdog.h"

#include "support/catch.h"
#include <chrono>
#include <csignal>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace cvmesh;

namespace {

std::string stage_name() {
  return "smoothing";
}

/// Waits for the flag, at most so long.
bool is_set_within(const std::atomic<bool>& flag, double seconds) {
  const Timer timer;
  while (!flag && timer.seconds() < seconds)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return flag;
}

}  // namespace

TEST_CASE("Watchdog: without limits and cancel it leaves the run alone", "[pipeline][unit]") {
  const std::atomic<bool> cancel = false;
  bool was_called = false;
  {
    const Watchdog dog({}, &cancel, stage_name, [&](const Error&) { was_called = true; });
    CHECK_FALSE(is_set_within(*dog.stop_flag(), 0.15));
    CHECK_FALSE(dog.limit_reached());
  }
  CHECK_FALSE(was_called);
}

TEST_CASE("Watchdog: a cancel is passed on at once and is no limit", "[pipeline][unit]") {
  std::atomic<bool> cancel = false;
  const Watchdog dog({}, &cancel, stage_name, {});
  CHECK_FALSE(*dog.stop_flag());
  cancel = true;
  CHECK(is_set_within(*dog.stop_flag(), 5));
  CHECK_FALSE(dog.limit_reached());
  // One that came before the run began holds from the first moment.
  CHECK(*Watchdog({}, &cancel, stage_name, {}).stop_flag());
}

TEST_CASE("Watchdog: each limit stops the run by an error that names it", "[pipeline][unit]") {
  const auto error_of = [](const RunLimits& limits) {
    const Watchdog dog(limits, nullptr, stage_name, {});
    REQUIRE(is_set_within(*dog.stop_flag(), 5));
    const std::optional<Error> error = dog.limit_reached();
    REQUIRE(error);
    CHECK(error->code() == ErrorCode::Limit);
    CHECK(error->stage() == "smoothing");
    return error->message();
  };
  CHECK_THAT(error_of({.time_s = 0.05}), Catch::Contains("time limit of 0.05 s was reached") &&
                                             Catch::Contains("--time-limit"));
  CHECK_THAT(error_of({.memory_mb = 1}), Catch::Contains("above the memory limit of 1 MiB") &&
                                             Catch::Contains("--memory-limit"));
}

TEST_CASE("Watchdog: what does not stop is told once, after a while", "[pipeline][unit]") {
  std::atomic<int> calls = 0;
  std::atomic<bool> was_called = false;
  std::string message;
  const Timer timer;
  {
    const Watchdog dog({.memory_mb = 1}, nullptr, stage_name, [&](const Error& error) {
      message = error.message();
      ++calls;
      was_called = true;
    });
    REQUIRE(is_set_within(was_called, 10));
    CHECK(timer.seconds() > 0.25);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  CHECK(calls == 1);
  CHECK_THAT(message, Catch::Contains("memory limit"));
}

TEST_CASE("family_memory_mb: children count, too", "[pipeline][unit]") {
  constexpr std::size_t kMiB = 64;
  const double before = family_memory_mb();
  CHECK(before > 1);
  int ready[2];
  REQUIRE(pipe(ready) == 0);
  const pid_t child = fork();
  if (child == 0) {
    const std::vector<char> block(kMiB << 20, 1);
    const bool is_told = write(ready[1], block.data(), 1) == 1;
    pause();
    _exit(is_told ? 0 : 1);
  }
  REQUIRE(child > 0);
  char byte = 0;
  REQUIRE(read(ready[0], &byte, 1) == 1);
  CHECK(family_memory_mb() > before + kMiB);
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  close(ready[0]);
  close(ready[1]);
}
