// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string>

namespace cvmesh::app {

/// `cvmesh compare A B`: what changed between two reports.
struct CompareCommand {
  std::string a, b;             ///< NAME.metrics.json each
  std::string tolerances_file;  ///< over the built-in tolerances; empty for none
  std::string json_file;        ///< the comparison for other programs; empty for none
  bool with_timings = false;
  bool is_quiet = false;  ///< only what is beyond its tolerance
  bool is_all = false;    ///< what did not change, too
};

/// Prints the table to standard output.
/// @return 0 when all changes are within the tolerances, else 5
/// @throws Error BadInput for a file that is no report; BadParameter for a faulty tolerances file;
///         Output
int run_compare(const CompareCommand& command);

}  // namespace cvmesh::app
