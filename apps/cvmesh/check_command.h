// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parameters.h"

#include <string>
#include <vector>

namespace cvmesh::app {

struct CheckCommand {
  std::string input, params_file, label_names_file;
  std::vector<std::string> settings;  ///< "key=value"
  ReadVolumeOptions read;
  bool as_json = false;
};

/// Reads and validates a label volume, prints its labels and a forecast of what meshing it with
/// these parameters takes, and stops.
/// @param threads  of the run that is forecast
/// @return the exit code
/// @throws Error as `cvmesh mesh` would when it reads the volume and looks up what the parameters
///         name in it
int run_check(const CheckCommand& command, const Parameters& parameters, int threads);

}  // namespace cvmesh::app
