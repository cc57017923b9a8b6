// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_header.h"

#include <bit>
#include <map>

// The text header of MetaImage. MetaIO 5.2 writes past its own arrays on hostile headers, so
// lengths and counts are bounded here before it sees a file.
namespace cvmesh::detail {
namespace {

constexpr std::size_t kMaxHeader = std::size_t{1} << 16;
constexpr std::size_t kMaxKey = 80, kMaxValue = 250;  // MetaIO keeps some of them in char[255]
constexpr std::size_t kMaxFields = 200;

struct Fields {
  std::map<std::string, std::string> values;
  std::uint64_t end = 0;  // first byte after the header

  [[nodiscard]] const std::string* find(const std::string& key) const {
    const auto found = values.find(key);
    return found == values.end() ? nullptr : &found->second;
  }
};

Fields read_fields(const std::filesystem::path& path) {
  ByteSource source(path, Storage::Raw);
  std::string text(kMaxHeader, '\0');
  text.resize(source.read(text.data(), text.size()));
  Fields fields;
  for (std::size_t begin = 0; !fields.values.contains("ElementDataFile");) {
    const std::size_t end = text.find('\n', begin);
    const bool is_last = end == std::string::npos;
    const std::string_view line =
        std::string_view(text).substr(begin, is_last ? std::string::npos : end - begin);
    const std::size_t equals = line.find('=');
    const std::string key(trimmed(line.substr(0, equals)));
    if (is_last && trimmed(line).empty())
      refuse_file(path,
                  "has no field 'ElementDataFile' in its header; it is no complete MetaImage");
    if (equals == std::string_view::npos || key.empty() || key.size() > kMaxKey ||
        line.find('\0') != std::string_view::npos)
      refuse_file(path, "is no MetaImage: its line " + in_quotes(trimmed(line)) +
                            " is not 'key = value'; check the file");
    const std::string value(trimmed(line.substr(equals + 1)));
    if (value.size() > kMaxValue)
      refuse_file(path, "has a value of " + std::to_string(value.size()) +
                            " characters in the field " + in_quotes(key) + " (at most " +
                            std::to_string(kMaxValue) + " are safe to read); shorten it");
    if (!fields.values.emplace(key, value).second)
      refuse_file(path, "has the field " + in_quotes(key) + " twice; remove one");
    if (fields.values.size() > kMaxFields)
      refuse_file(path, "has more than " + std::to_string(kMaxFields) + " header fields");
    fields.end = is_last ? text.size() : end + 1;
    begin = static_cast<std::size_t>(fields.end);
  }
  return fields;
}

// One of several names that mean the same.
const std::string* find_one(const std::filesystem::path& path,
                            const Fields& fields,
                            std::initializer_list<const char*> names) {
  const std::string* found = nullptr;
  for (const char* name : names) {
    const std::string* value = fields.find(name);
    if (!value) continue;
    if (found)
      refuse_file(path, std::string("has the field '") + name +
                            "' beside another name of the same; remove one");
    found = value;
  }
  return found;
}

bool is_true(const std::filesystem::path& path,
             const Fields& fields,
             const std::string& key,
             bool otherwise) {
  const std::string* value = fields.find(key);
  if (!value) return otherwise;
  const std::string text = lower_case(*value);
  if (text == "true" || text == "t" || text == "1") return true;
  if (text == "false" || text == "f" || text == "0") return false;
  refuse_file(path, "has " + key + " = " + in_quotes(*value) + ", which is not True or False");
}

VoxelType voxel_type(const std::filesystem::path& path, const Fields& fields) {
  // On disk MET_LONG has 4 bytes, whatever a machine's long is.
  static const std::map<std::string, VoxelType> types = {
      {"MET_UCHAR", VoxelType::UInt8},       {"MET_CHAR", VoxelType::Int8},
      {"MET_USHORT", VoxelType::UInt16},     {"MET_SHORT", VoxelType::Int16},
      {"MET_UINT", VoxelType::UInt32},       {"MET_INT", VoxelType::Int32},
      {"MET_ULONG", VoxelType::UInt32},      {"MET_LONG", VoxelType::Int32},
      {"MET_ULONG_LONG", VoxelType::UInt64}, {"MET_LONG_LONG", VoxelType::Int64},
      {"MET_FLOAT", VoxelType::Float32},     {"MET_DOUBLE", VoxelType::Float64}};
  const std::string* name = fields.find("ElementType");
  if (!name) refuse_file(path, "has no field 'ElementType'; the header is damaged");
  const auto found = types.find(*name);
  if (found == types.end())
    refuse_file(path, "has ElementType = " + in_quotes(*name) +
                          ", which is no single number per voxel; save the labels as integers");
  return found->second;
}

std::vector<double> numbers(const std::filesystem::path& path,
                            const std::string& key,
                            const std::string& text,
                            std::size_t count) {
  std::vector<double> values = parse_numbers(path, key, text);
  if (values.size() != count)
    refuse_file(path, "has " + std::to_string(values.size()) + " numbers in the field '" + key +
                          "' instead of " + std::to_string(count) + "; the header is damaged");
  return values;
}

void refuse_unsupported(const std::filesystem::path& path, const Fields& fields) {
  const std::string* type = fields.find("ObjectType");
  if (type && *type != "Image")
    refuse_file(path, "has ObjectType = " + in_quotes(*type) + ", which is no image");
  const auto must_be = [&](const char* key, double expected, const char* why) {
    const std::string* text = fields.find(key);
    if (text && numbers(path, key, *text, 1)[0] != expected)
      refuse_file(path, std::string("has ") + key + " = " + in_quotes(*text) + ": " + why);
  };
  must_be("ElementNumberOfChannels", 1,
          "vector or colour voxels; a label volume has one integer per voxel");
  must_be("ElementToIntensityFunctionSlope", 1, "labels are never scaled; save it with slope 1");
  must_be("ElementToIntensityFunctionOffset", 0, "labels are never shifted; save it with offset 0");
  must_be("HeaderSize", 0, "data behind a foreign header is not supported; save it as plain .mha");
  if (!is_true(path, fields, "BinaryData", true))
    refuse_file(path, "has BinaryData = False; voxels as text are not supported, save it binary");
}

Affine index_to_world(const std::filesystem::path& path, const Fields& fields, std::size_t n) {
  std::vector<double> spacing(n, 1.0), offset(n, 0.0), axes(n * n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    axes[i * n + i] = 1;
  // ElementSize stands in for ElementSpacing only where that is absent.
  const std::string* text = fields.find("ElementSpacing");
  if (!text) text = fields.find("ElementSize");
  if (text) spacing = numbers(path, "ElementSpacing", *text, n);
  if ((text = find_one(path, fields, {"Offset", "Position", "Origin"})))
    offset = numbers(path, "Offset", *text, n);
  if ((text = find_one(path, fields, {"TransformMatrix", "Rotation", "Orientation"})))
    axes = numbers(path, "TransformMatrix", *text, n * n);
  Affine map;
  for (std::size_t r = 0; r < 3; ++r) {
    // The matrix lists one index axis after the other, so that axis k is its k-th *row*.
    for (std::size_t k = 0; k < 3; ++k)
      map.rows[r][static_cast<int>(k)] = axes[k * n + r] * spacing[k];
    map.offset[static_cast<int>(r)] = offset[r];
  }
  return map;
}

}  // namespace

VolumeHeader parse_meta_header(const std::filesystem::path& path) {
  const Fields fields = read_fields(path);
  refuse_unsupported(path, fields);
  const std::string* size = fields.find("DimSize");
  const std::string* count = fields.find("NDims");
  if (!size || !count)
    refuse_file(path, "has no field 'NDims' or 'DimSize'; it is no complete MetaImage");
  const auto sizes = parse_integers(path, "DimSize", *size);
  if (*count != std::to_string(sizes.size()))
    refuse_file(path, "has NDims = " + in_quotes(*count) + " but " + std::to_string(sizes.size()) +
                          " numbers in DimSize; the header is damaged");
  const auto [dims, volumes] = checked_dims(path, sizes);
  if (sizes.size() > 4)
    refuse_file(path, "has " + std::to_string(sizes.size()) +
                          " dimensions; extract one 3-D volume from it");

  VolumeHeader header;
  header.volumes = volumes;
  header.type = voxel_type(path, fields);
  const bool is_big = is_true(path, fields, "BinaryDataByteOrderMSB",
                              is_true(path, fields, "ElementByteOrderMSB", false));
  header.is_swapped = is_big != (std::endian::native == std::endian::big);
  header.frame = checked_frame(path, dims, index_to_world(path, fields, sizes.size()), Space::Lps);

  const std::string& file = *fields.find("ElementDataFile");
  if (lower_case(file) == "local") {
    header.data_file = path;
    header.data_begin = fields.end;
  } else {
    header.data_file = checked_sibling(path, "ElementDataFile", file);
  }
  if (is_true(path, fields, "CompressedData", false)) {
    header.storage = Storage::Zlib;
    if (const std::string* stored = fields.find("CompressedDataSize")) {
      const auto value = parse_integers(path, "CompressedDataSize", *stored);
      if (value.size() != 1 || value[0] < 0)
        refuse_file(path,
                    "has CompressedDataSize = " + in_quotes(*stored) + "; the header is damaged");
      if (value[0] > 0) header.data_count = static_cast<std::uint64_t>(value[0]);
    }
  }
  return header;
}

}  // namespace cvmesh::detail
