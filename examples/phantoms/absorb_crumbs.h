// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <cstddef>

namespace cvmesh::examples {

/// Gives every piece of a label below `least_voxels` to the label, other than 0, that it shares
/// most faces with (ties: the smaller label). Where two boundaries graze each other, sampling
/// leaves such crumbs. Labels are at most 65535.
void absorb_crumbs(std::size_t least_voxels, InputVolume& volume);

}  // namespace cvmesh::examples
