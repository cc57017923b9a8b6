// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tetgen_backend.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/timer.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <filesystem>
#include <poll.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

extern "C" char** environ;  // NOLINT: POSIX asks for this declaration

namespace cvmesh {
namespace {

namespace fs = std::filesystem;
using namespace tetgen_protocol;

constexpr const char* kStage = "tetrahedra";
constexpr const char* kHelperName = "cvmesh-tetgen";
constexpr int kPollMs = 20;                 // a cancel is seen within this time
constexpr std::size_t kChatterKept = 4096;  // end of what the helper printed
constexpr std::size_t kTransferBlock = 1 << 20;
constexpr double kNearMemoryLimit = 0.6;  // resident share of a limited address space

bool is_executable_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error) && access(path.c_str(), X_OK) == 0;
}

/// Folders of the file that holds this code (library or executable) and of the executable.
std::vector<fs::path> own_folders() {
  std::vector<fs::path> folders;
  std::error_code error;
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&find_tetgen_helper), &info) != 0 &&
      info.dli_fname != nullptr) {
    const fs::path file = fs::canonical(info.dli_fname, error);
    if (!error) folders.push_back(file.parent_path());
  }
  const fs::path executable = fs::read_symlink("/proc/self/exe", error);
  if (!error) folders.push_back(executable.parent_path());
  return folders;
}

/// A file descriptor that closes itself.
class Descriptor {
 public:
  Descriptor() = default;

  explicit Descriptor(int fd) : fd_(fd) {}

  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }

  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  ~Descriptor() { reset(); }

  void reset() {
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }

  [[nodiscard]] int get() const { return fd_; }

  [[nodiscard]] bool is_open() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

void require_call(bool succeeded, const char* what) {
  require(succeeded, ErrorCode::StageFailed, kStage,
          std::string("cannot start the helper program: ") + what + ": " + std::strerror(errno));
}

void set_nonblocking(int fd) {
  fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
}

/// The running helper and the near ends of its three channels. Whatever way this object goes, the
/// helper is dead and reaped afterwards.
class Helper {
 public:
  explicit Helper(const std::string& path) {
    // A socket towards the helper, because a write to it can be told not to raise SIGPIPE.
    int to[2], from[2], chatter[2];
    require_call(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, to) == 0, "socketpair");
    Descriptor to_near(to[0]), to_far(to[1]);
    require_call(pipe2(from, O_CLOEXEC) == 0, "pipe");
    Descriptor from_near(from[0]), from_far(from[1]);
    require_call(pipe2(chatter, O_CLOEXEC) == 0, "pipe");
    Descriptor chatter_near(chatter[0]), chatter_far(chatter[1]);

    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, to_far.get(), STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, from_far.get(), STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, chatter_far.get(), STDERR_FILENO);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    // A group of its own: an interrupt from the terminal reaches this process, which then ends the
    // helper in its own time.
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(
        &attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    std::string name = path;
    char* arguments[] = {name.data(), nullptr};
    const int failure = posix_spawn(&pid_, path.c_str(), &actions, &attributes, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (failure != 0) pid_ = -1;
    errno = failure;
    require_call(failure == 0, path.c_str());

    request = std::move(to_near);
    reply = std::move(from_near);
    printed = std::move(chatter_near);
    set_nonblocking(request.get());
    set_nonblocking(reply.get());
    set_nonblocking(printed.get());
  }

  Helper(const Helper&) = delete;
  Helper& operator=(const Helper&) = delete;

  ~Helper() { kill_and_reap(); }

  /// True once the helper has ended; `status` and `peak_mb` are set then.
  bool reap(bool wait) {
    if (pid_ < 0) return true;
    rusage usage{};
    pid_t result = 0;
    do {
      result = wait4(pid_, &status, wait ? 0 : WNOHANG, &usage);
    } while (result < 0 && errno == EINTR);
    if (result == 0) return false;
    // A host that ignores SIGCHLD leaves no status to collect; the reply alone then decides.
    if (result < 0) status = 0;
    peak_mb = static_cast<double>(usage.ru_maxrss) / 1024;
    pid_ = -1;
    return true;
  }

  void kill_and_reap() {
    if (pid_ < 0) return;
    kill(pid_, SIGKILL);
    reap(true);
  }

  Descriptor request, reply, printed;
  int status = 0;
  double peak_mb = 0;

 private:
  pid_t pid_ = -1;
};

/// Sends bytes as far as the socket takes them; closes it at the end, or when nobody listens.
void send_some(Descriptor& socket, const std::vector<char>& bytes, std::size_t& sent) {
  while (sent < bytes.size()) {
    const ssize_t count = send(socket.get(), bytes.data() + sent,
                               std::min(bytes.size() - sent, kTransferBlock), MSG_NOSIGNAL);
    if (count > 0) {
      sent += static_cast<std::size_t>(count);
    } else if (count < 0 && errno == EINTR) {
      continue;
    } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      return;
    } else {
      break;
    }
  }
  socket.reset();
}

/// Appends what the pipe holds; closes it at its end.
template <typename Bytes>
void receive_some(Descriptor& pipe, Bytes& bytes) {
  for (;;) {
    const std::size_t old_size = bytes.size();
    bytes.resize(old_size + kTransferBlock / 16);
    const ssize_t count = read(pipe.get(), bytes.data() + old_size, bytes.size() - old_size);
    bytes.resize(old_size + static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
    if (count > 0 || (count < 0 && errno == EINTR)) continue;
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
    pipe.reset();
    return;
  }
}

struct Conversation {
  std::vector<char> reply;
  std::string printed;
  bool timed_out = false;
};

/// Sends the request and collects the reply until the helper has ended, the time is over (the
/// helper is killed) or a cancel was asked for.
Conversation converse(Helper& helper,
                      const std::vector<char>& request,
                      double time_limit_s,
                      const StageContext& context) {
  Conversation talk;
  const Timer timer;
  std::size_t sent = 0;
  while (!helper.reap(false) || helper.reply.is_open()) {
    if (context.cancel != nullptr && context.cancel->load(std::memory_order_relaxed)) {
      helper.kill_and_reap();
      throw Error(ErrorCode::Limit, kStage, "cancelled; TetGen was stopped");
    }
    if (time_limit_s > 0 && timer.seconds() > time_limit_s) {
      helper.kill_and_reap();
      talk.timed_out = true;
      break;
    }
    pollfd channels[3];
    nfds_t open = 0;
    if (helper.request.is_open()) channels[open++] = {helper.request.get(), POLLOUT, 0};
    if (helper.reply.is_open()) channels[open++] = {helper.reply.get(), POLLIN, 0};
    if (helper.printed.is_open()) channels[open++] = {helper.printed.get(), POLLIN, 0};
    poll(channels, open, kPollMs);
    if (helper.request.is_open()) send_some(helper.request, request, sent);
    if (helper.reply.is_open()) receive_some(helper.reply, talk.reply);
    if (helper.printed.is_open()) receive_some(helper.printed, talk.printed);
    if (talk.printed.size() > 2 * kChatterKept)
      talk.printed.erase(0, talk.printed.size() - kChatterKept);
  }
  return talk;
}

/// The last line that is not blank; of a failed assertion only what was asserted.
std::string last_line(const std::string& text) {
  const std::size_t end = text.find_last_not_of(" \t\r\n");
  if (end == std::string::npos) return {};
  const std::size_t line_end = text.find_last_of("\r\n", end);
  const std::size_t start = line_end == std::string::npos ? 0 : line_end + 1;
  const std::string line = text.substr(start, end + 1 - start);
  const std::size_t assertion = line.find("Assertion `");
  return assertion == std::string::npos ? line : line.substr(assertion);
}

std::string format_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string memory_advice(const TetgenLimits& limits) {
  return limits.memory_mb > 0 ? "raise tetgen_memory_limit_mb (" + format_number(limits.memory_mb) +
                                    ") or make the mesh coarser (larger epsilon)"
                              : "make the mesh coarser (larger epsilon) or use a machine with more "
                                "memory";
}

void describe_refusal(TetgenRun& run, const TetgenLimits& limits) {
  run.outcome = TetgenOutcome::Refused;
  switch (run.reply.code) {
    case 1:
    case kCodeOutOfMemory:
      run.outcome = TetgenOutcome::OutOfMemory;
      run.description = "TetGen ran out of memory; " + memory_advice(limits);
      return;
    case 2:
      run.description =
          "TetGen met a fault of its own (error 2); make the surface finer (smaller "
          "epsilon) or change the seed";
      return;
    case 3:
      run.description =
          "TetGen found facets that intersect (error 3); the surface must be free of "
          "intersections: make it finer (smaller epsilon) or change the seed";
      return;
    case 4:
    case 5:
      run.description = "TetGen found facets or points too close to each other (error " +
                        std::to_string(run.reply.code) +
                        "); make the surface finer (smaller epsilon) or change the seed";
      return;
    case 10:
      run.description =
          "TetGen cannot use the input (error 10): fewer than four points, or all in "
          "one plane";
      return;
    case kCodeBadRequest:
      run.outcome = TetgenOutcome::BrokenReply;
      run.description =
          "the helper program does not understand the request: it belongs to another "
          "version; reinstall cvmesh or correct CVMESH_TETGEN_HELPER";
      return;
    default:
      run.description = "TetGen gave up with error " + std::to_string(run.reply.code) +
                        "; make the surface finer (smaller epsilon) or change the seed";
  }
}

/// Why the helper ended without a usable reply.
void describe_end(TetgenRun& run,
                  int status,
                  const Conversation& talk,
                  const TetgenLimits& limits) {
  const std::string words = last_line(talk.printed);
  const std::string said = words.empty() ? "" : " (\"" + words + "\")";
  const bool is_near_limit =
      limits.memory_mb > 0 && run.peak_mb > kNearMemoryLimit * limits.memory_mb;
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    const std::string name = "signal " + std::to_string(signal) + ", " + strsignal(signal);
    if (signal == SIGKILL || is_near_limit) {
      run.outcome = TetgenOutcome::OutOfMemory;
      run.description = "TetGen was killed (" + name + ") at " + format_number(run.peak_mb) +
                        " MB, probably for want of memory; " + memory_advice(limits);
      return;
    }
    run.outcome = TetgenOutcome::Crashed;
    run.description = signal == SIGABRT
                          ? "TetGen stopped at a check of its own (" + name + ")" + said +
                                "; points in one line or plane do this: make the surface finer "
                                "(smaller epsilon) or change the seed"
                          : "TetGen crashed (" + name + ")" + said +
                                "; facets that intersect or nearly touch do this: make the surface "
                                "finer (smaller epsilon) or change the seed";
    return;
  }
  if (WEXITSTATUS(status) != 0) {
    run.outcome = TetgenOutcome::Crashed;
    run.description = "the helper program ended with exit code " +
                      std::to_string(WEXITSTATUS(status)) + said +
                      "; reinstall cvmesh or correct CVMESH_TETGEN_HELPER";
    return;
  }
  run.outcome = TetgenOutcome::BrokenReply;
  run.description = "the reply of the helper program is damaged or cut short (" +
                    std::to_string(talk.reply.size()) + " bytes)" + said +
                    "; reinstall cvmesh or correct CVMESH_TETGEN_HELPER";
}

/// Unpacks a complete reply; false when it is anything else.
bool unpack(std::vector<char> bytes, Reply& reply) {
  Header header;
  if (bytes.size() < sizeof header) return false;
  std::memcpy(&header, bytes.data(), sizeof header);
  bytes.erase(bytes.begin(), bytes.begin() + sizeof header);
  return header.magic == kMagic && header.version == kVersion && header.kind == Kind::Reply &&
         header.payload_bytes == bytes.size() && header.checksum == checksum(bytes) &&
         decode(bytes, reply);
}

std::vector<char> message(const Request& request, const TetgenLimits& limits) {
  const std::vector<char> payload = encode(request);
  Header header;
  header.kind = Kind::Request;
  header.payload_bytes = payload.size();
  header.checksum = checksum(payload);
  header.memory_limit_bytes = static_cast<std::uint64_t>(limits.memory_mb * 1024 * 1024);
  header.parent_pid = getpid();
  std::vector<char> bytes(sizeof header + payload.size());
  std::memcpy(bytes.data(), &header, sizeof header);
  std::memcpy(bytes.data() + sizeof header, payload.data(), payload.size());
  return bytes;
}

}  // namespace

std::string find_tetgen_helper() {
  if (const char* named = std::getenv("CVMESH_TETGEN_HELPER"); named != nullptr && *named != 0) {
    require(is_executable_file(named), ErrorCode::StageFailed, kStage,
            std::string("CVMESH_TETGEN_HELPER (") + named +
                ") is no executable file; correct it or unset it");
    return named;
  }
  std::string searched;
  for (const fs::path& folder : own_folders()) {
    for (const char* relative :
         {"../libexec/cvmesh", "../../libexec/cvmesh", ".", "../cvmesh_tetgen",
          "../apps/cvmesh_tetgen", "apps/cvmesh_tetgen", "../../apps/cvmesh_tetgen"}) {
      const fs::path candidate = (folder / relative / kHelperName).lexically_normal();
      if (is_executable_file(candidate)) return candidate;
      searched += (searched.empty() ? "" : ", ") + candidate.parent_path().string();
    }
  }
  throw Error(ErrorCode::StageFailed, kStage,
              std::string("the helper program ") + kHelperName + " is missing (searched " +
                  searched + "); reinstall cvmesh or set CVMESH_TETGEN_HELPER to its path");
}

TetgenRun run_tetgen(const Request& request,
                     const TetgenLimits& limits,
                     const StageContext& context) {
  const Timer timer;
  TetgenRun run;
  Helper helper(find_tetgen_helper());
  Conversation talk = converse(helper, message(request, limits), limits.time_s, context);
  run.seconds = timer.seconds();
  run.peak_mb = helper.peak_mb;
  if (!talk.printed.empty()) context.log->debug("{}: TetGen says: {}", kStage, talk.printed);
  if (talk.timed_out) {
    run.outcome = TetgenOutcome::TimedOut;
    run.description = "TetGen was stopped at the time limit; raise tetgen_time_limit_s (" +
                      format_number(limits.time_s) + ") or relax tet_min_dihedral_deg";
  } else if (!unpack(std::move(talk.reply), run.reply)) {
    run.reply = {};
    describe_end(run, helper.status, talk, limits);
  } else if (run.reply.code != 0) {
    describe_refusal(run, limits);
  } else if (run.reply.tets.empty()) {
    run.outcome = TetgenOutcome::NoTets;
    run.description = "TetGen returned no tets: the surface is not closed";
  }
  return run;
}

}  // namespace cvmesh
