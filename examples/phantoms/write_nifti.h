// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <filesystem>

namespace cvmesh::examples {

/// Writes a label volume as a NIfTI-1 file, compressed when the name ends in ".gz": uint8 when all
/// labels fit, else int32; the frame's world affine as s-form, and as q-form too where it has no
/// shear. Equal volumes give equal bytes.
///
/// The file appears under its name only when it is complete.
/// @throws Error BadInput for a frame whose space is neither RAS nor LPS, or with more than 32,767
///         voxels along an axis; Output when the file cannot be written
void write_nifti(const InputVolume& volume, const std::filesystem::path& path);

}  // namespace cvmesh::examples
