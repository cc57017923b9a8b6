// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/warning_log.h"

#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <mutex>
#include <utility>

namespace cvmesh {
namespace {

class WarningSink : public spdlog::sinks::base_sink<std::mutex> {
 public:
  WarningSink(std::shared_ptr<spdlog::logger> log, std::vector<std::string>& warnings)
      : log_(std::move(log)), warnings_(warnings) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (message.level == spdlog::level::warn)
      warnings_.emplace_back(message.payload.data(), message.payload.size());
    log_->log(message.time, message.source, message.level, message.payload);
  }

  void flush_() override { log_->flush(); }

 private:
  std::shared_ptr<spdlog::logger> log_;
  std::vector<std::string>& warnings_;
};

}  // namespace

std::shared_ptr<spdlog::logger> make_warning_log(const std::shared_ptr<spdlog::logger>& log,
                                                 std::vector<std::string>& warnings) {
  auto result =
      std::make_shared<spdlog::logger>(log->name(), std::make_shared<WarningSink>(log, warnings));
  result->set_level(std::min(log->level(), spdlog::level::warn));
  return result;
}

}  // namespace cvmesh
