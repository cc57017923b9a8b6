// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"
#include "cvmesh/io/volume_header.h"

#include "memory_file.h"
#include <algorithm>
#include <vector>

namespace cvmesh::fuzz {

/// Parses the input as a header, and reads the voxels that it leads to. An `Error` BadInput is an
/// answer; everything else that ends the function is a find.
template <typename Parse>
void read_volume(const std::uint8_t* data, std::size_t size, const Parse& parse) {
  constexpr std::size_t kMostVoxels = 1 << 16;
  static const MemoryFile file;
  file.fill(data, size);
  try {
    const detail::VolumeHeader header = parse(file.path());
    const std::size_t voxels = std::min(header.frame.size(), kMostVoxels);
    if (header.frame.size() == 0 || header.volumes == 0) std::abort();  // promised by checked_dims
    if (header.data_file != file.path()) return;  // a sibling: some other descriptor of ours
    detail::ByteSource source(header.data_file, header.storage, header.data_begin,
                              header.data_count);
    std::vector<unsigned char> bytes(voxels * detail::voxel_bytes(header.type));
    const std::size_t got = source.read(bytes.data(), bytes.size());
    std::vector<Label> labels(got / detail::voxel_bytes(header.type));
    detail::convert_voxels(header.data_file, header, bytes.data(), 0, labels.size(), labels.data());
    source.finish(kMostVoxels);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::BadInput || error.message().empty()) std::abort();
  }
}

}  // namespace cvmesh::fuzz
