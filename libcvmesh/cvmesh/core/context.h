// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string_view>

namespace spdlog {
class logger;
}

namespace cvmesh {

/// Where a stage tells how far it is. Calls come from one thread at a time.
class ProgressSink {
 public:
  virtual ~ProgressSink() = default;
  virtual void begin(std::string_view stage) = 0;
  /// `fraction` of the stage that is done, 0 to 1, not decreasing.
  virtual void advance(std::string_view stage, double fraction) = 0;
  /// `seconds` the stage took; `summary` its counts in one short line.
  virtual void end(std::string_view stage, double seconds, std::string_view summary) = 0;
};

/// What every stage gets besides its input: nothing in it may change the mesh except the seed.
struct StageContext {
  std::shared_ptr<spdlog::logger> log;        ///< never null
  ProgressSink* progress = nullptr;           ///< may be null
  const std::atomic<bool>* cancel = nullptr;  ///< may be null
  std::uint64_t seed = 1;
};

/// A context that logs nowhere: for tests and for callers that want silence.
StageContext silent_context(std::uint64_t seed = 1);

/// Reports progress of the running stage and leaves it when a cancel was asked for.
/// @throws Error Limit when `context.cancel` is set
void report_progress(const StageContext& context, std::string_view stage, double fraction);

}  // namespace cvmesh
