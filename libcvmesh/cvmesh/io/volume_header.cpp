// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_header.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <system_error>
#include <utility>

namespace cvmesh::detail {
namespace {

constexpr long long kMaxAxis = 65'535;            // voxels along one axis
constexpr std::uint64_t kMaxVoxels = 1ULL << 34;  // 64 GiB of labels
constexpr double kIntegerTolerance = 1e-3;        // what resampling tools leave on a label
constexpr double kMinRelativeDeterminant = 1e-6;  // flatter axes than this span no volume
constexpr std::size_t kMaxFileName = 255;

template <typename T>
T load(const unsigned char* bytes, bool is_swapped) {
  unsigned char raw[sizeof(T)];
  std::memcpy(raw, bytes, sizeof(T));
  if (is_swapped) std::reverse(raw, raw + sizeof(T));
  return std::bit_cast<T>(raw);
}

std::string voxel_name(const GridFrame& frame, std::size_t index) {
  const std::size_t nx = static_cast<std::size_t>(frame.dims[0]);
  const std::size_t ny = static_cast<std::size_t>(frame.dims[1]);
  return "voxel (" + std::to_string(index % nx) + ", " + std::to_string(index / nx % ny) + ", " +
         std::to_string(index / nx / ny) + ")";
}

template <typename T>
void convert(const std::filesystem::path& path,
             const VolumeHeader& header,
             const unsigned char* data,
             std::size_t first,
             std::size_t count,
             Label* labels) {
  const auto refuse = [&](std::size_t i, T value, const std::string& why) {
    std::string text;
    if constexpr (std::is_floating_point_v<T>)
      text = number_text(static_cast<double>(value));
    else
      text = std::to_string(value);
    refuse_file(
        path, "has the value " + text + " at " + voxel_name(header.frame, first + i) + ", " + why);
  };
  constexpr long long lowest = std::numeric_limits<Label>::min();
  constexpr long long highest = std::numeric_limits<Label>::max();
  for (std::size_t i = 0; i < count; ++i) {
    const T value = load<T>(data + i * sizeof(T), header.is_swapped);
    if constexpr (std::is_floating_point_v<T>) {
      const double rounded = std::nearbyint(static_cast<double>(value));
      // Written so that NaN fails, too.
      if (!(std::abs(static_cast<double>(value) - rounded) <= kIntegerTolerance))
        refuse(i, value,
               "which is no integer (tolerance 0.001); give a label volume, not an intensity or "
               "probability image");
      if (rounded < static_cast<double>(lowest) || rounded > static_cast<double>(highest))
        refuse(i, value, "which is beyond 32-bit integers; renumber the labels");
      labels[i] = static_cast<Label>(rounded);
    } else {
      if (!std::in_range<Label>(value))
        refuse(i, value, "which is beyond 32-bit integers; renumber the labels");
      labels[i] = static_cast<Label>(value);
    }
  }
}

template <typename T>
void convert(const std::filesystem::path& path,
             const VolumeHeader& header,
             const unsigned char* data,
             std::size_t first,
             std::size_t count,
             float* values) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto stored = static_cast<double>(load<T>(data + i * sizeof(T), header.is_swapped));
    values[i] = static_cast<float>(header.slope * stored + header.intercept);
    if (!std::isfinite(values[i]))
      refuse_file(path, "has the value " + number_text(stored) + " at " +
                            voxel_name(header.frame, first + i) +
                            ", which is no finite number; replace it");
  }
}

/// Calls `convert` for the type of the file's voxels.
template <typename Value>
void convert_any(const std::filesystem::path& path,
                 const VolumeHeader& header,
                 const unsigned char* data,
                 std::size_t first,
                 std::size_t count,
                 Value* values) {
  const auto run = [&]<typename T>(T) { convert<T>(path, header, data, first, count, values); };
  switch (header.type) {
    case VoxelType::UInt8:
      return run(std::uint8_t{});
    case VoxelType::Int8:
      return run(std::int8_t{});
    case VoxelType::UInt16:
      return run(std::uint16_t{});
    case VoxelType::Int16:
      return run(std::int16_t{});
    case VoxelType::UInt32:
      return run(std::uint32_t{});
    case VoxelType::Int32:
      return run(std::int32_t{});
    case VoxelType::UInt64:
      return run(std::uint64_t{});
    case VoxelType::Int64:
      return run(std::int64_t{});
    case VoxelType::Float32:
      return run(float{});
    case VoxelType::Float64:
      return run(double{});
  }
}

}  // namespace

std::size_t voxel_bytes(VoxelType type) {
  switch (type) {
    case VoxelType::UInt8:
    case VoxelType::Int8:
      return 1;
    case VoxelType::UInt16:
    case VoxelType::Int16:
      return 2;
    case VoxelType::UInt32:
    case VoxelType::Int32:
    case VoxelType::Float32:
      return 4;
    case VoxelType::UInt64:
    case VoxelType::Int64:
    case VoxelType::Float64:
      break;
  }
  return 8;
}

CheckedDims checked_dims(const std::filesystem::path& path, const std::vector<long long>& sizes) {
  std::string all;
  for (const long long size : sizes)
    all += (all.empty() ? "" : " x ") + std::to_string(size);
  if (sizes.size() < 3)
    refuse_file(path, "is an image of " + std::to_string(sizes.size()) + " dimension(s) (" + all +
                          "); a label volume has 3");
  std::uint64_t product = 1;
  for (std::size_t axis = 0; axis < sizes.size(); ++axis) {
    if (sizes[axis] < 1)
      refuse_file(path, "declares the size " + all + ", but axis " + std::to_string(axis + 1) +
                            " must have at least 1 voxel; the header is damaged");
    if (axis >= 4 && sizes[axis] > 1)
      refuse_file(path, "is an image of " + std::to_string(sizes.size()) + " dimensions (" + all +
                            "); extract one 3-D volume from it");
    if (sizes[axis] > kMaxAxis)
      refuse_file(path, "declares the size " + all + ", but axis " + std::to_string(axis + 1) +
                            " exceeds " + std::to_string(kMaxAxis) +
                            " voxels; crop the volume or check the header");
    if (axis < 3) product *= static_cast<std::uint64_t>(sizes[axis]);  // below 2^48: no overflow
  }
  if (product > kMaxVoxels)
    refuse_file(path, "declares the size " + all + ", more than " + std::to_string(kMaxVoxels) +
                          " voxels; crop the volume or check the header");
  return {
      .dims = {static_cast<int>(sizes[0]), static_cast<int>(sizes[1]), static_cast<int>(sizes[2])},
      .volumes = sizes.size() > 3 ? static_cast<std::uint64_t>(sizes[3]) : 1};
}

GridFrame checked_frame(const std::filesystem::path& path,
                        const std::array<int, 3>& dims,
                        const Affine& index_to_world,
                        Space space) {
  GridFrame frame;
  frame.dims = dims;
  frame.index_to_world = index_to_world;
  frame.space = space;
  double product = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3& row = index_to_world.rows[static_cast<std::size_t>(axis)];
    for (const double x : {row.x, row.y, row.z, index_to_world.offset[axis]})
      if (!std::isfinite(x))
        refuse_file(path, "has " + number_text(x) +
                              " in its index-to-world matrix; repair the header's geometry");
    Vec3 unit{};
    unit[axis] = 1;
    frame.spacing_mm[axis] = norm(index_to_world.linear(unit));
    product *= frame.spacing_mm[axis];
  }
  const double relative = std::abs(index_to_world.determinant()) / product;
  if (!(product > 0) || !std::isfinite(product) || !(relative > kMinRelativeDeterminant))
    refuse_file(path, "has voxels of no volume: spacing " + number_text(frame.spacing_mm.x) +
                          " x " + number_text(frame.spacing_mm.y) + " x " +
                          number_text(frame.spacing_mm.z) +
                          " or axes in one plane; repair the header's geometry");
  return frame;
}

std::filesystem::path checked_sibling(const std::filesystem::path& header,
                                      const std::string& field,
                                      const std::string& name) {
  const std::string what = "has " + field + " = " + in_quotes(name);
  const bool is_list = name.rfind("LIST", 0) == 0 || name.find('%') != std::string::npos;
  if (is_list) refuse_file(header, what + ", a list of files; save the volume with one data file");
  const bool is_plain = !name.empty() && name.size() <= kMaxFileName && name[0] != '.' &&
                        name.find_first_of(std::string_view("/\\\0", 3)) == std::string::npos;
  if (!is_plain)
    refuse_file(header, what + "; only a plain file name in the header's own folder is followed");
  const std::filesystem::path file = header.parent_path() / name;
  std::error_code code;
  if (!std::filesystem::is_regular_file(file, code))
    refuse_file(header, what + ", but there is no such file beside it; keep the two together");
  if (std::filesystem::is_symlink(file, code))
    refuse_file(header, what + ", a link, which may lead anywhere; copy the file itself there");
  if (std::filesystem::equivalent(file, header, code))
    refuse_file(header, what + ", its own name; the header's text is no voxels");
  return file;
}

void convert_voxels(const std::filesystem::path& path,
                    const VolumeHeader& header,
                    const unsigned char* data,
                    std::size_t first,
                    std::size_t count,
                    Label* labels) {
  convert_any(path, header, data, first, count, labels);
}

void convert_voxels(const std::filesystem::path& path,
                    const VolumeHeader& header,
                    const unsigned char* data,
                    std::size_t first,
                    std::size_t count,
                    float* values) {
  convert_any(path, header, data, first, count, values);
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n\v\f";
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

std::string lower_case(std::string_view text) {
  std::string result(text);
  for (char& c : result)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return result;
}

std::vector<std::string> split_words(std::string_view text) {
  std::vector<std::string> words;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    const std::size_t end = std::min(text.find_first_of(" \t\r\n\v\f"), text.size());
    words.emplace_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return words;
}

namespace {

template <typename T>
std::vector<T> parse_all(const std::filesystem::path& path,
                         const std::string& field,
                         std::string_view text,
                         const char* kind) {
  std::vector<T> values;
  for (const std::string& word : split_words(text)) {
    const char* begin = word.data() + (word[0] == '+' ? 1 : 0);
    T value{};
    const auto [end, code] = std::from_chars(begin, word.data() + word.size(), value);
    if (code != std::errc{} || end != word.data() + word.size())
      refuse_file(path, "has " + in_quotes(word) + " in the field '" + field + "', which is no " +
                            kind + "; the header is damaged");
    values.push_back(value);
  }
  return values;
}

}  // namespace

std::vector<double> parse_numbers(const std::filesystem::path& path,
                                  const std::string& field,
                                  std::string_view text) {
  return parse_all<double>(path, field, text, "number");
}

std::vector<long long> parse_integers(const std::filesystem::path& path,
                                      const std::string& field,
                                      std::string_view text) {
  return parse_all<long long>(path, field, text, "integer in 64 bits");
}

std::string in_quotes(std::string_view value) {
  constexpr std::size_t kLongest = 60;
  std::string text(value.substr(0, kLongest));
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return "\"" + text + (value.size() > kLongest ? "...\"" : "\"");
}

std::string number_text(double value) {
  char text[32];
  const auto result = std::to_chars(text, text + sizeof text, value);
  return std::string(text, result.ptr);
}

}  // namespace cvmesh::detail
