// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/pipeline/pipeline.h"
#include "cvmesh/report/check_gates.h"

#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

/// What decides the files of a run, in one number: the SHA-256 of the version, the bytes of the
/// label volume and of the sampled image, all effective parameters, label names, formats, space and
/// options. Not the folder of the results, nor the number of threads.
/// @throws Error BadInput when a file cannot be read
std::string run_key(const RunRequest& request);

/// The gates of a run with the same key whose report and meshes are in the folder of the results
/// (empty where it had none); nullopt where there is no such run.
/// @throws Error BadInput when an input cannot be read
std::optional<std::vector<GateResult>> gates_if_finished(const RunRequest& request);

}  // namespace cvmesh
