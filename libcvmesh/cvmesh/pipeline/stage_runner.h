// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/timer.h"
#include "cvmesh/report/report.h"

#include <atomic>
#include <string>
#include <utility>

namespace cvmesh {

/// What the pipeline does around every stage: time it, measure its peak memory, tell log and
/// progress sink, and stop when a cancel was asked for.
class StageRunner {
 public:
  StageRunner(const StageContext& context, Report& report) : context_(context), report_(report) {}

  /// Runs `work()` as the stage `name` and returns its result; `describe(result)` gives its counts
  /// in one short line. A stage may run more than once; its times add up.
  template <typename Work, typename Describe>
  auto run(const char* name, const Work& work, const Describe& describe) {
    begin(name);
    const Timer timer;
    auto result = work();
    end(name, timer.seconds(), describe(std::as_const(result)));
    return result;
  }

  /// The stage that is running or ran last; any thread may ask.
  [[nodiscard]] std::string current() const { return current_.load(); }

 private:
  void begin(const char* name);
  void end(const char* name, double seconds, const std::string& summary);

  const StageContext& context_;
  Report& report_;
  std::atomic<const char*> current_ = "pipeline";
};

}  // namespace cvmesh
