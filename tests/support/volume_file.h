// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <filesystem>

namespace cvmesh {

/// Writes a volume as NIfTI (Int32, s-form = the frame's world map).
void write_volume_file(const std::filesystem::path& path, const InputVolume& volume);

}  // namespace cvmesh
