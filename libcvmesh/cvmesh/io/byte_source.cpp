// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"

#include "cvmesh/core/error.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <system_error>
#include <vector>
#include <zlib.h>

namespace cvmesh::detail {
namespace {

constexpr std::size_t kBlockBytes = std::size_t{1} << 18;

std::uint64_t size_of_regular_file(const std::filesystem::path& path) {
  std::error_code code;
  if (!std::filesystem::exists(path, code)) refuse_file(path, "does not exist; check the path");
  if (!std::filesystem::is_regular_file(path, code))
    refuse_file(path, "is not a regular file; give the image file itself");
  const std::uint64_t size = std::filesystem::file_size(path, code);
  if (code) refuse_file(path, "cannot be read: " + code.message());
  return size;
}

}  // namespace

void refuse_file(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorCode::BadInput, "read", "'" + path.string() + "' " + what);
}

struct ByteSource::State {
  std::filesystem::path path;
  Storage storage = Storage::Raw;
  std::FILE* file = nullptr;
  std::uint64_t stored = 0;  // bytes of the part
  std::uint64_t left = 0;    // of those, not yet read from the file
  z_stream stream{};
  bool is_inflating = false;
  bool is_at_end = false;
  std::vector<unsigned char> block;

  ~State() {
    if (is_inflating) inflateEnd(&stream);
    if (file) std::fclose(file);
  }

  std::size_t read_stored(void* target, std::size_t count) {
    const std::size_t wanted = static_cast<std::size_t>(std::min<std::uint64_t>(count, left));
    const std::size_t got = std::fread(target, 1, wanted, file);
    if (got < wanted && std::ferror(file))
      refuse_file(path, "cannot be read: " + std::generic_category().message(errno));
    left = got < wanted ? 0 : left - got;
    return got;
  }

  bool refill() {
    if (stream.avail_in > 0) return true;
    stream.next_in = block.data();
    stream.avail_in = static_cast<uInt>(read_stored(block.data(), block.size()));
    return stream.avail_in > 0;
  }

  // After a gzip member: another member may follow, or the zeros that some media pad with.
  void start_next_member() {
    while (refill() && *stream.next_in == 0) {
      ++stream.next_in;
      --stream.avail_in;
    }
    if (!refill()) {
      is_at_end = true;
      return;
    }
    if (storage != Storage::Gzip || *stream.next_in != 0x1f)
      refuse_file(path, "has foreign bytes after its compressed data; compress it again");
    inflateReset(&stream);
  }

  std::size_t inflate_some(unsigned char* target, std::size_t count) {
    std::size_t done = 0;
    while (done < count && !is_at_end) {
      if (!refill())
        refuse_file(path,
                    "is cut short: its compressed data ends before its end mark; copy it again");
      const std::size_t room = std::min<std::size_t>(count - done, std::size_t{1} << 30);
      stream.next_out = target + done;
      stream.avail_out = static_cast<uInt>(room);
      const int status = inflate(&stream, Z_NO_FLUSH);
      done += room - stream.avail_out;
      if (status == Z_STREAM_END) {
        start_next_member();
      } else if (status != Z_OK && status != Z_BUF_ERROR) {
        refuse_file(path, std::string("is damaged: ") +
                              (stream.msg ? stream.msg : "its compressed data is not valid") +
                              "; copy it again from where it came");
      }
    }
    return done;
  }
};

ByteSource::ByteSource(const std::filesystem::path& path,
                       Storage storage,
                       std::uint64_t first,
                       std::uint64_t count)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.path = path;
  s.storage = storage;
  const std::uint64_t size = size_of_regular_file(path);
  s.stored = first < size ? std::min(count, size - first) : 0;
  s.left = s.stored;
  s.file = std::fopen(path.c_str(), "rbe");
  if (!s.file) refuse_file(path, "cannot be opened: " + std::generic_category().message(errno));
  if (fseeko(s.file, static_cast<off_t>(std::min(first, size)), SEEK_SET) != 0)
    refuse_file(path, "cannot be read: " + std::generic_category().message(errno));
  if (storage == Storage::Raw) return;
  s.block.resize(kBlockBytes);
  // Window bits as zlib.h documents them: +16 gzip only, +32 zlib or gzip by the header.
  const int status = inflateInit2(&s.stream, 15 + (storage == Storage::Gzip ? 16 : 32));
  require(status == Z_OK, ErrorCode::Limit, "read", "zlib found no memory to start");
  s.is_inflating = true;
}

ByteSource::~ByteSource() = default;

std::size_t ByteSource::read(void* target, std::size_t count) {
  if (state_->storage == Storage::Raw) return state_->read_stored(target, count);
  return state_->inflate_some(static_cast<unsigned char*>(target), count);
}

void ByteSource::finish(std::uint64_t most) {
  if (state_->storage == Storage::Raw) return;
  std::vector<unsigned char> scratch(kBlockBytes);
  std::uint64_t surplus = 0;
  while (const std::size_t count = read(scratch.data(), scratch.size())) {
    surplus += count;
    if (surplus > most)
      refuse_file(state_->path, "holds more than " + std::to_string(most) +
                                    " bytes beyond the voxels its header declares; header and "
                                    "data do not belong together");
  }
}

std::uint64_t ByteSource::stored_bytes() const {
  return state_->stored;
}

std::string read_content(const std::filesystem::path& path) {
  ByteSource source(path, Storage::Raw);
  std::string content(source.stored_bytes(), '\0');
  content.resize(source.read(content.data(), content.size()));
  return content;
}

bool is_gzip(const std::filesystem::path& path) {
  ByteSource source(path, Storage::Raw);
  unsigned char magic[2] = {0, 0};
  return source.read(magic, 2) == 2 && magic[0] == 0x1f && magic[1] == 0x8b;
}

}  // namespace cvmesh::detail
