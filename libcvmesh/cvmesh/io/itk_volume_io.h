// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/io/volume_header.h"

#include <filesystem>
#include <string>
#include <vector>

namespace cvmesh::detail {

enum class ItkFormat { Meta, Nrrd };

/// The version of ITK that runs.
std::string itk_version();

/// The voxels of a MetaImage or NRRD file in this machine's byte order, read by ITK's class for
/// that format alone (no factories). `header` is our own reading of the file, whose data has been
/// checked; ITK must agree with it on size and type.
/// @throws Error BadInput when it does not, or cannot read the file
/// @note   one call at a time: ITK's messages on std::cerr are held back while it reads
std::vector<unsigned char> read_voxels_by_itk(const std::filesystem::path& path,
                                              const VolumeHeader& header,
                                              ItkFormat format);

}  // namespace cvmesh::detail
