// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_header.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

// The NIfTI-1 and NIfTI-2 headers [Cox 2004], field by field at their documented byte offsets.
namespace cvmesh::detail {
namespace {

constexpr std::size_t kHeader1 = 348, kHeader2 = 540;
constexpr double kMillimetresPerMetre = 1e3, kMillimetresPerMicron = 1e-3;
constexpr double kFormTolerance = 1e-3;  // in voxels, at the corners of the volume

struct Fields {
  std::vector<long long> dim;  // dim[0..7]
  std::vector<double> pixdim;  // pixdim[0..7]
  int datatype = 0, qform_code = 0, sform_code = 0, units = 0;
  double slope = 0, intercept = 0, data_begin = 0;
  double quaternion[3] = {0, 0, 0}, q_offset[3] = {0, 0, 0};
  double s_rows[3][4] = {};
  std::string magic;
  bool is_version_2 = false, is_swapped = false;
};

class HeaderBytes {
 public:
  explicit HeaderBytes(const std::filesystem::path& path, Storage storage) : path_(path) {
    ByteSource source(path, storage);
    bytes_.resize(kHeader2);
    bytes_.resize(source.read(bytes_.data(), bytes_.size()));
    const auto is_size = [&](std::int32_t size) {
      return size == static_cast<std::int32_t>(kHeader1) ||
             size == static_cast<std::int32_t>(kHeader2);
    };
    const std::string no_nifti =
        "is no NIfTI file (its first number is not 348 or 540); check the file";
    if (bytes_.size() < kHeader1) refuse_file(path, no_nifti);
    is_swapped_ = !is_size(get<std::int32_t>(0));
    const auto size = get<std::int32_t>(0);
    if (!is_size(size) || bytes_.size() < static_cast<std::size_t>(size))
      refuse_file(path, no_nifti);
    is_version_2_ = size == static_cast<std::int32_t>(kHeader2);
  }

  template <typename T>
  [[nodiscard]] T get(std::size_t offset) const {
    unsigned char raw[sizeof(T)];
    std::memcpy(raw, bytes_.data() + offset, sizeof(T));
    if (is_swapped_) std::reverse(raw, raw + sizeof(T));
    return std::bit_cast<T>(raw);
  }

  [[nodiscard]] Fields fields() const { return is_version_2_ ? version_2() : version_1(); }

 private:
  [[nodiscard]] Fields version_1() const {
    Fields f;
    f.is_swapped = is_swapped_;
    for (std::size_t i = 0; i < 8; ++i) {
      f.dim.push_back(get<std::int16_t>(40 + 2 * i));
      f.pixdim.push_back(get<float>(76 + 4 * i));
    }
    f.datatype = get<std::int16_t>(70);
    f.data_begin = get<float>(108);
    f.slope = get<float>(112);
    f.intercept = get<float>(116);
    f.units = get<std::uint8_t>(123);
    f.qform_code = get<std::int16_t>(252);
    f.sform_code = get<std::int16_t>(254);
    for (std::size_t i = 0; i < 3; ++i) {
      f.quaternion[i] = get<float>(256 + 4 * i);
      f.q_offset[i] = get<float>(268 + 4 * i);
      for (std::size_t j = 0; j < 4; ++j)
        f.s_rows[i][j] = get<float>(280 + 16 * i + 4 * j);
    }
    f.magic.assign(reinterpret_cast<const char*>(bytes_.data()) + 344, 4);
    return f;
  }

  [[nodiscard]] Fields version_2() const {
    Fields f;
    f.is_version_2 = true;
    f.is_swapped = is_swapped_;
    for (std::size_t i = 0; i < 8; ++i) {
      f.dim.push_back(get<std::int64_t>(16 + 8 * i));
      f.pixdim.push_back(get<double>(104 + 8 * i));
    }
    f.datatype = get<std::int16_t>(12);
    f.data_begin = static_cast<double>(get<std::int64_t>(168));
    f.slope = get<double>(176);
    f.intercept = get<double>(184);
    f.units = get<std::int32_t>(500);
    f.qform_code = get<std::int32_t>(344);
    f.sform_code = get<std::int32_t>(348);
    for (std::size_t i = 0; i < 3; ++i) {
      f.quaternion[i] = get<double>(352 + 8 * i);
      f.q_offset[i] = get<double>(376 + 8 * i);
      for (std::size_t j = 0; j < 4; ++j)
        f.s_rows[i][j] = get<double>(400 + 32 * i + 8 * j);
    }
    f.magic.assign(reinterpret_cast<const char*>(bytes_.data()) + 4, 4);
    return f;
  }

  std::filesystem::path path_;
  std::vector<unsigned char> bytes_;
  bool is_swapped_ = false, is_version_2_ = false;
};

VoxelType voxel_type(const std::filesystem::path& path, int datatype) {
  switch (datatype) {
    case 2:
      return VoxelType::UInt8;
    case 4:
      return VoxelType::Int16;
    case 8:
      return VoxelType::Int32;
    case 16:
      return VoxelType::Float32;
    case 64:
      return VoxelType::Float64;
    case 256:
      return VoxelType::Int8;
    case 512:
      return VoxelType::UInt16;
    case 768:
      return VoxelType::UInt32;
    case 1024:
      return VoxelType::Int64;
    case 1280:
      return VoxelType::UInt64;
    case 128:
    case 2304:
      refuse_file(path, "has colour voxels (datatype " + std::to_string(datatype) +
                            "); a label volume has one integer per voxel");
    case 32:
    case 1792:
    case 2048:
      refuse_file(path, "has complex voxels (datatype " + std::to_string(datatype) +
                            "); a label volume has one integer per voxel");
    default:
      break;
  }
  refuse_file(path, "has the voxel datatype " + std::to_string(datatype) +
                        ", which is not supported; save the labels as integers of 8 to 64 bits");
}

// "Method 2" of the standard: a rotation from a unit quaternion whose real part is implied.
Affine q_form(const Fields& f) {
  double b = f.quaternion[0], c = f.quaternion[1], d = f.quaternion[2];
  double a = 1 - (b * b + c * c + d * d);
  if (a < 1e-7) {  // a half turn, up to rounding: the standard's own threshold and remedy
    const double scale = 1 / std::sqrt(b * b + c * c + d * d);
    b *= scale;
    c *= scale;
    d *= scale;
    a = 0;
  } else {
    a = std::sqrt(a);
  }
  const double flip = f.pixdim[0] < 0 ? -1 : 1;
  const Vec3 size{std::abs(f.pixdim[1]), std::abs(f.pixdim[2]), std::abs(f.pixdim[3]) * flip};
  Affine map;
  map.rows[0] = {a * a + b * b - c * c - d * d, 2 * b * c - 2 * a * d, 2 * b * d + 2 * a * c};
  map.rows[1] = {2 * b * c + 2 * a * d, a * a + c * c - b * b - d * d, 2 * c * d - 2 * a * b};
  map.rows[2] = {2 * b * d - 2 * a * c, 2 * c * d + 2 * a * b, a * a + d * d - c * c - b * b};
  for (Vec3& row : map.rows)
    row = scaled_by(row, size);
  map.offset = {f.q_offset[0], f.q_offset[1], f.q_offset[2]};
  return map;
}

Affine s_form(const Fields& f) {
  Affine map;
  for (int i = 0; i < 3; ++i) {
    map.rows[static_cast<std::size_t>(i)] = {f.s_rows[i][0], f.s_rows[i][1], f.s_rows[i][2]};
    map.offset[i] = f.s_rows[i][3];
  }
  return map;
}

Affine pixdim_scaling(const Fields& f) {
  Affine map;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 row{};
    row[axis] = std::abs(f.pixdim[static_cast<std::size_t>(axis) + 1]);
    map.rows[static_cast<std::size_t>(axis)] = row;
  }
  return map;
}

// Largest distance between the images of the volume's corners, in voxels of `a`.
double disagreement_vox(const Affine& a, const Affine& b, const std::array<int, 3>& dims) {
  double largest = 0, voxel = INFINITY;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 unit{};
    unit[axis] = 1;
    voxel = std::min(voxel, norm(a.linear(unit)));
  }
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 p{corner & 1 ? dims[0] - 1.0 : 0, corner & 2 ? dims[1] - 1.0 : 0,
                 corner & 4 ? dims[2] - 1.0 : 0};
    largest = std::max(largest, distance(a(p), b(p)));
  }
  return largest / voxel;
}

Affine index_to_world(const Fields& f,
                      const std::array<int, 3>& dims,
                      std::vector<std::string>& warnings) {
  if (f.sform_code > 0) {
    const Affine map = s_form(f);
    // Written so that a q-form with NaN counts as different.
    if (f.qform_code > 0 && !(disagreement_vox(map, q_form(f), dims) <= kFormTolerance))
      warnings.push_back(
          "the s-form and the q-form of the NIfTI header place the volume differently; the s-form "
          "is used");
    return map;
  }
  if (f.qform_code > 0) return q_form(f);
  warnings.push_back(
      "the NIfTI header stores no orientation (s-form and q-form codes are 0); voxel sizes alone "
      "are used");
  return pixdim_scaling(f);
}

double millimetres_per_unit(const Fields& f, std::vector<std::string>& warnings) {
  const int spatial = f.units & 7;
  if (spatial != 1 && spatial != 3) return 1;
  warnings.push_back(std::string("the NIfTI header's coordinates are in ") +
                     (spatial == 1 ? "metres" : "microns") + "; they are turned into millimetres");
  return spatial == 1 ? kMillimetresPerMetre : kMillimetresPerMicron;
}

void read_scaling(const Fields& f, VolumeHeader& header) {
  // The standard: a slope of 0 (or, by all readers, NaN) means that there is no scaling.
  if (f.slope == 0 || !std::isfinite(f.slope)) return;
  header.slope = f.slope;
  header.intercept = f.intercept;
}

}  // namespace

VolumeHeader parse_nifti_header(const std::filesystem::path& path) {
  VolumeHeader header;
  header.storage = is_gzip(path) ? Storage::Gzip : Storage::Raw;
  header.data_file = path;
  const Fields f = HeaderBytes(path, header.storage).fields();
  const std::string magic = f.is_version_2 ? "n+2" : "n+1";
  if (f.magic.compare(0, 3, magic) != 0 || f.magic[3] != '\0')
    refuse_file(path, "is no single-file NIfTI image (its magic is " +
                          in_quotes(f.magic.substr(0, f.magic.find('\0'))) + ", not \"" + magic +
                          "\"); convert it to .nii or .nii.gz");
  if (f.dim[0] < 1 || f.dim[0] > 7)
    refuse_file(path, "declares " + std::to_string(f.dim[0]) +
                          " dimensions; NIfTI has 1 to 7; the header is damaged");
  const auto [dims, volumes] =
      checked_dims(path, {f.dim.begin() + 1, f.dim.begin() + 1 + f.dim[0]});
  header.volumes = volumes;
  header.type = voxel_type(path, f.datatype);
  header.is_swapped = f.is_swapped;
  read_scaling(f, header);

  // Writers that leave the offset at 0 mean the first place where voxels may be.
  const double earliest = f.is_version_2 ? 544 : 352;
  const double begin = f.data_begin == 0 ? earliest : f.data_begin;
  if (!(begin >= earliest && begin <= 1e15) || begin != std::floor(begin))
    refuse_file(path, "declares that its voxels start at byte " + number_text(f.data_begin) +
                          ", not after its header (" + number_text(earliest) +
                          " or more); the header is damaged");
  header.data_begin = static_cast<std::uint64_t>(begin);

  Affine map = index_to_world(f, dims, header.warnings);
  const double unit = millimetres_per_unit(f, header.warnings);
  for (Vec3& row : map.rows)
    row *= unit;
  map.offset *= unit;
  header.frame = checked_frame(path, dims, map, Space::Ras);
  return header;
}

}  // namespace cvmesh::detail
