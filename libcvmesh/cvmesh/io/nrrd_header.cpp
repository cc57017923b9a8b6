// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_header.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <optional>

// The text header of NRRD files (teem's format definition, versions 1 to 5).
namespace cvmesh::detail {
namespace {

constexpr std::size_t kMaxHeader = std::size_t{4} << 20;  // segmentations list all their segments

struct Fields {
  std::map<std::string, std::string> values;  // by canonical name
  std::uint64_t end = 0;                      // first byte after the header

  [[nodiscard]] const std::string* find(const std::string& key) const {
    const auto found = values.find(key);
    return found == values.end() ? nullptr : &found->second;
  }
};

// Some fields have a second spelling without the blank.
std::string canonical(std::string_view key) {
  static const std::map<std::string, std::string> aliases = {
      {"datafile", "data file"}, {"lineskip", "line skip"}, {"byteskip", "byte skip"}};
  std::string name = lower_case(trimmed(key));
  const auto found = aliases.find(name);
  return found == aliases.end() ? name : found->second;
}

Fields read_fields(const std::filesystem::path& path) {
  ByteSource source(path, Storage::Raw);
  std::string text(1 << 16, '\0');
  text.resize(source.read(text.data(), text.size()));
  if (text.size() < 9 || text.compare(0, 7, "NRRD000") != 0 || text[7] < '1' || text[7] > '5')
    refuse_file(path, "is no NRRD file (it does not start with NRRD0001 to NRRD0005)");
  if (text.find("\n\n") == std::string::npos && text.find("\n\r\n") == std::string::npos) {
    std::string more(std::min<std::uint64_t>(kMaxHeader, source.stored_bytes()), '\0');
    more.resize(source.read(more.data(), more.size()));
    text += more;
  }
  Fields fields;
  for (std::size_t begin = text.find('\n') + 1;;) {
    if (begin == 0 || begin >= text.size()) {  // a detached header may end with the file
      fields.end = text.size();
      break;
    }
    const std::size_t end = text.find('\n', begin);
    const std::string_view line = std::string_view(text).substr(
        begin, end == std::string::npos ? std::string::npos : end - begin);
    begin = end + 1;
    fields.end = end == std::string::npos ? text.size() : begin;
    if (trimmed(line).empty()) break;
    if (line[0] == '#') continue;
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos || line.find('\0') != std::string_view::npos)
      refuse_file(path, "is no NRRD file: its line " + in_quotes(trimmed(line)) +
                            " is not 'field: value'; check the file");
    if (line.substr(colon, 2) == ":=") continue;  // a key/value pair, which means nothing here
    const std::string key = canonical(line.substr(0, colon));
    if (!fields.values.emplace(key, trimmed(line.substr(colon + 1))).second)
      refuse_file(path, "has the field " + in_quotes(key) + " twice; remove one");
  }
  return fields;
}

VoxelType voxel_type(const std::filesystem::path& path, const Fields& fields) {
  static const std::map<std::string, VoxelType> types = {
      {"signed char", VoxelType::Int8},
      {"int8", VoxelType::Int8},
      {"int8_t", VoxelType::Int8},
      {"uchar", VoxelType::UInt8},
      {"unsigned char", VoxelType::UInt8},
      {"uint8", VoxelType::UInt8},
      {"uint8_t", VoxelType::UInt8},
      {"short", VoxelType::Int16},
      {"short int", VoxelType::Int16},
      {"signed short", VoxelType::Int16},
      {"signed short int", VoxelType::Int16},
      {"int16", VoxelType::Int16},
      {"int16_t", VoxelType::Int16},
      {"ushort", VoxelType::UInt16},
      {"unsigned short", VoxelType::UInt16},
      {"unsigned short int", VoxelType::UInt16},
      {"uint16", VoxelType::UInt16},
      {"uint16_t", VoxelType::UInt16},
      {"int", VoxelType::Int32},
      {"signed int", VoxelType::Int32},
      {"int32", VoxelType::Int32},
      {"int32_t", VoxelType::Int32},
      {"uint", VoxelType::UInt32},
      {"unsigned int", VoxelType::UInt32},
      {"uint32", VoxelType::UInt32},
      {"uint32_t", VoxelType::UInt32},
      {"longlong", VoxelType::Int64},
      {"long long", VoxelType::Int64},
      {"long long int", VoxelType::Int64},
      {"signed long long", VoxelType::Int64},
      {"signed long long int", VoxelType::Int64},
      {"int64", VoxelType::Int64},
      {"int64_t", VoxelType::Int64},
      {"ulonglong", VoxelType::UInt64},
      {"unsigned long long", VoxelType::UInt64},
      {"unsigned long long int", VoxelType::UInt64},
      {"uint64", VoxelType::UInt64},
      {"uint64_t", VoxelType::UInt64},
      {"float", VoxelType::Float32},
      {"double", VoxelType::Float64}};
  const std::string* name = fields.find("type");
  const auto found = name ? types.find(lower_case(*name)) : types.end();
  if (found == types.end())
    refuse_file(path, "has the voxel type " + in_quotes(name ? *name : "") +
                          ", which is no number; save the labels as integers");
  return found->second;
}

Space declared_space(const Fields& fields) {
  const std::string* text = fields.find("space");
  if (!text) return Space::Unknown;
  const std::string name = lower_case(*text);
  if (name == "left-posterior-superior" || name == "lps") return Space::Lps;
  if (name == "right-anterior-superior" || name == "ras") return Space::Ras;
  if (name == "left-anterior-superior" || name == "las") return Space::Las;
  return Space::Unknown;
}

// The vectors "(a,b,c)" of a field; "none" gives an empty one.
std::vector<std::vector<double>> parse_vectors(const std::filesystem::path& path,
                                               const std::string& field,
                                               std::string_view text) {
  std::vector<std::vector<double>> vectors;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    if (lower_case(text.substr(0, 4)) == "none") {
      vectors.emplace_back();
      text.remove_prefix(4);
      continue;
    }
    const std::size_t close = text.find(')');
    if (text[0] != '(' || close == std::string_view::npos)
      refuse_file(path, "has " + in_quotes(text) + " in the field '" + field +
                            "', which is no vector (a,b,c); the header is damaged");
    std::string inner(text.substr(1, close - 1));
    for (char& c : inner)
      if (c == ',') c = ' ';
    vectors.push_back(parse_numbers(path, field, inner));
    if (vectors.back().size() != 3)
      refuse_file(path, "has a vector of " + std::to_string(vectors.back().size()) +
                            " numbers in the field '" + field + "'; a label volume has 3");
    text.remove_prefix(close + 1);
  }
  return vectors;
}

std::vector<double> spacings(const std::filesystem::path& path, const Fields& fields) {
  std::vector<double> values(3, 1.0);
  const std::string* text = fields.find("spacings");
  if (!text) return values;
  const std::vector<double> given = parse_numbers(path, "spacings", *text);
  for (std::size_t i = 0; i < 3 && i < given.size(); ++i)
    if (!std::isnan(given[i])) values[i] = given[i];  // NaN is the format's "not known"
  return values;
}

Affine index_to_world(const std::filesystem::path& path, const Fields& fields) {
  Affine map;
  if (const std::string* text = fields.find("space directions")) {
    const auto axes = parse_vectors(path, "space directions", *text);
    if (axes.size() < 3 || axes[0].empty() || axes[1].empty() || axes[2].empty())
      refuse_file(path,
                  "has no direction for one of its first three axes in 'space directions'; "
                  "vector voxels or time series are not supported");
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 3; ++k)
        map.rows[static_cast<std::size_t>(r)][k] =
            axes[static_cast<std::size_t>(k)][static_cast<std::size_t>(r)];
  } else {
    const auto values = spacings(path, fields);
    for (int k = 0; k < 3; ++k)
      map.rows[static_cast<std::size_t>(k)][k] = values[static_cast<std::size_t>(k)];
  }
  if (const std::string* text = fields.find("space origin")) {
    const auto origin = parse_vectors(path, "space origin", *text);
    if (origin.size() != 1)
      refuse_file(path, "has " + std::to_string(origin.size()) +
                            " vectors in 'space origin' instead of 1; the header is damaged");
    if (!origin[0].empty()) map.offset = {origin[0][0], origin[0][1], origin[0][2]};
  }
  return map;
}

void refuse_unsupported(const std::filesystem::path& path, const Fields& fields) {
  if (const std::string* kinds = fields.find("kinds")) {
    const auto words = split_words(lower_case(*kinds));
    for (std::size_t axis = 0; axis < words.size() && axis < 3; ++axis)
      if (words[axis] != "domain" && words[axis] != "space" && words[axis] != "none" &&
          words[axis] != "???")
        refuse_file(path, "has the kind " + in_quotes(words[axis]) + " on axis " +
                              std::to_string(axis + 1) +
                              "; vector or colour voxels are not supported, give one integer per "
                              "voxel");
  }
  for (const char* key : {"line skip", "byte skip"}) {
    const std::string* value = fields.find(key);
    if (value && *value != "0")
      refuse_file(path, std::string("has '") + key + ": " + *value +
                            "'; data behind a foreign header is not supported");
  }
}

}  // namespace

VolumeHeader parse_nrrd_header(const std::filesystem::path& path) {
  const Fields fields = read_fields(path);
  refuse_unsupported(path, fields);
  const std::string* size = fields.find("sizes");
  const std::string* count = fields.find("dimension");
  if (!size || !count)
    refuse_file(path, "has no field 'dimension' or 'sizes'; it is no complete NRRD file");
  const auto sizes = parse_integers(path, "sizes", *size);
  if (*count != std::to_string(sizes.size()))
    refuse_file(path, "has dimension " + in_quotes(*count) + " but " +
                          std::to_string(sizes.size()) +
                          " numbers in 'sizes'; the header is damaged");
  const auto [dims, volumes] = checked_dims(path, sizes);

  VolumeHeader header;
  header.volumes = volumes;
  header.type = voxel_type(path, fields);
  const std::string* endian = fields.find("endian");
  const std::string order = endian ? lower_case(*endian) : "";
  if (voxel_bytes(header.type) > 1 && order != "little" && order != "big")
    refuse_file(path, "does not say 'endian: little' or 'endian: big'; the header is damaged");
  header.is_swapped = (order == "big") != (std::endian::native == std::endian::big);
  header.frame = checked_frame(path, dims, index_to_world(path, fields), declared_space(fields));

  const std::string* encoding = fields.find("encoding");
  const std::string code = encoding ? lower_case(*encoding) : "";
  if (code == "gzip" || code == "gz")
    header.storage = Storage::Gzip;
  else if (code != "raw")
    refuse_file(path, "has the encoding " + in_quotes(encoding ? *encoding : "") +
                          "; only raw and gzip are supported, save it again with one of them");

  header.data_file = path;
  header.data_begin = fields.end;
  if (const std::string* file = fields.find("data file")) {
    header.data_file = checked_sibling(path, "data file", *file);
    header.data_begin = 0;
  }
  return header;
}

}  // namespace cvmesh::detail
