// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

/// Image files made byte by byte, good ones and bad ones.
namespace cvmesh::image_files {

void write_file(const std::filesystem::path& path, const std::string& bytes);
std::string read_file(const std::filesystem::path& path);
std::string gzip(const std::string& bytes);
std::string zlib(const std::string& bytes);

/// The bytes of `value`, in the machine's order or the other.
template <typename T>
std::string bytes_of(T value, bool is_swapped = false) {
  std::string raw(sizeof(T), '\0');
  std::memcpy(raw.data(), &value, sizeof(T));
  return is_swapped ? std::string(raw.rbegin(), raw.rend()) : raw;
}

template <typename T>
std::string bytes_of_all(const std::vector<T>& values, bool is_swapped = false) {
  std::string raw;
  for (const T& value : values)
    raw += bytes_of(value, is_swapped);
  return raw;
}

/// A NIfTI file; the defaults are a 4 x 3 x 2 image of bytes with an s-form of unit voxels.
struct Nifti {
  int version = 1;
  bool is_swapped = false;
  std::vector<std::int64_t> dim{3, 4, 3, 2, 1, 1, 1, 1};
  std::array<double, 8> pixdim{1, 1, 1, 1, 1, 1, 1, 1};
  int datatype = 2;
  double slope = 1, intercept = 0;
  double data_begin = -1;  ///< -1: right after the header
  int units = 2;
  int qform_code = 0, sform_code = 1;
  std::array<double, 3> quaternion{0, 0, 0}, q_offset{0, 0, 0};
  Affine s_form;
  std::string magic;  ///< empty: the right one
  std::string extension = std::string(4, '\0');
  std::string voxels = std::string(24, '\1');

  [[nodiscard]] std::string bytes() const;
};

/// The labels 0, 1, 2, ... of a 4 x 3 x 2 volume as bytes, and as other types.
template <typename T>
std::vector<T> counting(std::size_t count = 24) {
  std::vector<T> values(count);
  for (std::size_t i = 0; i < count; ++i)
    values[i] = static_cast<T>(i);
  return values;
}

/// A MetaImage header for a 4 x 3 x 2 image of bytes; `lines` replace or add fields.
std::string meta_header(const std::vector<std::pair<std::string, std::string>>& fields = {},
                        const std::string& data_file = "LOCAL");
/// An NRRD header for a 4 x 3 x 2 image of bytes, with the empty line that ends it.
std::string nrrd_header(const std::vector<std::pair<std::string, std::string>>& fields = {});

/// Output of `/usr/bin/python3 script arguments`, both streams; `ok` tells exit code 0.
struct PythonRun {
  bool ok = false;
  std::string output;
};

PythonRun run_python(const std::filesystem::path& folder,
                     const std::string& script,
                     const std::string& arguments);
bool python_has(const std::string& module);

}  // namespace cvmesh::image_files
