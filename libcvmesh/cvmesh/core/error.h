// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <stdexcept>
#include <string>

namespace cvmesh {

/// What went wrong, as the exit code of the command (README, "Exit codes").
enum class ErrorCode {
  Internal = 1,      ///< a fault of cvmesh itself
  BadParameter = 2,  ///< command line or parameter file
  BadInput = 3,      ///< the label volume
  StageFailed = 4,   ///< a stage could not reach a valid result (label lost, degenerate, TetGen)
  QualityGate = 5,   ///< a mesh was written, but misses a requested criterion
  Output = 6,        ///< a file could not be written
  Limit = 7,         ///< a time or memory limit was reached
};

/// The one exception type that leaves the library. `what()` is "stage: message".
class Error : public std::runtime_error {
 public:
  Error(ErrorCode code, const std::string& stage, const std::string& message)
      : std::runtime_error(stage + ": " + message), code_(code), stage_(stage), message_(message) {}

  [[nodiscard]] ErrorCode code() const { return code_; }

  [[nodiscard]] const std::string& stage() const { return stage_; }

  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  ErrorCode code_;
  std::string stage_;
  std::string message_;
};

/// Checks what users can cause, in every build.
/// @throws Error with the given code, stage and message when `condition` is false
inline void require(bool condition,
                    ErrorCode code,
                    const std::string& stage,
                    const std::string& message) {
  if (!condition) throw Error(code, stage, message);
}

}  // namespace cvmesh
