// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/io/byte_source.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

// What the three header parsers (nifti, meta, nrrd) have in common. Private to io.
namespace cvmesh::detail {

enum class VoxelType {
  UInt8,
  Int8,
  UInt16,
  Int16,
  UInt32,
  Int32,
  UInt64,
  Int64,
  Float32,
  Float64,
};

std::size_t voxel_bytes(VoxelType type);

/// What a header says, checked.
struct VolumeHeader {
  GridFrame frame;
  std::uint64_t volumes = 1;  ///< one after the other, each of the frame's size
  VoxelType type = VoxelType::UInt8;
  bool is_swapped = false;                ///< bytes are in the other order than this machine's
  std::filesystem::path data_file;        ///< where the voxels are: the file itself or a sibling
  std::uint64_t data_begin = 0;           ///< first byte of the voxels as stored
  std::uint64_t data_count = UINT64_MAX;  ///< bytes as stored, where the header tells
  Storage storage = Storage::Raw;
  double slope = 1, intercept = 0;  ///< value = slope * stored + intercept
  std::vector<std::string> warnings;

  [[nodiscard]] std::uint64_t voxel_data_bytes() const {
    return std::uint64_t{frame.size()} * voxel_bytes(type);
  }
};

VolumeHeader parse_nifti_header(const std::filesystem::path& path);
VolumeHeader parse_meta_header(const std::filesystem::path& path);
VolumeHeader parse_nrrd_header(const std::filesystem::path& path);

/// The sizes of an image: three dimensions, and how many volumes of them a fourth one holds.
struct CheckedDims {
  std::array<int, 3> dims{0, 0, 0};
  std::uint64_t volumes = 1;
};

/// Trailing ones beyond the third dimension are dropped.
/// @throws Error BadInput for fewer than three, more than four, or sizes out of bounds
CheckedDims checked_dims(const std::filesystem::path& path, const std::vector<long long>& sizes);

/// A frame with this affine; spacings are its column norms.
/// @throws Error BadInput when a number is not finite or the axes span no volume
GridFrame checked_frame(const std::filesystem::path& path,
                        const std::array<int, 3>& dims,
                        const Affine& index_to_world,
                        Space space);

/// `folder(header) / name` for a plain sibling of the header file.
/// @throws Error BadInput for lists, patterns, absolute paths, other folders, and missing files
std::filesystem::path checked_sibling(const std::filesystem::path& header,
                                      const std::string& field,
                                      const std::string& name);

/// Turns voxels into labels, `count` of them, the first being voxel `first` of `frame`.
/// @throws Error BadInput for values that are no labels
void convert_voxels(const std::filesystem::path& path,
                    const VolumeHeader& header,
                    const unsigned char* data,
                    std::size_t first,
                    std::size_t count,
                    Label* labels);
/// The same for the values of any image, scaled as the header says.
/// @throws Error BadInput for values that are not finite
void convert_voxels(const std::filesystem::path& path,
                    const VolumeHeader& header,
                    const unsigned char* data,
                    std::size_t first,
                    std::size_t count,
                    float* values);

/// Text helpers of the two text headers.
std::string_view trimmed(std::string_view text);
std::string lower_case(std::string_view text);
std::vector<std::string> split_words(std::string_view text);
/// The numbers in `text`, separated by blanks.
/// @throws Error BadInput naming the field when one is no number
std::vector<double> parse_numbers(const std::filesystem::path& path,
                                  const std::string& field,
                                  std::string_view text);
std::vector<long long> parse_integers(const std::filesystem::path& path,
                                      const std::string& field,
                                      std::string_view text);

/// `value` for a message: quoted, control characters replaced, at most 60 characters.
std::string in_quotes(std::string_view value);
/// Shortest decimal text of a number for a message.
std::string number_text(double value);

}  // namespace cvmesh::detail
