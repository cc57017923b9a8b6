// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/watchdog.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <unistd.h>
#include <utility>

namespace cvmesh {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kInterval{20};
/// How long a stage may go on after a cancel or at the end of its time: the whole run is to be over
/// within two seconds.
constexpr double kGraceSeconds = 1.5;
/// Memory goes on growing in the meantime.
constexpr double kMemoryGraceSeconds = 0.3;

double resident_mb(const fs::path& process) {
  std::ifstream statm(process / "statm");
  double size = 0, resident = 0;
  if (!(statm >> size >> resident)) return 0;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

}  // namespace

double family_memory_mb() {
  double sum = resident_mb("/proc/self");
  std::error_code error;
  for (fs::directory_iterator task("/proc/self/task", error), end; !error && task != end;
       task.increment(error)) {
    std::ifstream children(task->path() / "children");
    for (std::string pid; children >> pid;)
      sum += resident_mb(fs::path("/proc") / pid);
  }
  return sum;
}

Watchdog::Watchdog(const RunLimits& limits,
                   const std::atomic<bool>* cancel,
                   std::function<std::string()> stage,
                   Stuck when_stuck)
    : limits_(limits),
      cancel_(cancel),
      stage_(std::move(stage)),
      when_stuck_(std::move(when_stuck)),
      grace_s_(kGraceSeconds),
      stop_(cancel != nullptr && cancel->load()),
      thread_(&Watchdog::watch, this) {}

Watchdog::~Watchdog() {
  {
    const std::lock_guard lock(mutex_);
    is_over_ = true;
  }
  over_.notify_one();
  thread_.join();
}

std::optional<Error> Watchdog::limit_reached() const {
  const std::lock_guard lock(mutex_);
  return why_;
}

void Watchdog::watch() {
  std::unique_lock lock(mutex_);
  while (!over_.wait_for(lock, kInterval, [&] { return is_over_; })) {
    lock.unlock();
    look();
    lock.lock();
  }
}

void Watchdog::look() {
  if (stop_) {
    if (!when_stuck_ || is_stuck_told_ || since_stop_.seconds() < grace_s_) return;
    is_stuck_told_ = true;
    when_stuck_(limit_reached().value_or(Error(ErrorCode::Limit, stage_(), "cancelled")));
    return;
  }
  if (cancel_ != nullptr && cancel_->load(std::memory_order_relaxed))
    return stop(kGraceSeconds, std::nullopt);
  if (limits_.time_s > 0 && since_start_.seconds() > limits_.time_s)
    return stop(kGraceSeconds,
                Error(ErrorCode::Limit, stage_(),
                      fmt::format("the time limit of {:g} s was reached; raise --time-limit, crop "
                                  "the volume, or raise epsilon",
                                  limits_.time_s)));
  if (limits_.memory_mb <= 0) return;
  const double memory_mb = family_memory_mb();
  if (memory_mb > limits_.memory_mb)
    stop(kMemoryGraceSeconds,
         Error(ErrorCode::Limit, stage_(),
               fmt::format("{:.0f} MiB are in use, above the memory limit of {:g} MiB; raise "
                           "--memory-limit, or crop the volume by region_of_interest",
                           memory_mb, limits_.memory_mb)));
}

void Watchdog::stop(double grace_s, std::optional<Error> why) {
  grace_s_ = grace_s;
  since_stop_ = Timer();
  {
    const std::lock_guard lock(mutex_);
    why_ = std::move(why);
  }
  stop_ = true;
}

}  // namespace cvmesh
