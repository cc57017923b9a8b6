// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"
#include "cvmesh/core/timer.h"

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace cvmesh {

/// What a run may take; 0 is no limit.
struct RunLimits {
  double time_s = 0;
  double memory_mb = 0;  ///< resident, this process and its helper together
};

/// Stops a run that was cancelled or reached a limit.
///
/// A thread of its own looks at the clock, the resident memory and the caller's cancel flag, and
/// sets the one flag that all stages read. Stages look between their steps; where a step lasts
/// longer than a moment after that, `when_stuck` is called, once and from that thread.
class Watchdog {
 public:
  using Stuck = std::function<void(const Error&)>;

  /// @param cancel      the caller's flag; may be null
  /// @param stage       name of the running stage, for messages; read from the thread
  /// @param when_stuck  may be empty: then a stage takes the time it takes
  Watchdog(const RunLimits& limits,
           const std::atomic<bool>* cancel,
           std::function<std::string()> stage,
           Stuck when_stuck);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  /// What the stages read as `StageContext::cancel`.
  [[nodiscard]] const std::atomic<bool>* stop_flag() const { return &stop_; }

  /// The limit that was reached, as the error that the run ends with.
  [[nodiscard]] std::optional<Error> limit_reached() const;

 private:
  void watch();
  void look();
  void stop(double grace_s, std::optional<Error> why);

  RunLimits limits_;
  const std::atomic<bool>* cancel_;
  std::function<std::string()> stage_;
  Stuck when_stuck_;
  Timer since_start_, since_stop_;
  double grace_s_;
  bool is_stuck_told_ = false;
  std::atomic<bool> stop_ = false;

  mutable std::mutex mutex_;  ///< of `is_over_` and `why_`
  std::condition_variable over_;
  bool is_over_ = false;
  std::optional<Error> why_;
  std::thread thread_;  ///< last, so that all else stands when it starts
};

/// Resident memory of this process and of its children, in MiB.
double family_memory_mb();

}  // namespace cvmesh
