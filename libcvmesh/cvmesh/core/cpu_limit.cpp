// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/cpu_limit.h"

#include <cmath>
#include <fstream>
#include <string>

namespace cvmesh {
namespace {

/// Cores of one group; 0 for no limit ("max 100000").
int limit_of(const std::filesystem::path& group) {
  std::ifstream file(group / "cpu.max");
  double quota_us = 0, period_us = 0;
  if (!(file >> quota_us >> period_us) || !(quota_us > 0) || !(period_us > 0)) return 0;
  return static_cast<int>(std::ceil(quota_us / period_us));
}

/// "/a/b" of the line "0::/a/b"; the root where there is none.
std::filesystem::path own_group(const std::filesystem::path& own_file) {
  std::ifstream file(own_file);
  constexpr char kUnified[] = "0::/";
  for (std::string line; std::getline(file, line);)
    if (line.rfind(kUnified, 0) == 0) return line.substr(sizeof kUnified - 1);
  return {};
}

}  // namespace

int cgroup_cpu_limit(const std::filesystem::path& root, const std::filesystem::path& own_file) {
  int least = limit_of(root);
  std::filesystem::path group = root;
  for (const std::filesystem::path& part : own_group(own_file)) {
    group /= part;
    const int limit = limit_of(group);
    if (limit > 0 && (least == 0 || limit < least)) least = limit;
  }
  return least;
}

}  // namespace cvmesh
