// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/timer.h"

#include <fstream>
#include <string>

namespace cvmesh {

double peak_memory_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024;
  return 0;
}

void reset_peak_memory() {
  std::ofstream("/proc/self/clear_refs") << "5";
}

}  // namespace cvmesh
