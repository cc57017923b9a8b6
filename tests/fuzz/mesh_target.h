// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"
#include "cvmesh/io/surface_reader.h"
#include "cvmesh/io/tet_reader.h"

#include "memory_file.h"
#include <cmath>
#include <string>
#include <vector>

namespace cvmesh::fuzz {

/// What a reader promises of every mesh that it returns: indices in range, points finite.
template <std::size_t Corners>
void check_promises(const std::vector<Vec3>& points,
                    const std::vector<std::array<std::int32_t, Corners>>& elements) {
  if (elements.empty()) std::abort();
  for (const Vec3& p : points)
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) std::abort();
  for (const auto& element : elements)
    for (const std::int32_t v : element)
      if (v < 0 || v >= std::ssize(points)) std::abort();
}

inline void check_promises(const TetFile& file) {
  check_promises(file.points, file.tets);
  if (file.label_of.size() != file.tets.size() || file.label_source.empty()) std::abort();
}

inline void check_promises(const SurfaceFile& file) {
  check_promises(file.points, file.facets);
}

/// Reads the input as a file with this suffix. An `Error` BadInput is an answer; everything else
/// that ends the function is a find.
template <typename Read>
void read_mesh(const std::uint8_t* data,
               std::size_t size,
               const std::string& suffix,
               const Read& read) {
  static const MemoryFile file(suffix);
  file.fill(data, size);
  try {
    check_promises(read(file.path()));
  } catch (const Error& error) {
    if (error.code() != ErrorCode::BadInput || error.message().empty()) std::abort();
  }
}

}  // namespace cvmesh::fuzz
