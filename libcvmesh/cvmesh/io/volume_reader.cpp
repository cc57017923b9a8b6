// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_reader.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/itk_volume_io.h"
#include "cvmesh/io/volume_header.h"

#include <algorithm>
#include <new>

namespace cvmesh {
namespace {

using detail::ByteSource;
using detail::refuse_file;
using detail::Storage;
using detail::VolumeHeader;

constexpr std::size_t kBlockVoxels = std::size_t{1} << 20;
// What writers append after the voxels (padding, a stray extension) stays far below this.
constexpr std::uint64_t kMostSurplus = 1 << 20;

enum class Format { Nifti, Meta, Nrrd };

Format format_of(const std::filesystem::path& path) {
  const std::string name = detail::lower_case(path.filename().string());
  const auto ends_with = [&](std::string_view end) {
    return name.size() > end.size() && name.ends_with(end);
  };
  if (ends_with(".nii") || ends_with(".nii.gz")) return Format::Nifti;
  if (ends_with(".mha") || ends_with(".mhd")) return Format::Meta;
  if (ends_with(".nrrd")) return Format::Nrrd;
  refuse_file(path, "has no known extension; give a .nii, .nii.gz, .mha, .mhd or .nrrd file");
}

VolumeHeader parse_header(const std::filesystem::path& path, Format format) {
  switch (format) {
    case Format::Nifti:
      return detail::parse_nifti_header(path);
    case Format::Meta:
      return detail::parse_meta_header(path);
    case Format::Nrrd:
      break;
  }
  return detail::parse_nrrd_header(path);
}

[[noreturn]] void refuse_truncated(const std::filesystem::path& path,
                                   std::uint64_t wanted,
                                   std::uint64_t found) {
  refuse_file(path, "is cut short: its header declares " + std::to_string(wanted) +
                        " bytes of voxels, but there are only " + std::to_string(found) +
                        "; copy it again from where it came");
}

// Before memory is asked for: a header of a few bytes can declare any size.
void check_declared_size(const VolumeHeader& header, const ByteSource& source) {
  const std::uint64_t wanted = header.voxel_data_bytes();
  std::uint64_t most = source.stored_bytes();
  if (header.data_count != UINT64_MAX && most < header.data_count)
    refuse_truncated(header.data_file, header.data_count, most);
  if (header.storage != Storage::Raw) most *= detail::kMaxDeflateRatio;
  if (most < wanted) refuse_truncated(header.data_file, wanted, most);
}

// Calls `use(bytes, first voxel, count)` on the voxels, block by block, and then verifies what
// follows them.
template <typename Use>
void for_each_block(ByteSource& source, const VolumeHeader& header, const Use& use) {
  const std::size_t size = detail::voxel_bytes(header.type);
  const std::size_t total = header.frame.size();
  std::vector<unsigned char> block(std::min(total, kBlockVoxels) * size);
  for (std::size_t first = 0; first < total; first += kBlockVoxels) {
    const std::size_t count = std::min(kBlockVoxels, total - first);
    const std::size_t got = source.read(block.data(), count * size);
    if (got < count * size)
      refuse_truncated(header.data_file, header.voxel_data_bytes(), first * size + got);
    use(block.data(), first, count);
  }
  source.finish(kMostSurplus);
}

template <typename Value>
Grid<Value> read_nifti(const std::filesystem::path& path, const VolumeHeader& header) {
  // Compressed data is one stream, header included; the header is read over.
  const bool is_packed = header.storage != Storage::Raw;
  ByteSource source(path, header.storage, is_packed ? 0 : header.data_begin);
  check_declared_size(header, source);
  std::vector<unsigned char> skipped(std::size_t{1} << 16);
  for (std::uint64_t left = is_packed ? header.data_begin : 0; left > 0;) {
    const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(left, skipped.size()));
    if (source.read(skipped.data(), part) < part)
      refuse_truncated(path, header.voxel_data_bytes(), 0);
    left -= part;
  }
  Grid<Value> volume(header.frame);
  for_each_block(
      source, header, [&](const unsigned char* bytes, std::size_t first, std::size_t count) {
        detail::convert_voxels(path, header, bytes, first, count, volume.values.data() + first);
      });
  return volume;
}

template <typename Value>
Grid<Value> read_by_itk(const std::filesystem::path& path,
                        const VolumeHeader& header,
                        detail::ItkFormat format) {
  {
    ByteSource source(header.data_file, header.storage, header.data_begin, header.data_count);
    check_declared_size(header, source);
    if (header.storage != Storage::Raw)
      for_each_block(source, header, [](const unsigned char*, std::size_t, std::size_t) {});
  }
  const std::vector<unsigned char> voxels = detail::read_voxels_by_itk(path, header, format);
  VolumeHeader native = header;
  native.is_swapped = false;
  Grid<Value> volume(header.frame);
  detail::convert_voxels(path, native, voxels.data(), 0, volume.values.size(),
                         volume.values.data());
  return volume;
}

template <typename Value>
Grid<Value> read_volume(const std::filesystem::path& path,
                        const VolumeHeader& header,
                        Format format) {
  try {
    switch (format) {
      case Format::Nifti:
        return read_nifti<Value>(path, header);
      case Format::Meta:
        return read_by_itk<Value>(path, header, detail::ItkFormat::Meta);
      case Format::Nrrd:
        break;
    }
    return read_by_itk<Value>(path, header, detail::ItkFormat::Nrrd);
  } catch (const std::bad_alloc&) {
    throw Error(ErrorCode::Limit, "read",
                "'" + path.string() + "' has " + std::to_string(header.frame.size()) +
                    " voxels, for which there is not enough memory; crop or resample it");
  }
}

}  // namespace

InputVolume read_label_volume(const std::filesystem::path& path,
                              std::vector<std::string>* warnings) {
  const Format format = format_of(path);
  const VolumeHeader header = parse_header(path, format);
  if (header.slope != 1 || header.intercept != 0)
    refuse_file(path, "scales its voxels (scl_slope " + detail::number_text(header.slope) +
                          ", scl_inter " + detail::number_text(header.intercept) +
                          "), which labels never need; save it with slope 1 and intercept 0");
  if (warnings) warnings->insert(warnings->end(), header.warnings.begin(), header.warnings.end());
  return read_volume<Label>(path, header, format);
}

std::vector<std::filesystem::path> volume_files(const std::filesystem::path& path) {
  const VolumeHeader header = parse_header(path, format_of(path));
  std::vector<std::filesystem::path> files = {path};
  if (header.data_file != path) files.push_back(header.data_file);
  return files;
}

Grid<float> read_image(const std::filesystem::path& path, std::vector<std::string>* warnings) {
  const Format format = format_of(path);
  const VolumeHeader header = parse_header(path, format);
  if (warnings) warnings->insert(warnings->end(), header.warnings.begin(), header.warnings.end());
  return read_volume<float>(path, header, format);
}

}  // namespace cvmesh
