// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <chrono>

namespace cvmesh {

/// Wall-clock seconds since construction.
class Timer {
 public:
  [[nodiscard]] double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The largest resident memory of this process so far, in MiB (VmHWM); since the last
/// `reset_peak_memory()` where the kernel allows a reset.
double peak_memory_mb();
/// Restarts the count behind `peak_memory_mb()`; does nothing where the kernel refuses.
void reset_peak_memory();

}  // namespace cvmesh
