// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/label_names.h"

#include "memory_file.h"

using namespace cvmesh;

/// Every name that is accepted is one line with something in it: writers rely on that.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::MemoryFile file;
  file.fill(data, size);
  try {
    const std::map<Label, std::string> names = read_label_names(file.path());
    if (names.empty()) std::abort();
    for (const auto& [label, name] : names)
      if (name.empty() || name.find_first_of("\r\n") != std::string::npos) std::abort();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::BadParameter || error.message().empty()) std::abort();
  }
  return 0;
}
