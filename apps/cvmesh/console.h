// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/core/timer.h"
#include "cvmesh/pipeline/pipeline.h"

#include <memory>
#include <string>
#include <string_view>

namespace cvmesh::app {

/// Logger on standard error. Where a progress bar runs, the stage lines come from the bar and the
/// logger says only warnings.
std::shared_ptr<spdlog::logger> make_log(bool is_quiet, bool is_verbose, bool has_bar);

/// Whether standard error is a terminal that can redraw a line.
bool is_terminal();

/// One bar per stage on a terminal, redrawn in place; a line with counts and seconds replaces it
/// when the stage ends.
class ProgressBar : public ProgressSink {
 public:
  void begin(std::string_view stage) override;
  void advance(std::string_view stage, double fraction) override;
  void end(std::string_view stage, double seconds, std::string_view summary) override;
  /// Clears a bar that a failed stage left.
  void clear();

 private:
  Timer since_redraw_;
  int drawn_percent_ = -1;
};

/// The table at the end of a run.
std::string summary_table(const RunResult& result);

}  // namespace cvmesh::app
