// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/context.h"

#include "cvmesh/core/error.h"

#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>

#include <string>

namespace cvmesh {

StageContext silent_context(std::uint64_t seed) {
  StageContext context;
  context.log =
      std::make_shared<spdlog::logger>("silent", std::make_shared<spdlog::sinks::null_sink_mt>());
  context.seed = seed;
  return context;
}

void report_progress(const StageContext& context, std::string_view stage, double fraction) {
  if (context.cancel != nullptr && context.cancel->load(std::memory_order_relaxed))
    throw Error(ErrorCode::Limit, std::string(stage), "cancelled");
  if (context.progress != nullptr) context.progress->advance(stage, fraction);
}

}  // namespace cvmesh
