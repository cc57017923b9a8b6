// SPDX-License-Identifier: AGPL-3.0-or-later
#include "mesh_target.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  cvmesh::fuzz::read_mesh(data, size, ".off", cvmesh::read_surface_file);
  return 0;
}
