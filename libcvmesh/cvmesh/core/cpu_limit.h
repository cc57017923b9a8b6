// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <filesystem>

namespace cvmesh {

/// How many cores the control groups (version 2) of this process may keep busy, rounded up: the
/// least of `cpu.max` in its group and all groups above. 0 where none of them sets a limit, or the
/// machine has no such groups.
/// @param root      where the groups are mounted
/// @param own_file  names the process's group in a line "0::/path"
int cgroup_cpu_limit(const std::filesystem::path& root = "/sys/fs/cgroup",
                     const std::filesystem::path& own_file = "/proc/self/cgroup");

}  // namespace cvmesh
