// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

namespace cvmesh::app {

/// `cvmesh summary DIR...`: many runs in one table.
struct SummaryCommand {
  std::vector<std::string> folders;
  std::string out_file;  ///< empty: standard output
};

/// Writes one CSV row for each NAME.metrics.json and NAME.failed.json in the folders and below
/// them, folder by folder, by path in each.
/// @return 0 when all runs succeeded; 5 when one failed, missed a gate or cannot be read
/// @throws Error BadInput for a folder that is none, or when there are no runs; Output
int run_summary(const SummaryCommand& command);

}  // namespace cvmesh::app
