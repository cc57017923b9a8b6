// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <sys/mman.h>
#include <system_error>
#include <unistd.h>

namespace cvmesh::fuzz {

/// A regular file in memory that is filled anew for every input: readers want a path. Those that go
/// by its suffix get a link to it.
class MemoryFile {
 public:
  explicit MemoryFile(const std::string& suffix = "")
      : descriptor_(memfd_create("fuzz", MFD_CLOEXEC)),
        path_("/proc/self/fd/" + std::to_string(descriptor_)) {
    if (descriptor_ < 0) std::abort();
    if (suffix.empty()) return;
    link_ = std::filesystem::temp_directory_path() /
            ("cvmesh-fuzz-" + std::to_string(getpid()) + suffix);
    std::filesystem::create_symlink(path_, link_);
  }

  ~MemoryFile() {
    std::error_code ignored;
    if (!link_.empty()) std::filesystem::remove(link_, ignored);
    close(descriptor_);
  }

  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  void fill(const std::uint8_t* data, std::size_t size) const {
    if (ftruncate(descriptor_, 0) != 0) std::abort();
    if (pwrite(descriptor_, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  }

  [[nodiscard]] const std::filesystem::path& path() const { return link_.empty() ? path_ : link_; }

 private:
  int descriptor_;
  std::filesystem::path path_, link_;
};

}  // namespace cvmesh::fuzz
