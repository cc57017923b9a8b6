// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/report/report.h"

#include <filesystem>

namespace cvmesh {

/// What a report says about the volume that was read from `file`.
InputSummary summarize_input(const InputVolume& volume, const std::filesystem::path& file);

}  // namespace cvmesh
