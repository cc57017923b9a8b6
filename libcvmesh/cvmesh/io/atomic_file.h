// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace cvmesh {

/// A file that appears under its name only when it is complete.
///
/// Bytes go, through a buffer, to a hidden temporary name in the target folder; `commit()` puts
/// them on the disk and renames. A file that was never committed leaves nothing behind, and an
/// older file of that name stays as it was. Folders are not created.
class AtomicFile {
 public:
  /// @throws Error Output when the temporary file cannot be created
  explicit AtomicFile(const std::filesystem::path& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// @throws Error Output when the disk refuses (full, quota, removed)
  void write(std::string_view bytes);

  /// The values as they lie in memory.
  template <typename T>
  void write_values(std::span<const T> values) {
    write({reinterpret_cast<const char*>(values.data()), values.size_bytes()});
  }

  /// Flushes, syncs and renames; nothing may be written afterwards.
  /// @throws Error Output when any of these fails; the temporary file is removed then
  void commit();

 private:
  void flush();
  [[noreturn]] void fail(const std::string& what) const;

  std::filesystem::path path_, temporary_;
  std::string buffer_;
  int descriptor_ = -1;
};

/// Removes the temporary files that this process has in a folder, whoever is writing them: their
/// commit fails from then on.
void remove_temporaries(const std::filesystem::path& folder) noexcept;

}  // namespace cvmesh
