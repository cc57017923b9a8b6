// SPDX-License-Identifier: AGPL-3.0-or-later
#include "io/image_files.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <zlib.h>

namespace cvmesh::image_files {
namespace {

std::string deflate_all(const std::string& bytes, int window_bits) {
  z_stream stream{};
  if (deflateInit2(&stream, 6, Z_DEFLATED, window_bits, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::runtime_error("deflateInit2");
  std::string packed(deflateBound(&stream, bytes.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  if (deflate(&stream, Z_FINISH) != Z_STREAM_END) throw std::runtime_error("deflate");
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

using FieldList = std::vector<std::pair<std::string, std::string>>;

void replace_or_add(FieldList& fields, const FieldList& changes) {
  for (const auto& change : changes) {
    bool is_known = false;
    for (auto& field : fields)
      if (field.first == change.first) {
        field.second = change.second;
        is_known = true;
      }
    if (!is_known) fields.push_back(change);
  }
}

}  // namespace

void write_file(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!file) throw std::runtime_error("cannot write " + path.string());
}

std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

std::string gzip(const std::string& bytes) {
  return deflate_all(bytes, 15 + 16);
}

std::string zlib(const std::string& bytes) {
  return deflate_all(bytes, 15);
}

std::string Nifti::bytes() const {
  const std::size_t size = version == 1 ? 348 : 540;
  std::string header(size, '\0');
  const auto put = [&](std::size_t offset, auto value) {
    header.replace(offset, sizeof value, bytes_of(value, is_swapped));
  };
  const double begin = data_begin >= 0 ? data_begin : static_cast<double>(size + extension.size());
  put(0, static_cast<std::int32_t>(size));
  for (std::size_t i = 0; i < 8; ++i) {
    if (version == 1) {
      put(40 + 2 * i, static_cast<std::int16_t>(dim[i]));
      put(76 + 4 * i, static_cast<float>(pixdim[i]));
    } else {
      put(16 + 8 * i, dim[i]);
      put(104 + 8 * i, pixdim[i]);
    }
  }
  if (version == 1) {
    put(70, static_cast<std::int16_t>(datatype));
    put(108, static_cast<float>(begin));
    put(112, static_cast<float>(slope));
    put(116, static_cast<float>(intercept));
    header[123] = static_cast<char>(units);
    put(252, static_cast<std::int16_t>(qform_code));
    put(254, static_cast<std::int16_t>(sform_code));
  } else {
    put(12, static_cast<std::int16_t>(datatype));
    put(168, static_cast<std::int64_t>(begin));
    put(176, slope);
    put(184, intercept);
    put(500, static_cast<std::int32_t>(units));
    put(344, static_cast<std::int32_t>(qform_code));
    put(348, static_cast<std::int32_t>(sform_code));
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3& row = s_form.rows[i];
    const double values[4] = {row.x, row.y, row.z, s_form.offset[static_cast<int>(i)]};
    if (version == 1) {
      put(256 + 4 * i, static_cast<float>(quaternion[i]));
      put(268 + 4 * i, static_cast<float>(q_offset[i]));
      for (std::size_t j = 0; j < 4; ++j)
        put(280 + 16 * i + 4 * j, static_cast<float>(values[j]));
    } else {
      put(352 + 8 * i, quaternion[i]);
      put(376 + 8 * i, q_offset[i]);
      for (std::size_t j = 0; j < 4; ++j)
        put(400 + 32 * i + 8 * j, values[j]);
    }
  }
  const std::string right_magic =
      version == 1 ? std::string("n+1\0", 4) : std::string("n+2\0\r\n\032\n", 8);
  const std::string& used = magic.empty() ? right_magic : magic;
  header.replace(version == 1 ? 344 : 4, used.size(), used);
  return header + extension + voxels;
}

std::string meta_header(const FieldList& changes, const std::string& data_file) {
  FieldList fields = {{"ObjectType", "Image"},
                      {"NDims", "3"},
                      {"BinaryData", "True"},
                      {"BinaryDataByteOrderMSB", "False"},
                      {"CompressedData", "False"},
                      {"TransformMatrix", "1 0 0 0 1 0 0 0 1"},
                      {"Offset", "0 0 0"},
                      {"CenterOfRotation", "0 0 0"},
                      {"AnatomicalOrientation", "RAI"},
                      {"ElementSpacing", "1 1 1"},
                      {"DimSize", "4 3 2"},
                      {"ElementType", "MET_UCHAR"}};
  replace_or_add(fields, changes);
  std::string text;
  for (const auto& field : fields)
    text += field.first + " = " + field.second + "\n";
  return text + "ElementDataFile = " + data_file + "\n";
}

std::string nrrd_header(const FieldList& changes) {
  FieldList fields = {{"type", "uint8"},
                      {"dimension", "3"},
                      {"sizes", "4 3 2"},
                      {"endian", "little"},
                      {"encoding", "raw"}};
  replace_or_add(fields, changes);
  std::string text = "NRRD0004\n# made by a test\n";
  for (const auto& field : fields)
    text += field.first + ": " + field.second + "\n";
  return text + "\n";
}

PythonRun run_python(const std::filesystem::path& folder,
                     const std::string& script,
                     const std::string& arguments) {
  const std::filesystem::path file = folder / "check.py";
  write_file(file, script);
  const std::string command = "/usr/bin/python3 '" + file.string() + "' " + arguments + " 2>&1";
  PythonRun run;
  std::FILE* pipe = ::popen(command.c_str(), "r");
  if (!pipe) return run;
  char block[4096];
  while (const std::size_t count = std::fread(block, 1, sizeof block, pipe))
    run.output.append(block, count);
  run.ok = ::pclose(pipe) == 0;
  return run;
}

bool python_has(const std::string& module) {
  const std::string command = "/usr/bin/python3 -c 'import " + module + "' > /dev/null 2>&1";
  return std::system(command.c_str()) == 0;
}

}  // namespace cvmesh::image_files
