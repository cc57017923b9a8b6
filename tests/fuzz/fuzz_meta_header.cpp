// SPDX-License-Identifier: AGPL-3.0-or-later
#include "header_target.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  cvmesh::fuzz::read_volume(data, size, cvmesh::detail::parse_meta_header);
  return 0;
}
