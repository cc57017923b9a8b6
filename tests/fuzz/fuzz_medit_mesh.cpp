// SPDX-License-Identifier: AGPL-3.0-or-later
#include "mesh_target.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  cvmesh::fuzz::read_mesh(data, size, ".mesh", cvmesh::read_tet_file);
  return 0;
}
