// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/test_data.h"

#include <cstdlib>
#include <stdexcept>
#include <system_error>

#ifndef CVMESH_SOURCE_DIR
#error "CVMESH_SOURCE_DIR must name the repository root"
#endif

namespace cvmesh::test_data {

namespace fs = std::filesystem;

std::optional<fs::path> folder() {
  const char* named = std::getenv("CVMESH_TEST_DATA");
  const fs::path path = named != nullptr && *named != '\0'
                            ? fs::path(named)
                            : fs::path(CVMESH_SOURCE_DIR).parent_path() / "shared" / "data";
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) return std::nullopt;
  return path;
}

std::optional<fs::path> file(const std::string& name) {
  const std::optional<fs::path> where = folder();
  std::error_code ignored;
  if (!where || !fs::is_regular_file(*where / name, ignored)) return std::nullopt;
  return *where / name;
}

TemporaryFolder::TemporaryFolder() {
  std::string name = (fs::temp_directory_path() / "cvmesh-test-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make " + name);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace cvmesh::test_data
