// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/timer.h"
#include "cvmesh/tet/tetgen_backend.h"
#include "cvmesh/tet/tetrahedralize.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

tetgen_protocol::Request request_of(const InterfaceMesh& surface, const std::string& switches) {
  tetgen_protocol::Request request;
  request.switches = switches;
  request.points = surface.points;
  request.facets = surface.facets;
  return request;
}

TetgenRun run(const InterfaceMesh& surface, const std::string& switches, TetgenLimits limits = {}) {
  find_helper();
  if (limits.time_s == 0) limits.time_s = 60;
  return run_tetgen(request_of(surface, switches), limits, silent_context());
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A shell script in place of the helper, for as long as this object lives. The script finds the
/// true helper in $REAL.
class FakeHelper {
 public:
  explicit FakeHelper(const std::string& script) {
    find_helper();
    const char* real = std::getenv("CVMESH_TETGEN_HELPER");
    real_ = real != nullptr ? real : "";
    setenv("REAL", real_.empty() ? find_tetgen_helper().c_str() : real_.c_str(), 1);
    char name[] = "/tmp/cvmesh_fake_helper_XXXXXX";
    close(mkstemp(name));
    path_ = name;
    std::ofstream(path_) << "#!/bin/sh\n" << script << "\n";
    chmod(path_.c_str(), 0700);
    setenv("CVMESH_TETGEN_HELPER", path_.c_str(), 1);
  }

  FakeHelper(const FakeHelper&) = delete;
  FakeHelper& operator=(const FakeHelper&) = delete;

  ~FakeHelper() {
    std::filesystem::remove(path_);
    if (real_.empty())
      unsetenv("CVMESH_TETGEN_HELPER");
    else
      setenv("CVMESH_TETGEN_HELPER", real_.c_str(), 1);
  }

 private:
  std::string real_, path_;
};

bool has_no_children() {
  return waitpid(-1, nullptr, WNOHANG) == -1 && errno == ECHILD;
}

InterfaceMesh overlapping_tets() {
  InterfaceMesh second = single_tet(3, {2, 0});
  for (Vec3& p : second.points)
    p += Vec3{0.5, 0.5, 0.5};
  return join(single_tet(3, {1, 0}), second);
}

InterfaceMesh with_nan() {
  InterfaceMesh mesh = sphere({0, 0, 0}, 1, 1, {1, 0});
  mesh.points[5].y = std::numeric_limits<double>::quiet_NaN();
  return mesh;
}

/// A sphere to be filled with some hundred million tets: TetGen never gets there.
tetgen_protocol::Request endless() {
  tetgen_protocol::Request request = request_of(sphere({20, 20, 20}, 15, 4, {1, 0}), "pYAq1.4JQ");
  request.size.dims = {1, 1, 1};
  request.size.cell = {1, 1, 1};
  request.size.values = {0.05F};
  return request;
}

}  // namespace

TEST_CASE("run_tetgen: one tet comes back as one tet with its points unchanged", "[tet][unit]") {
  const InterfaceMesh surface = single_tet(3, {1, 0});
  const TetgenRun result = run(surface, "pYAJQ");
  REQUIRE(result.outcome == TetgenOutcome::Meshed);
  CHECK(result.reply.points == surface.points);
  CHECK(result.reply.tets.size() == 1);
  CHECK(result.reply.region_of.size() == 1);
}

TEST_CASE("run_tetgen: what TetGen prints does not disturb the reply", "[tet][unit]") {
  const TetgenRun result = run(sphere({0, 0, 0}, 1, 1, {1, 0}), "pYAJVV");
  CHECK(result.outcome == TetgenOutcome::Meshed);
  CHECK(result.description.empty());
}

TEST_CASE("run_tetgen: connected parts have regions of their own", "[tet][unit]") {
  InterfaceMesh far = single_tet(3, {2, 0});
  for (Vec3& p : far.points)
    p += Vec3{10, 0, 0};
  const TetgenRun result = run(join(single_tet(3, {1, 0}), far), "pYAJQ");
  REQUIRE(result.reply.tets.size() == 2);
  CHECK(result.reply.region_of[0] != result.reply.region_of[1]);
}

TEST_CASE("run_tetgen: overlapping tets end in TetGen's own error number, not in a crash",
          "[tet][unit]") {
  const TetgenRun result = run(overlapping_tets(), "pYAQ");
  CHECK(result.outcome == TetgenOutcome::Refused);
  CHECK(result.reply.code == 3);
  CHECK(contains(result.description, "intersect"));
  CHECK(contains(result.description, "smaller epsilon"));
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: points in one plane are described", "[tet][unit]") {
  InterfaceMesh flat = single_tet(3, {1, 0});
  flat.points[3] = {1, 1, 0};
  const TetgenRun result = run(flat, "pYAQ");
  CHECK(result.outcome != TetgenOutcome::Meshed);
  CHECK_FALSE(result.description.empty());
}

TEST_CASE("run_tetgen: points in one line abort TetGen and are described", "[tet][unit]") {
  InterfaceMesh line = single_tet(3, {1, 0});
  for (std::size_t i = 0; i < 4; ++i)
    line.points[i] = {double(i), 0, 0};
  const TetgenRun result = run(line, "pYAQ");
  CHECK((result.outcome == TetgenOutcome::Crashed || result.outcome == TetgenOutcome::Refused));
  CHECK_FALSE(result.description.empty());
}

TEST_CASE("run_tetgen: an open surface gives no tets and says that it is not closed",
          "[tet][unit]") {
  InterfaceMesh open = sphere({0, 0, 0}, 1, 1, {1, 0});
  open.facets.pop_back();
  open.patch_of.pop_back();
  const TetgenRun result = run(open, "pYAQ");
  CHECK(result.outcome == TetgenOutcome::NoTets);
  CHECK(contains(result.description, "not closed"));
}

TEST_CASE("run_tetgen: a run that does not return is killed at the time limit", "[tet][unit]") {
  const Timer timer;
  find_helper();
  const TetgenRun result = run_tetgen(endless(), {.time_s = 0.5}, silent_context());
  CHECK(result.outcome == TetgenOutcome::TimedOut);
  CHECK(contains(result.description, "time_limit_s (0.5)"));
  CHECK(timer.seconds() < 5);  // the limit, plus a poll interval, plus a loaded machine
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: a coordinate that is not a number ends in a description", "[tet][unit]") {
  const TetgenRun result = run(with_nan(), "pYAQ", {.time_s = 2});
  CHECK(result.outcome != TetgenOutcome::Meshed);
  CHECK_FALSE(result.description.empty());
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: the memory limit is named when it is reached", "[tet][unit]") {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  WARN("skipped: a sanitizer's shadow memory is larger than any limit of address space");
#else
  find_helper();
  const TetgenRun result = run_tetgen(endless(), {60, 64}, silent_context());
  CHECK(result.outcome == TetgenOutcome::OutOfMemory);
  CHECK(contains(result.description, "tetgen_memory_limit_mb (64)"));
#endif
}

TEST_CASE("run_tetgen: a cancel stops the helper at once", "[tet][unit]") {
  find_helper();
  std::atomic<bool> cancel{false};
  StageContext context = silent_context();
  context.cancel = &cancel;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    cancel = true;
  });
  const Timer timer;
  ErrorCode code{};
  try {
    run_tetgen(endless(), {60, 0}, context);
  } catch (const Error& error) {
    code = error.code();
  }
  later.join();
  CHECK(code == ErrorCode::Limit);
  CHECK(timer.seconds() < 5);
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: a killed helper is told from one that crashed", "[tet][unit]") {
  const InterfaceMesh surface = single_tet(3, {1, 0});
  {
    const FakeHelper fake("kill -9 $$");
    const TetgenRun result = run(surface, "pYAQ");
    CHECK(result.outcome == TetgenOutcome::OutOfMemory);
    CHECK(contains(result.description, "signal 9"));
    CHECK(contains(result.description, "memory"));
  }
  {
    const FakeHelper fake("kill -11 $$");
    const TetgenRun result = run(surface, "pYAQ");
    CHECK(result.outcome == TetgenOutcome::Crashed);
    CHECK(contains(result.description, "signal 11"));
  }
  {
    const FakeHelper fake("echo 'tetgen.cxx:1: Assertion `x' >&2; kill -6 $$");
    const TetgenRun result = run(surface, "pYAQ");
    CHECK(result.outcome == TetgenOutcome::Crashed);
    CHECK(contains(result.description, "Assertion"));
  }
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: an exit code is described", "[tet][unit]") {
  const FakeHelper fake("echo no such library >&2; exit 127");
  const TetgenRun result = run(single_tet(3, {1, 0}), "pYAQ");
  CHECK(result.outcome == TetgenOutcome::Crashed);
  CHECK(contains(result.description, "exit code 127"));
  CHECK(contains(result.description, "no such library"));
}

TEST_CASE("run_tetgen: a helper that does not read a large request raises no SIGPIPE",
          "[tet][unit]") {
  const FakeHelper fake("exec 0<&-; exit 0");
  const TetgenRun result = run(sphere({0, 0, 0}, 1, 6, {1, 0}), "pYAQ");
  CHECK(result.outcome == TetgenOutcome::BrokenReply);
}

TEST_CASE("run_tetgen: a reply that was cut short or changed is refused", "[tet][unit]") {
  const InterfaceMesh surface = sphere({0, 0, 0}, 1, 1, {1, 0});
  for (const char* script :
       {"exec head -c 0", "\"$REAL\" | head -c 20", "\"$REAL\" | head -c -1",
        "f=$(mktemp); \"$REAL\" > $f; printf '\\377' | dd of=$f bs=1 seek=100 conv=notrunc "
        "2>/dev/null; cat $f; rm $f",
        "\"$REAL\"; echo more", "echo this is no reply, but a text that is longer than a header"}) {
    CAPTURE(script);
    const FakeHelper fake(script);
    const TetgenRun result = run(surface, "pYAQ");
    CHECK(result.outcome == TetgenOutcome::BrokenReply);
    CHECK(contains(result.description, "reinstall"));
    CHECK(result.reply.tets.empty());
  }
  CHECK(has_no_children());
}

TEST_CASE("run_tetgen: a helper that closes its output and lingers meets the time limit",
          "[tet][unit]") {
  const FakeHelper fake("exec >&- 2>&-; exec sleep 30");
  const TetgenRun result = run(single_tet(3, {1, 0}), "pYAQ", {.time_s = 0.3});
  CHECK(result.outcome == TetgenOutcome::TimedOut);
}

namespace {

/// A file with the reply as the helper would write it.
std::string write_reply(const tetgen_protocol::Reply& reply) {
  const std::vector<char> payload = tetgen_protocol::encode(reply);
  tetgen_protocol::Header header;
  header.kind = tetgen_protocol::Kind::Reply;
  header.payload_bytes = payload.size();
  header.checksum = tetgen_protocol::checksum(payload);
  char name[] = "/tmp/cvmesh_reply_XXXXXX";
  close(mkstemp(name));
  std::ofstream file(name, std::ios::binary);
  file.write(reinterpret_cast<const char*>(&header), sizeof header);
  file.write(payload.data(), static_cast<std::streamsize>(payload.size()));
  return name;
}

/// How the stage ends when TetGen always gives this reply; empty when it gives a mesh.
std::string end_with(const InterfaceMesh& surface, const tetgen_protocol::Reply& reply) {
  const std::string file = write_reply(reply);
  std::string message;
  {
    const FakeHelper fake("cat > /dev/null; cat " + file);
    try {
      tetrahedralize(surface, 2, {}, {.improvement_passes = 0}, silent_context());
    } catch (const Error& error) {
      CHECK(error.code() == ErrorCode::StageFailed);
      message = error.what();
    }
  }
  std::filesystem::remove(file);
  return message;
}

}  // namespace

TEST_CASE("tetrahedralize: a reply whose indices have shifted is refused, however sound its tets",
          "[tet][unit]") {
  const InterfaceMesh surface = sphere({0, 0, 0}, 1, 2, {1, 0});
  const TetgenRun good = run(surface, "pYAq1.4JQ");
  REQUIRE(good.outcome == TetgenOutcome::Meshed);
  CHECK(end_with(surface, good.reply).empty());

  // The same tets, but the surface's points have moved up by one place.
  const auto count = static_cast<std::int32_t>(surface.points.size());
  tetgen_protocol::Reply shifted = good.reply;
  std::rotate(shifted.points.begin(), shifted.points.begin() + 1, shifted.points.begin() + count);
  for (auto& tet : shifted.tets)
    for (std::int32_t& v : tet)
      if (v < count) v = (v + count - 1) % count;
  const std::string message = end_with(surface, shifted);
  CHECK(contains(message, "sets of TetGen switches filled the surface"));
  CHECK(contains(message, "point 0 "));

  // A point that was merged with its neighbour, as TetGen does where two nearly coincide.
  tetgen_protocol::Reply merged = good.reply;
  merged.points.erase(merged.points.begin() + 5);
  for (auto& tet : merged.tets)
    for (std::int32_t& v : tet)
      if (v >= 5) --v;
  CHECK(contains(end_with(surface, merged), "point 5 "));
}

TEST_CASE("tetrahedralize: where one way to recover edges leaves a facet out, another is tried",
          "[tet][unit]") {
  // The reply for a surface with another diagonal, as if TetGen had lost an edge.
  const InterfaceMesh surface = sphere({0, 0, 0}, 1, 2, {1, 0});
  InterfaceMesh other = surface;
  const auto [a, b, c] = surface.facets[0];
  std::int32_t d = -1;
  for (auto& facet : other.facets)
    for (std::size_t k = 0; k < 3; ++k)
      if (facet[k] == b && facet[(k + 1) % 3] == a) {
        d = facet[(k + 2) % 3];
        facet = {d, c, a};
      }
  REQUIRE(d >= 0);
  other.facets[0] = {c, d, b};
  const TetgenRun wrong = run(other, "pYAq1.4JQ");
  REQUIRE(wrong.outcome == TetgenOutcome::Meshed);

  const std::string file = write_reply(wrong.reply);
  const std::string unless_2 =
      "f=$(mktemp); cat > $f; exec 3< $f; head -c 99 $f | grep -aq pY/2; is_2=$?; rm $f\n"
      "if [ $is_2 = 0 ]; then exec \"$REAL\" <&3; else cat " +
      file + "; fi";
  {
    const FakeHelper fake(unless_2);
    const auto result = tetrahedralize(surface, 2, {}, {.improvement_passes = 0}, silent_context());
    CHECK(result.stats.attempts == 2);
    CHECK(result.stats.switches.rfind("pY/2Aq1.4/10JQ", 0) == 0);
    REQUIRE(result.stats.failed_attempts.size() == 1);
    CHECK(contains(result.stats.failed_attempts[0], "is not a face of the tets"));
    CHECK(result.tets.surface.facets == surface.facets);
  }
  std::filesystem::remove(file);
  // What no way recovers is tried no more often than with another tolerance.
  CHECK(contains(end_with(surface, wrong.reply), "none of 6 sets"));
}

TEST_CASE("tetrahedralize: where memory does not suffice, no other way to recover edges is tried",
          "[tet][unit]") {
  const FakeHelper fake("kill -9 $$");
  ErrorCode code{};
  std::string message;
  try {
    tetrahedralize(sphere({0, 0, 0}, 1, 2, {1, 0}), 2, {}, {}, silent_context());
  } catch (const Error& error) {
    code = error.code();
    message = error.what();
  }
  CHECK(code == ErrorCode::Limit);
  CHECK(contains(message, "none of 5 sets"));
}

TEST_CASE("find_tetgen_helper: a missing helper is named with the way out", "[tet][unit]") {
  find_helper();
  const char* old = std::getenv("CVMESH_TETGEN_HELPER");
  const std::string kept = old != nullptr ? old : "";
  setenv("CVMESH_TETGEN_HELPER", "/nonexistent/cvmesh-tetgen", 1);
  std::string message;
  ErrorCode code{};
  try {
    run(single_tet(3, {1, 0}), "pYAQ");
  } catch (const Error& error) {
    message = error.what();
    code = error.code();
  }
  if (old != nullptr)
    setenv("CVMESH_TETGEN_HELPER", kept.c_str(), 1);
  else
    unsetenv("CVMESH_TETGEN_HELPER");
  CHECK(code == ErrorCode::StageFailed);
  CHECK(contains(message, "CVMESH_TETGEN_HELPER (/nonexistent/cvmesh-tetgen)"));
}

TEST_CASE("run_tetgen: the helper dies with a process that is killed", "[tet][unit]") {
  find_helper();
  const pid_t parent = fork();
  REQUIRE(parent >= 0);
  if (parent == 0) {
    run_tetgen(endless(), {60, 0}, silent_context());
    _exit(0);
  }
  const std::string list =
      "/proc/" + std::to_string(parent) + "/task/" + std::to_string(parent) + "/children";
  pid_t helper = 0;
  for (int i = 0; i < 200 && helper == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    std::ifstream(list) >> helper;
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  kill(parent, SIGKILL);
  waitpid(parent, nullptr, 0);
  if (helper == 0) {
    WARN("this kernel does not list children; nothing checked");
    return;
  }
  // Gone, or a zombie that the init process of this machine has not collected yet.
  const auto is_running = [&] {
    std::string word, state;
    std::ifstream stat("/proc/" + std::to_string(helper) + "/stat");
    stat >> word >> word >> state;
    return !state.empty() && state != "Z" && state != "X";
  };
  for (int i = 0; i < 200 && is_running(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  CHECK_FALSE(is_running());
}
