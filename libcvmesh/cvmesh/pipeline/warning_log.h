// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace spdlog {
class logger;
}

namespace cvmesh {

/// A logger that hands every message on to `log` and keeps the text of warnings in `warnings`, also
/// where `log` is too quiet to say them.
/// @param warnings  must outlive the logger
std::shared_ptr<spdlog::logger> make_warning_log(const std::shared_ptr<spdlog::logger>& log,
                                                 std::vector<std::string>& warnings);

}  // namespace cvmesh
