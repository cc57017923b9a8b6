// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/stage_runner.h"

#include <spdlog/spdlog.h>

#include <algorithm>

namespace cvmesh {

void StageRunner::begin(const char* name) {
  current_ = name;
  if (context_.progress != nullptr) context_.progress->begin(name);
  report_progress(context_, name, 0);
  context_.log->debug("{}: start", name);
  reset_peak_memory();
}

void StageRunner::end(const char* name, double seconds, const std::string& summary) {
  report_progress(context_, name, 1);
  const auto found = std::find_if(report_.timings.begin(), report_.timings.end(),
                                  [&](const StageTiming& t) { return t.stage == name; });
  StageTiming& timing =
      found != report_.timings.end() ? *found : report_.timings.emplace_back(StageTiming{name});
  timing.seconds += seconds;
  timing.peak_mb = std::max(timing.peak_mb, peak_memory_mb());
  report_.peak_mb = std::max(report_.peak_mb, timing.peak_mb);
  context_.log->info("{}: {}, {:.2f} s", name, summary, seconds);
  if (context_.progress != nullptr) context_.progress->end(name, seconds, summary);
}

}  // namespace cvmesh
