// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/atomic_file.h"

#include "cvmesh/core/error.h"

#include <atomic>
#include <cerrno>
#include <fcntl.h>
#include <system_error>
#include <unistd.h>
#include <vector>

namespace cvmesh {
namespace {

constexpr std::size_t kBufferBytes = std::size_t{1} << 20;
constexpr std::size_t kLongestName = 200;  // file systems end at 255; the rest is for the suffix

std::string text_of_errno(int number) {
  return std::generic_category().message(number);
}

constexpr std::string_view kTemporarySuffix = ".part";

/// What the temporary names of this process, and of no other, have in common.
std::string process_mark() {
  return "." + std::to_string(::getpid()) + "-";
}

std::filesystem::path temporary_name(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  const std::string name = path.filename().string().substr(0, kLongestName);
  return path.parent_path() /
         ("." + name + process_mark() + std::to_string(counter++) + std::string(kTemporarySuffix));
}

void sync_folder(const std::filesystem::path& file) {
  // The rename itself has to reach the disk. Some file systems cannot sync a folder; the file is
  // complete under its name either way, so that is no error.
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace

AtomicFile::AtomicFile(const std::filesystem::path& path) : path_(path) {
  require(path.has_filename(), ErrorCode::Output, "write",
          "'" + path.string() + "' names no file; give a file name");
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    errno = EISDIR;
    fail("cannot be written");
  }
  temporary_ = temporary_name(path);
  descriptor_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor_ < 0) fail("cannot be created");
  buffer_.reserve(kBufferBytes);
}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

void AtomicFile::write(std::string_view bytes) {
  require(descriptor_ >= 0, ErrorCode::Internal, "write",
          "'" + path_.string() + "' was written to after its commit");
  while (!bytes.empty()) {
    const std::size_t part = std::min(bytes.size(), kBufferBytes - buffer_.size());
    buffer_.append(bytes.substr(0, part));
    bytes.remove_prefix(part);
    if (buffer_.size() == kBufferBytes) flush();
  }
}

void AtomicFile::commit() {
  require(descriptor_ >= 0, ErrorCode::Internal, "write",
          "'" + path_.string() + "' was committed twice");
  flush();
  if (::fsync(descriptor_) != 0) fail("cannot be put on the disk");
  // close() reports what network file systems held back until now.
  const int closed = ::close(descriptor_);
  descriptor_ = -1;
  if (closed != 0) fail("cannot be closed");
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) fail("cannot be given its name");
  temporary_.clear();
  sync_folder(path_);
}

void remove_temporaries(const std::filesystem::path& folder) noexcept try {
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    const bool is_ours = name.starts_with('.') && name.ends_with(kTemporarySuffix) &&
                         name.find(process_mark()) != std::string::npos;
    if (is_ours) found.push_back(entry.path());
  }
  std::error_code ignored;
  for (const std::filesystem::path& file : found)
    std::filesystem::remove(file, ignored);

} catch (const std::exception&) {
  // The folder is not there or cannot be read: then there is nothing to remove.
}

void AtomicFile::flush() {
  std::string_view rest = buffer_;
  while (!rest.empty()) {
    const ssize_t written = ::write(descriptor_, rest.data(), rest.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail("cannot be written");
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
  buffer_.clear();
}

void AtomicFile::fail(const std::string& what) const {
  const std::string reason = text_of_errno(errno);
  throw Error(ErrorCode::Output, "write",
              "'" + path_.string() + "' " + what + ": " + reason +
                  "; check that the folder exists, may be written to and has room");
}

}  // namespace cvmesh
