// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace cvmesh::test_data {

/// The folder of real volumes: the environment's CVMESH_TEST_DATA, else `shared/data` beside the
/// repository; nothing when neither is there.
std::optional<std::filesystem::path> folder();

/// A file of that folder, or nothing. A test that gets nothing says so (WARN) and returns.
std::optional<std::filesystem::path> file(const std::string& name);

/// A folder of its own that is removed, with all that is in it, when the object goes.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const {
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace cvmesh::test_data
