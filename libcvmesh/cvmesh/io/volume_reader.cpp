// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_reader.h"

#include "cvmesh/core/error.h"
#include "cvmesh/grid/shear.h"
#include "cvmesh/io/itk_volume_io.h"
#include "cvmesh/io/volume_header.h"

#include <algorithm>
#include <array>
#include <cmath>
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
  const std::uint64_t wanted = header.volumes * header.voxel_data_bytes();
  std::uint64_t most = source.stored_bytes();
  if (header.data_count != UINT64_MAX && most < header.data_count)
    refuse_truncated(header.data_file, header.data_count, most);
  if (header.storage != Storage::Raw) most *= detail::kMaxDeflateRatio;
  if (most < wanted) refuse_truncated(header.data_file, wanted, most);
}

// Calls `use(bytes, first voxel, count)` on the voxels of one volume, block by block.
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
}

// Reads over bytes that somebody else wants.
void skip(ByteSource& source, const VolumeHeader& header, std::uint64_t count) {
  std::vector<unsigned char> skipped(std::size_t{1} << 16);
  while (count > 0) {
    const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(count, skipped.size()));
    if (source.read(skipped.data(), part) < part)
      refuse_truncated(header.data_file, header.volumes * header.voxel_data_bytes(), 0);
    count -= part;
  }
}

// The voxels of one of the header's volumes, by our own code alone; `first` bytes, as they are once
// inflated, lie before the first volume.
template <typename Value>
Grid<Value> read_plain(const std::filesystem::path& path,
                       const VolumeHeader& header,
                       ByteSource& source,
                       std::uint64_t first,
                       std::uint64_t chosen) {
  check_declared_size(header, source);
  skip(source, header, first + chosen * header.voxel_data_bytes());
  Grid<Value> volume(header.frame);
  for_each_block(
      source, header, [&](const unsigned char* bytes, std::size_t begin, std::size_t count) {
        detail::convert_voxels(path, header, bytes, begin, count, volume.values.data() + begin);
      });
  skip(source, header, (header.volumes - 1 - chosen) * header.voxel_data_bytes());
  source.finish(kMostSurplus);
  return volume;
}

template <typename Value>
Grid<Value> read_nifti(const std::filesystem::path& path,
                       const VolumeHeader& header,
                       std::uint64_t chosen) {
  // Compressed data is one stream, header included; the header is read over.
  const bool is_packed = header.storage != Storage::Raw;
  ByteSource source(path, header.storage, is_packed ? 0 : header.data_begin);
  return read_plain<Value>(path, header, source, is_packed ? header.data_begin : 0, chosen);
}

// ITK reads whole files only; one volume of several is read as NIfTI is.
template <typename Value>
Grid<Value> read_one_of_several(const std::filesystem::path& path,
                                const VolumeHeader& header,
                                std::uint64_t chosen) {
  ByteSource source(header.data_file, header.storage, header.data_begin, header.data_count);
  return read_plain<Value>(path, header, source, 0, chosen);
}

template <typename Value>
Grid<Value> read_by_itk(const std::filesystem::path& path,
                        const VolumeHeader& header,
                        detail::ItkFormat format) {
  {
    ByteSource source(header.data_file, header.storage, header.data_begin, header.data_count);
    check_declared_size(header, source);
    if (header.storage != Storage::Raw) {
      for_each_block(source, header, [](const unsigned char*, std::size_t, std::size_t) {});
      source.finish(kMostSurplus);
    }
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
                        Format format,
                        std::uint64_t chosen) {
  try {
    if (header.volumes > 1 && format != Format::Nifti)
      return read_one_of_several<Value>(path, header, chosen);
    switch (format) {
      case Format::Nifti:
        return read_nifti<Value>(path, header, chosen);
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

// The volume to read, from 0.
std::uint64_t chosen_volume(const std::filesystem::path& path,
                            const VolumeHeader& header,
                            const ReadVolumeOptions& options) {
  const auto& [nx, ny, nz] = header.frame.dims;
  if (!options.volume && header.volumes > 1)
    refuse_file(path, "is an image of 4 dimensions (" + std::to_string(nx) + " x " +
                          std::to_string(ny) + " x " + std::to_string(nz) + " x " +
                          std::to_string(header.volumes) +
                          "); choose one of its volumes by --volume, 0 to " +
                          std::to_string(header.volumes - 1));
  const int chosen = options.volume.value_or(0);
  if (chosen < 0 || static_cast<std::uint64_t>(chosen) >= header.volumes)
    refuse_file(path, "has no volume " + std::to_string(chosen) + "; choose 0 to " +
                          std::to_string(header.volumes - 1));
  return static_cast<std::uint64_t>(chosen);
}

void check_allowed(const std::filesystem::path& path,
                   const VolumeHeader& header,
                   const ReadVolumeOptions& options) {
  if (!options.allow_detached && header.data_file != path)
    refuse_file(path, "keeps its voxels in another file, " +
                          detail::in_quotes(header.data_file.filename().string()) +
                          "; save both as one .mha or .nrrd file, or allow it by "
                          "--allow-detached");
  const double shear = shear_of(header.frame.index_to_world);
  if (!options.allow_shear && shear > kMostShear)
    refuse_file(path, "has sheared axes: two of them are " + detail::number_text(shear) +
                          " off a right angle (as a cosine; at most " +
                          detail::number_text(kMostShear) +
                          "); resample it to a straight grid, or accept sizes and shapes of the "
                          "unsheared grid by --allow-shear");
}

}  // namespace

InputVolume read_label_volume(const std::filesystem::path& path,
                              std::vector<std::string>* warnings,
                              const ReadVolumeOptions& options) {
  const Format format = format_of(path);
  const VolumeHeader header = parse_header(path, format);
  if (header.slope != 1 || header.intercept != 0)
    refuse_file(path, "scales its voxels (scl_slope " + detail::number_text(header.slope) +
                          ", scl_inter " + detail::number_text(header.intercept) +
                          "), which labels never need; save it with slope 1 and intercept 0");
  check_allowed(path, header, options);
  const std::uint64_t chosen = chosen_volume(path, header, options);
  if (warnings) warnings->insert(warnings->end(), header.warnings.begin(), header.warnings.end());
  return read_volume<Label>(path, header, format, chosen);
}

std::vector<std::filesystem::path> volume_files(const std::filesystem::path& path) {
  const VolumeHeader header = parse_header(path, format_of(path));
  std::vector<std::filesystem::path> files = {path};
  if (header.data_file != path) files.push_back(header.data_file);
  return files;
}

Grid<float> read_image(const std::filesystem::path& path,
                       std::vector<std::string>* warnings,
                       const ReadVolumeOptions& options) {
  const Format format = format_of(path);
  const VolumeHeader header = parse_header(path, format);
  check_allowed(path, header, options);
  const std::uint64_t chosen = chosen_volume(path, header, options);
  if (warnings) warnings->insert(warnings->end(), header.warnings.begin(), header.warnings.end());
  return read_volume<float>(path, header, format, chosen);
}

}  // namespace cvmesh
