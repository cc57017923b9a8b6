// SPDX-License-Identifier: AGPL-3.0-or-later
#include "phantoms/write_nifti.h"

#include "cvmesh/core/error.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <system_error>
#include <vector>
#include <zlib.h>

namespace cvmesh::examples {
namespace {

constexpr char kStage[] = "write_nifti";
constexpr std::size_t kDataOffset = 352;  // a header of 348 bytes, no extensions
constexpr std::int16_t kUint8 = 2, kInt32 = 8;

/// A NIfTI-1 file image under construction; fields are set at the offsets of the standard.
class Bytes {
 public:
  explicit Bytes(std::size_t size) : bytes_(size, 0) {}

  template <typename T>
  void put(std::size_t offset, T value) {
    std::memcpy(bytes_.data() + offset, &value, sizeof value);  // little-endian hosts only
  }

  std::vector<unsigned char>& all() { return bytes_; }

 private:
  std::vector<unsigned char> bytes_;
};

Affine in_ras(const GridFrame& frame) {
  Affine map = frame.index_to_world;
  if (frame.space == Space::Lps) {
    for (const int r : {0, 1}) {
      map.rows[r] = -map.rows[r];
      map.offset[r] = -map.offset[r];
    }
  }
  return map;
}

Vec3 column(const Affine& map, int c) {
  return {map.rows[0][c], map.rows[1][c], map.rows[2][c]};
}

bool has_shear(const Affine& map) {
  constexpr double kTolerance = 1e-5;  // readers that check the axes use 1e-6 to 1e-4
  for (int c = 0; c < 3; ++c) {
    const Vec3 a = normalized(column(map, c)), b = normalized(column(map, (c + 1) % 3));
    if (std::abs(dot(a, b)) > kTolerance) return true;
  }
  return false;
}

// The q-form of a map without shear: quaternion (b, c, d) of its rotation, qfac the sign of its
// determinant, which flips the third axis (NIfTI-1 standard, method 2).
void put_q_form(Bytes& file, const Affine& map) {
  const double qfac = map.determinant() < 0 ? -1 : 1;
  const Vec3 x = normalized(column(map, 0)), y = normalized(column(map, 1)),
             z = qfac * normalized(column(map, 2));
  // Of the four components the largest is found from the diagonal, the others by division.
  const double squared[4] = {1 + x.x + y.y + z.z, 1 + x.x - y.y - z.z, 1 - x.x + y.y - z.z,
                             1 - x.x - y.y + z.z};
  const int largest = static_cast<int>(std::max_element(squared, squared + 4) - squared);
  const double s = 2 * std::sqrt(squared[largest]);
  double q[4] = {};
  switch (largest) {
    case 0:
      q[0] = s / 4, q[1] = (y.z - z.y) / s, q[2] = (z.x - x.z) / s, q[3] = (x.y - y.x) / s;
      break;
    case 1:
      q[0] = (y.z - z.y) / s, q[1] = s / 4, q[2] = (y.x + x.y) / s, q[3] = (z.x + x.z) / s;
      break;
    case 2:
      q[0] = (z.x - x.z) / s, q[1] = (y.x + x.y) / s, q[2] = s / 4, q[3] = (z.y + y.z) / s;
      break;
    default:
      q[0] = (x.y - y.x) / s, q[1] = (z.x + x.z) / s, q[2] = (z.y + y.z) / s, q[3] = s / 4;
  }
  const double sign = q[0] < 0 ? -1 : 1;  // the standard stores b, c, d of the one with a >= 0
  file.put<float>(76, static_cast<float>(qfac));
  file.put<std::int16_t>(252, 1);  // qform_code: scanner
  for (int n = 1; n < 4; ++n)
    file.put<float>(252 + 4 * n, static_cast<float>(sign * q[n]));
  for (int axis = 0; axis < 3; ++axis) {
    file.put<float>(268 + 4 * axis, static_cast<float>(map.offset[axis]));
  }
}

void put_header(Bytes& file, const GridFrame& frame, std::int16_t datatype) {
  file.put<std::int32_t>(0, 348);
  file.put<std::int16_t>(40, 3);
  for (int axis = 0; axis < 3; ++axis) {
    file.put<std::int16_t>(42 + 2 * axis, static_cast<std::int16_t>(frame.dims[axis]));
    file.put<float>(80 + 4 * axis, static_cast<float>(frame.spacing_mm[axis]));
  }
  for (int n = 4; n < 8; ++n)
    file.put<std::int16_t>(40 + 2 * n, 1);
  file.put<std::int16_t>(68, 1002);  // intent: label
  file.put<std::int16_t>(70, datatype);
  file.put<std::int16_t>(72, datatype == kUint8 ? 8 : 32);
  file.put<float>(76, 1);
  file.put<float>(108, static_cast<float>(kDataOffset));
  file.put<float>(112, 1);         // scl_slope
  file.put<std::uint8_t>(123, 2);  // units: mm
  const Affine map = in_ras(frame);
  if (!has_shear(map)) put_q_form(file, map);
  file.put<std::int16_t>(254, 1);  // sform_code: scanner
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      file.put<float>(280 + 16 * r + 4 * c, static_cast<float>(map.rows[r][c]));
    }
    file.put<float>(280 + 16 * r + 12, static_cast<float>(map.offset[r]));
  }
  std::memcpy(file.all().data() + 344, "n+1", 4);
}

bool write_plain(const std::vector<unsigned char>& bytes, const std::string& path) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  out.close();
  return !out.fail();
}

bool write_gzip(const std::vector<unsigned char>& bytes, const std::string& path) {
  const gzFile out = gzopen(path.c_str(), "wb6");  // stores no name and no time
  if (out == nullptr) return false;
  constexpr std::size_t kChunk = 1U << 24;
  bool ok = true;
  for (std::size_t at = 0; ok && at < bytes.size(); at += kChunk) {
    const auto length = static_cast<unsigned>(std::min(kChunk, bytes.size() - at));
    ok = gzwrite(out, bytes.data() + at, length) == static_cast<int>(length);
  }
  return gzclose(out) == Z_OK && ok;
}

}  // namespace

void write_nifti(const InputVolume& volume, const std::filesystem::path& path) {
  const GridFrame& frame = volume.frame;
  require(
      frame.space == Space::Ras || frame.space == Space::Lps, ErrorCode::BadInput, kStage,
      std::string("the frame's space is ") + space_name(frame.space) + "; NIfTI needs RAS or LPS");
  for (const int n : frame.dims) {
    require(n >= 1 && n <= 32767, ErrorCode::BadInput, kStage,
            std::to_string(n) + " voxels along an axis; NIfTI-1 takes 1 to 32767");
  }
  const auto [low, high] = std::minmax_element(volume.values.begin(), volume.values.end());
  const bool is_small = *low >= 0 && *high <= 255;
  const std::size_t bytes_each = is_small ? 1 : sizeof(Label);

  Bytes file(kDataOffset + volume.values.size() * bytes_each);
  put_header(file, frame, is_small ? kUint8 : kInt32);
  for (std::size_t n = 0; n < volume.values.size(); ++n) {
    if (is_small) {
      file.put<std::uint8_t>(kDataOffset + n, static_cast<std::uint8_t>(volume.values[n]));
    } else {
      file.put<Label>(kDataOffset + n * bytes_each, volume.values[n]);
    }
  }

  const std::string unfinished = path.string() + ".part";
  const bool is_written = path.extension() == ".gz" ? write_gzip(file.all(), unfinished)
                                                    : write_plain(file.all(), unfinished);
  std::error_code failure;
  if (is_written) std::filesystem::rename(unfinished, path, failure);
  if (!is_written || failure) {
    std::error_code ignored;
    std::filesystem::remove(unfinished, ignored);
    throw Error(ErrorCode::Output, kStage,
                "cannot write " + path.string() + "; check the folder and the space on the disk");
  }
}

}  // namespace cvmesh::examples
