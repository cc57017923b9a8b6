// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/volume_reader.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <cmath>
#include <functional>
#include <iostream>
#include <limits>
#include <sstream>
#include <sys/stat.h>

using namespace cvmesh;
using namespace cvmesh::image_files;

namespace {

const std::string kVoxels(24, '\1');

// Labels 0 to 7 that hardly compress (a linear congruential sequence).
std::string noisy_labels(std::size_t count) {
  std::string labels(count, '\0');
  std::uint32_t state = 1;
  for (char& label : labels) {
    state = state * 1664525u + 1013904223u;
    label = static_cast<char>(state >> 29);
  }
  return labels;
}

// Reads the file, which must be refused as bad input by a message with `part` in it and with
// nothing printed.
void check_refused(const std::filesystem::path& path, const std::string& part) {
  CAPTURE(path.filename().string(), part);
  std::ostringstream printed;
  std::streambuf* const cerr = std::cerr.rdbuf(printed.rdbuf());
  std::streambuf* const cout = std::cout.rdbuf(printed.rdbuf());
  std::string message = "accepted";
  bool is_bad_input = false, is_other = false;
  try {
    read_label_volume(path);
  } catch (const Error& error) {
    message = error.what();
    is_bad_input = error.code() == ErrorCode::BadInput;
  } catch (const std::exception& error) {
    message = error.what();
    is_other = true;
  }
  std::cerr.rdbuf(cerr);
  std::cout.rdbuf(cout);
  CAPTURE(message);
  CHECK(is_bad_input);
  CHECK_FALSE(is_other);
  CHECK(message.find(part) != std::string::npos);
  CHECK(message.find(path.filename().string()) != std::string::npos);
  CHECK(printed.str().empty());
}

void check_nifti_refused(const std::function<void(Nifti&)>& change, const std::string& part) {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.voxels = kVoxels;
  change(nifti);
  write_file(folder / "a.nii", nifti.bytes());
  check_refused(folder / "a.nii", part);
  write_file(folder / "b.nii.gz", gzip(nifti.bytes()));
  check_refused(folder / "b.nii.gz", part);
}

void check_meta_refused(const std::vector<std::pair<std::string, std::string>>& fields,
                        const std::string& part,
                        const std::string& data = kVoxels,
                        const std::string& data_file = "LOCAL") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.mha", meta_header(fields, data_file) + data);
  check_refused(folder / "a.mha", part);
}

void check_nrrd_refused(const std::vector<std::pair<std::string, std::string>>& fields,
                        const std::string& part,
                        const std::string& data = kVoxels) {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.nrrd", nrrd_header(fields) + data);
  check_refused(folder / "a.nrrd", part);
}

}  // namespace

TEST_CASE("read_label_volume: what is no image file is refused", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  check_refused(folder / "missing.nii.gz", "does not exist");
  check_refused(folder / "missing.mha", "does not exist");
  check_refused(folder / "missing.nrrd", "does not exist");
  std::filesystem::create_directory(folder / "folder.nii");
  check_refused(folder / "folder.nii", "not a regular file");
  write_file(folder / "a.txt", "text");
  check_refused(folder / "a.txt", "extension");
  write_file(folder / "a.gz", "text");
  check_refused(folder / "a.gz", "extension");
  std::string noise;
  for (int i = 0; i < 3000; ++i)
    noise += static_cast<char>((i * 7919 + i / 7) & 0xff);
  for (const char* name : {"a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.nrrd"}) {
    write_file(folder / name, "");
    check_refused(folder / name, "is no ");
    write_file(folder / name, noise);
    check_refused(folder / name, "is no ");
    write_file(folder / name, "Just a line of text.\n");
    check_refused(folder / name, "is no ");
  }
  write_file(folder / "cut.nii.gz", gzip(Nifti().bytes()).substr(0, 12));
  check_refused(folder / "cut.nii.gz", "cut short");
}

TEST_CASE("read_label_volume: hostile NIfTI headers are refused", "[io][unit]") {
  check_nifti_refused([](Nifti& n) { n.dim = {2, 4, 6, 1, 1, 1, 1, 1}; }, "2 dimension");
  check_nifti_refused(
      [](Nifti& n) {
        n.dim = {4, 4, 3, 2, 5, 1, 1, 1};
        n.voxels = std::string(120, '\1');
      },
      "4 dimensions");
  check_nifti_refused([](Nifti& n) { n.dim = {0, 4, 3, 2, 1, 1, 1, 1}; }, "0 dimensions");
  check_nifti_refused([](Nifti& n) { n.dim = {9, 4, 3, 2, 1, 1, 1, 1}; }, "9 dimensions");
  check_nifti_refused([](Nifti& n) { n.dim = {3, 4, 0, 2, 1, 1, 1, 1}; }, "at least 1 voxel");
  check_nifti_refused([](Nifti& n) { n.dim = {3, 4, 3, -2, 1, 1, 1, 1}; }, "at least 1 voxel");
  check_nifti_refused([](Nifti& n) { n.dim = {3, 32767, 32767, 32767, 1, 1, 1, 1}; }, "more than");
  check_nifti_refused([](Nifti& n) { n.dim = {3, 2000, 2000, 1000, 1, 1, 1, 1}; }, "cut short");
  check_nifti_refused(
      [](Nifti& n) {
        n.version = 2;
        n.dim = {3, 4294967296, 4294967296, 4, 1, 1, 1, 1};
      },
      "exceeds 65535");
  check_nifti_refused([](Nifti& n) { n.slope = 2; }, "scl_slope 2");
  check_nifti_refused([](Nifti& n) { n.intercept = 1; }, "scl_inter 1");
  check_nifti_refused([](Nifti& n) { n.datatype = 128; }, "colour");
  check_nifti_refused([](Nifti& n) { n.datatype = 2304; }, "colour");
  check_nifti_refused([](Nifti& n) { n.datatype = 32; }, "complex");
  check_nifti_refused([](Nifti& n) { n.datatype = 1536; }, "datatype 1536");
  check_nifti_refused([](Nifti& n) { n.magic = std::string("ni1\0", 4); }, "single-file");
  check_nifti_refused([](Nifti& n) { n.magic = std::string("\0\0\0\0", 4); }, "single-file");
  check_nifti_refused([](Nifti& n) { n.data_begin = 100; }, "start at byte 100");
  check_nifti_refused([](Nifti& n) { n.data_begin = 352.5; }, "start at byte");
  check_nifti_refused([](Nifti& n) { n.data_begin = 1e9; }, "cut short");
  check_nifti_refused([](Nifti& n) { n.s_form.rows[1] = {}; }, "no volume");
  check_nifti_refused([](Nifti& n) { n.s_form.rows[1] = n.s_form.rows[0]; }, "no volume");
  check_nifti_refused([](Nifti& n) { n.s_form.offset.x = std::nan(""); }, "nan");
  check_nifti_refused(
      [](Nifti& n) {
        n.sform_code = 0;
        n.pixdim[2] = 0;
      },
      "no volume");
}

TEST_CASE("read_label_volume: damaged NIfTI data is refused", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.dim = {3, 40, 40, 40, 1, 1, 1, 1};
  nifti.voxels = noisy_labels(64'000);
  const std::string bytes = nifti.bytes(), packed = gzip(bytes);

  write_file(folder / "half.nii", bytes.substr(0, bytes.size() / 2));
  check_refused(folder / "half.nii", "cut short");
  write_file(folder / "one.nii", bytes.substr(0, bytes.size() - 1));
  check_refused(folder / "one.nii", "cut short");
  write_file(folder / "half.nii.gz", packed.substr(0, packed.size() * 6 / 10));
  check_refused(folder / "half.nii.gz", "cut short");
  write_file(folder / "inner.nii.gz", gzip(bytes.substr(0, bytes.size() - 1)));
  check_refused(folder / "inner.nii.gz", "cut short");
  // Every voxel is there, but the trailer (CRC and length) is not, or is wrong.
  write_file(folder / "trailer.nii.gz", packed.substr(0, packed.size() - 5));
  check_refused(folder / "trailer.nii.gz", "cut short");
  for (const std::size_t back : {8, 1}) {
    std::string wrong = packed;
    wrong[wrong.size() - back] = static_cast<char>(wrong[wrong.size() - back] ^ 0x55);
    write_file(folder / "crc.nii.gz", wrong);
    check_refused(folder / "crc.nii.gz", "damaged");
  }
  std::string flipped = packed;
  flipped[packed.size() / 2] = static_cast<char>(flipped[packed.size() / 2] ^ 0x55);
  write_file(folder / "flip.nii.gz", flipped);
  check_refused(folder / "flip.nii.gz", "damaged");
  write_file(folder / "garbage.nii.gz", packed + "garbage");
  check_refused(folder / "garbage.nii.gz", "foreign bytes");
  // A small file that inflates to far more than the voxels that it declares.
  write_file(folder / "bomb.nii.gz", gzip(bytes + std::string(std::size_t{64} << 20, '\0')));
  check_refused(folder / "bomb.nii.gz", "beyond the voxels");
}

TEST_CASE("read_label_volume: values that are no labels are refused", "[io][unit]") {
  const auto with_value = [](auto value, int datatype) {
    return [=](Nifti& n) {
      std::vector<decltype(value)> values(24, decltype(value){});
      values[17] = value;  // voxel (1, 1, 1)
      n.datatype = datatype;
      n.voxels = bytes_of_all(values);
    };
  };
  check_nifti_refused(with_value(1.5f, 16), "1.5 at voxel (1, 1, 1)");
  check_nifti_refused(with_value(2.99f, 16), "no integer");
  check_nifti_refused(with_value(0.0011, 64), "no integer");
  check_nifti_refused(with_value(std::numeric_limits<float>::quiet_NaN(), 16), "nan");
  check_nifti_refused(with_value(std::numeric_limits<double>::infinity(), 64), "inf");
  check_nifti_refused(with_value(3e9, 64), "beyond 32-bit");
  check_nifti_refused(with_value(std::int64_t{2147483648}, 1024), "beyond 32-bit");
  check_nifti_refused(with_value(std::int64_t{-2147483649}, 1024), "beyond 32-bit");
  check_nifti_refused(with_value(std::uint32_t{4000000000u}, 768), "beyond 32-bit");
  check_nifti_refused(with_value(~std::uint64_t{0}, 1280), "beyond 32-bit");
  std::vector<float> values(24, 0.0f);
  values[5] = 0.5f;
  check_meta_refused({{"ElementType", "MET_FLOAT"}}, "0.5 at voxel (1, 1, 0)",
                     bytes_of_all(values));
  check_nrrd_refused({{"type", "float"}}, "0.5 at voxel (1, 1, 0)", bytes_of_all(values));
}

TEST_CASE("read_label_volume: hostile MetaImage headers are refused", "[io][unit]") {
  check_meta_refused({{"NDims", "2"}, {"DimSize", "4 6"}}, "2 dimension");
  check_meta_refused({{"NDims", "4"},
                      {"DimSize", "4 3 2 2"},
                      {"ElementSpacing", "1 1 1 1"},
                      {"Offset", "0 0 0 0"},
                      {"TransformMatrix", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"}},
                     "4 dimensions", std::string(48, '\1'));
  check_meta_refused({{"NDims", "11"}, {"DimSize", "4 3 2 1 1 1 1 1 1 1 1"}}, "11 dimensions");
  check_meta_refused({{"NDims", "5"}}, "NDims = \"5\"");
  check_meta_refused({{"DimSize", "-4 3 2"}}, "at least 1 voxel");
  check_meta_refused({{"DimSize", "4 0 2"}}, "at least 1 voxel");
  check_meta_refused({{"DimSize", "4294967296 4294967296 4"}}, "exceeds 65535");
  check_meta_refused({{"DimSize", "99999999999999999999 3 2"}}, "no integer");
  check_meta_refused({{"DimSize", "4 3 2.5"}}, "no integer");
  check_meta_refused({{"DimSize", "60000 60000 4"}}, "cut short");
  check_meta_refused({{"ElementSpacing", "1 0 1"}}, "no volume");
  check_meta_refused({{"ElementSpacing", "1 1"}}, "2 numbers");
  check_meta_refused({{"ElementSpacing", "1 x 1"}}, "no number");
  check_meta_refused({{"Offset", "nan 0 0"}}, "nan");
  check_meta_refused({{"TransformMatrix", "1 0 0 1 0 0 0 0 1"}}, "no volume");
  check_meta_refused({{"ElementType", "MET_UCHAR_ARRAY"}}, "MET_UCHAR_ARRAY");
  check_meta_refused({{"ElementType", "MET_STRING"}}, "MET_STRING");
  check_meta_refused({{"ElementNumberOfChannels", "3"}}, "vector", std::string(72, '\1'));
  check_meta_refused({{"ElementToIntensityFunctionSlope", "2"}}, "scaled");
  check_meta_refused({{"ElementToIntensityFunctionOffset", "-1024"}}, "shifted");
  check_meta_refused({{"BinaryData", "False"}}, "text");
  check_meta_refused({{"HeaderSize", "16"}}, "foreign header");
  check_meta_refused({{"ObjectType", "Tube"}}, "no image");
  check_meta_refused({{"Comment", std::string(5000, 'x')}}, "5000 characters");
  check_meta_refused({{"CompressedData", "maybe"}}, "True or False");
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.mha", "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\n");
  check_refused(folder / "a.mha", "ElementDataFile");
  write_file(folder / "b.mha", "DimSize = 4 3 2\n" + meta_header() + kVoxels);
  check_refused(folder / "b.mha", "twice");
}

TEST_CASE("read_label_volume: damaged MetaImage data is refused", "[io][unit]") {
  check_meta_refused({}, "cut short", "");
  check_meta_refused({}, "cut short", kVoxels.substr(1));
  const std::string raw = noisy_labels(64'000);
  const std::string packed = zlib(raw);
  const auto packed_fields = [&](std::size_t size) {
    return std::vector<std::pair<std::string, std::string>>{
        {"DimSize", "40 40 40"},
        {"CompressedData", "True"},
        {"CompressedDataSize", std::to_string(size)}};
  };
  check_meta_refused(packed_fields(packed.size()), "cut short", packed.substr(0, 2000));
  check_meta_refused(packed_fields(2000), "cut short", packed.substr(0, 2000));
  check_meta_refused(packed_fields(packed.size() / 2), "cut short", packed);
  std::string flipped = packed;
  flipped[packed.size() / 2] = static_cast<char>(flipped[packed.size() / 2] ^ 0x55);
  check_meta_refused(packed_fields(packed.size()), "damaged", flipped);
  std::string checksum = packed;
  checksum.back() = static_cast<char>(checksum.back() ^ 1);
  check_meta_refused(packed_fields(packed.size()), "damaged", checksum);
  const std::string small = zlib(raw.substr(0, 63999));
  check_meta_refused(packed_fields(small.size()), "cut short", small);
}

TEST_CASE("read_label_volume: a header leads to a plain sibling only", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "sub");
  write_file(folder / "secret.raw", kVoxels);
  write_file(folder / "sub" / "beside.raw", kVoxels);
  const std::string names[] = {"../secret.raw",
                               (folder / "secret.raw").string(),
                               "LIST",
                               "LIST 2D",
                               "%03d.raw 1 2 1",
                               "sub/x.raw",
                               "..",
                               "..\\secret.raw",
                               "absent.raw",
                               ".hidden",
                               ""};
  for (const std::string& name : names) {
    CAPTURE(name);
    const auto meta = folder / "sub/a.mhd";
    write_file(meta, meta_header({}, name) + "beside.raw\nbeside.raw\n");
    check_refused(meta, "ElementDataFile");
    const auto nrrd = folder / "sub/a.nrrd";
    write_file(nrrd, nrrd_header({{"data file", name}}));
    check_refused(nrrd, "data file");
  }
  const auto good = folder / "sub" / "b.mhd";
  write_file(good, meta_header({}, "beside.raw"));
  check_refused(good, "--allow-detached");
  const ReadVolumeOptions detached{.allow_detached = true};
  CHECK(read_label_volume(good, nullptr, detached).values == std::vector<Label>(24, 1));
  write_file(folder / "sub" / "beside.raw", kVoxels.substr(3));
  try {
    read_label_volume(good, nullptr, detached);
    FAIL("a short sibling was accepted");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadInput);
    CHECK(std::string(error.what()).find("beside.raw") != std::string::npos);
  }
}

TEST_CASE("read_label_volume: hostile NRRD headers and damaged data are refused", "[io][unit]") {
  check_nrrd_refused({{"dimension", "2"}, {"sizes", "4 6"}}, "2 dimension");
  check_nrrd_refused({{"dimension", "4"}, {"sizes", "4 3 2 2"}}, "4 dimensions",
                     std::string(48, '\1'));
  check_nrrd_refused({{"dimension", "4"},
                      {"sizes", "3 4 3 2"},
                      {"kinds",
                       "RGB-color domain domain "
                       "domain"}},
                     "rgb-color", std::string(72, '\1'));
  check_nrrd_refused({{"dimension", "5"}}, "dimension \"5\"");
  check_nrrd_refused({{"sizes", "4 -3 2"}}, "at least 1 voxel");
  check_nrrd_refused({{"sizes", "4 0 2"}}, "at least 1 voxel");
  check_nrrd_refused({{"sizes", "4294967296 4294967296 4"}}, "exceeds 65535");
  check_nrrd_refused({{"sizes", "60000 60000 4"}}, "cut short");
  check_nrrd_refused({{"sizes", "4 3 a"}}, "no integer");
  check_nrrd_refused({{"type", "block"}}, "voxel type");
  check_nrrd_refused({{"type", "short"}, {"endian", "middle"}}, "endian", std::string(48, '\1'));
  check_nrrd_refused({{"encoding", "bzip2"}}, "encoding");
  check_nrrd_refused({{"encoding", "ascii"}}, "encoding");
  check_nrrd_refused({{"line skip", "1"}}, "line skip");
  check_nrrd_refused({{"byteskip", "-1"}}, "byte skip");
  check_nrrd_refused({{"spacings", "1 0 1"}}, "no volume");
  check_nrrd_refused({{"space", "LPS"}, {"space directions", "(1,0,0) (1,0,0) (0,0,1)"}},
                     "no volume");
  check_nrrd_refused({{"space", "LPS"}, {"space directions", "(1,0,0) none (0,0,1)"}},
                     "no direction");
  check_nrrd_refused({{"space", "LPS"}, {"space directions", "(1,0) (0,1) (1,1)"}}, "2 numbers");
  check_nrrd_refused({{"space origin", "(1,2,x)"}}, "no number");
  check_nrrd_refused({{"datafile", "LIST"}}, "list");
  check_nrrd_refused({}, "cut short", kVoxels.substr(1));
  const std::string packed = gzip(kVoxels);
  check_nrrd_refused({{"encoding", "gzip"}}, "cut short", packed.substr(0, packed.size() - 2));
  check_nrrd_refused({{"encoding", "gzip"}}, "cut short", gzip(kVoxels.substr(1)));
  check_nrrd_refused({{"encoding", "gzip"}}, "damaged", kVoxels);
  std::string wrong = packed;
  wrong[wrong.size() - 7] = static_cast<char>(wrong[wrong.size() - 7] ^ 1);
  check_nrrd_refused({{"encoding", "gzip"}}, "damaged", wrong);
}

TEST_CASE("read_label_volume: odd paths are refused and never waited for", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  for (const char* name : {"pipe.nii", "pipe.mha", "pipe.nrrd"}) {
    REQUIRE(mkfifo((folder / name).c_str(), 0600) == 0);
    check_refused(folder / name, "not a regular file");
  }
  std::filesystem::create_symlink("loop.nii", folder / "loop.nii");
  check_refused(folder / "loop.nii", "does not exist");
  std::filesystem::create_symlink("/dev/zero", folder / "zero.nii");
  check_refused(folder / "zero.nii", "not a regular file");
  check_refused(folder.path() / std::string(300, 'x') / "a.nii", "does not exist");
}

TEST_CASE("read_label_volume: more hostile NIfTI headers", "[io][unit]") {
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  const auto by_pixdim = [](double size) {
    return [=](Nifti& n) {
      n.sform_code = 0;
      n.pixdim[1] = size;
    };
  };
  check_nifti_refused(by_pixdim(nan), "nan in its index-to-world matrix");
  check_nifti_refused(by_pixdim(infinity), "inf in its index-to-world matrix");
  check_nifti_refused(
      [=](Nifti& n) {
        n.sform_code = 0;
        n.qform_code = 1;
        n.quaternion[1] = nan;
      },
      "nan in its index-to-world matrix");
  check_nifti_refused(
      [](Nifti& n) {
        n.version = 2;
        n.s_form.rows[0].x = 1e200;
      },
      "no volume");
  check_nifti_refused([](Nifti& n) { n.dim[0] = -1; }, "-1 dimensions");
  check_nifti_refused([](Nifti& n) { n.dim = {5, 4, 3, 2, 2, 2, 1, 1}; }, "5 dimensions");
  check_nifti_refused([](Nifti& n) { n.dim = {4, 4, 3, 2, 0, 1, 1, 1}; }, "at least 1 voxel");
  check_nifti_refused([](Nifti& n) { n.dim = {4, 4, 3, 2, 30000, 1, 1, 1}; }, "4 x 3 x 2 x 30000");
  check_nifti_refused([](Nifti& n) { n.dim = {3, 30000, 1, 1, 1, 1, 1, 1}; }, "cut short");
  check_nifti_refused(
      [](Nifti& n) {
        n.version = 2;
        n.dim = {3, -9223372036854775807, 3, 2, 1, 1, 1, 1};
      },
      "at least 1 voxel");
  check_nifti_refused(
      [](Nifti& n) {
        n.version = 2;
        n.dim[0] = std::int64_t{1} << 40;
      },
      "1099511627776 dimensions");
  check_nifti_refused(
      [](Nifti& n) {
        n.version = 2;
        n.magic = std::string("n+1\0\r\n\x1a\n", 8);
      },
      "single-file");
  check_nifti_refused([](Nifti& n) { n.data_begin = 1e20; }, "start at byte");
  check_nifti_refused([](Nifti& n) { n.datatype = 0; }, "datatype 0");
  check_nifti_refused([](Nifti& n) { n.datatype = 1; }, "datatype 1,");
  check_nifti_refused([](Nifti& n) { n.datatype = -2; }, "datatype -2");
  check_nifti_refused([=](Nifti& n) { n.intercept = nan; }, "scl_inter nan");
  const test_data::TemporaryFolder folder;
  for (const auto& [begin, text] : {std::pair{std::nanf(""), "nan"}, std::pair{-400.0F, "-400"}}) {
    constexpr std::size_t kVoxelOffset = 108;
    write_file(folder / "begin.nii",
               Nifti().bytes().replace(kVoxelOffset, sizeof begin, bytes_of(begin)));
    check_refused(folder / "begin.nii", std::string("start at byte ") + text);
  }
  write_file(folder / "empty.nii.gz", gzip(""));
  check_refused(folder / "empty.nii.gz", "is no NIfTI");
  write_file(folder / "twice.nii.gz", gzip(gzip(Nifti().bytes())));
  check_refused(folder / "twice.nii.gz", "is no NIfTI");
  Nifti second;
  second.version = 2;
  write_file(folder / "short.nii", second.bytes().substr(0, 400));
  check_refused(folder / "short.nii", "is no NIfTI");
}

TEST_CASE("read_label_volume: more hostile MetaImage headers", "[io][unit]") {
  check_meta_refused({{"NDims", ""}}, "NDims = \"\"");
  check_meta_refused({{"NDims", "3.0"}}, "NDims = \"3.0\"");
  check_meta_refused({{"NDims", "12"}, {"DimSize", "4 3 2 1 1 1 1 1 1 1 1 1"}}, "12 dimensions");
  check_meta_refused({{"ElementSpacing", "1e999 1 1"}}, "no number");
  check_meta_refused({{"ElementSpacing", "0x10 1 1"}}, "no number");
  check_meta_refused({{"ElementSpacing", "1,5 1 1"}}, "no number");
  check_meta_refused({{"Offset", "0 0 inf"}}, "inf");
  check_meta_refused({{"ElementNumberOfChannels", "-1"}}, "vector");
  check_meta_refused({{"CompressedData", "True"}, {"CompressedDataSize", "-5"}},
                     "CompressedDataSize = \"-5\"");
  check_meta_refused({{"CompressedData", "True"}, {"CompressedDataSize", "99999999999999999999"}},
                     "no integer");
  check_meta_refused({{"CompressedData", "True"}}, "damaged");
  check_meta_refused({{"HeaderSize", "-1"}}, "foreign header");
  check_meta_refused({{"ElementByteOrderMSB", "perhaps"}}, "True or False");
  check_meta_refused({{std::string(100, 'k'), "1"}}, "is no MetaImage");
  check_meta_refused({{"Comment", std::string("a\0b", 3)}}, "is no MetaImage");
  std::vector<std::pair<std::string, std::string>> many;
  for (int i = 0; i < 300; ++i)
    many.emplace_back("Field" + std::to_string(i), "1");
  check_meta_refused(many, "more than 200");
  check_meta_refused({}, "its own name", kVoxels, "a.mha");
  const std::string bomb = zlib(kVoxels + std::string(std::size_t{64} << 20, '\0'));
  check_meta_refused({{"CompressedData", "True"}}, "beyond the voxels", bomb);
}

TEST_CASE("read_label_volume: more hostile NRRD headers", "[io][unit]") {
  check_nrrd_refused({{"dimension", "17"}}, "dimension \"17\"");
  check_nrrd_refused({{"type", "int256"}}, "voxel type");
  check_nrrd_refused({{"space directions", "(1,0,0) (0,1,0) (0,0,1"}}, "no vector");
  check_nrrd_refused({{"space directions", "(1,0,0) (0,nan,0) (0,0,1)"}}, "nan");
  check_nrrd_refused({{"space directions", "(1,0,0) (0,1,0)"}}, "no direction");
  check_nrrd_refused({{"space origin", "(1,2,3) (4,5,6)"}}, "2 vectors");
  check_nrrd_refused({{"kinds", "vector domain domain"}}, "kind \"vector\"");
  check_nrrd_refused({{"encoding", "hex"}}, "encoding");
  check_nrrd_refused({{"sizes", "4 3 2 "}, {"dimension", " 3x"}}, "dimension \"3x\"");
  check_nrrd_refused({{"data file", "a.nrrd"}}, "its own name");
  check_nrrd_refused({{"encoding", "gzip"}}, "beyond the voxels",
                     gzip(kVoxels + std::string(std::size_t{64} << 20, '\0')));
  const test_data::TemporaryFolder folder;
  std::string future = nrrd_header() + kVoxels;
  future[7] = '6';
  write_file(folder / "future.nrrd", future);
  check_refused(folder / "future.nrrd", "is no NRRD");
  write_file(folder / "twice.nrrd", "NRRD0004\ntype: uchar\ntype: short\n\n");
  check_refused(folder / "twice.nrrd", "twice");
  write_file(folder / "bare.nrrd", "NRRD0004\n\n");
  check_refused(folder / "bare.nrrd", "no complete NRRD");
  std::string endless = nrrd_header();
  endless.pop_back();  // the empty line that ends the header
  write_file(folder / "endless.nrrd", endless);
  check_refused(folder / "endless.nrrd", "cut short");
}

TEST_CASE("read_label_volume: a sibling that is a link is not followed", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "secret.raw", kVoxels);
  std::filesystem::create_directory(folder / "sub");
  std::filesystem::create_symlink("../secret.raw", folder / "sub/a.raw");
  write_file(folder / "sub/a.mhd", meta_header({}, "a.raw"));
  check_refused(folder / "sub/a.mhd", "a link");
  write_file(folder / "sub/a.nrrd", nrrd_header({{"data file", "a.raw"}}));
  check_refused(folder / "sub/a.nrrd", "a link");
}

TEST_CASE("read_label_volume: no prefix and no single flipped byte of a header is fatal",
          "[io][property]") {
  // Whatever happens to a header: an Error or a volume, never a crash, nothing printed.
  const test_data::TemporaryFolder folder;
  const std::pair<std::string, std::string> files[] = {
      {"a.nii", Nifti().bytes()},
      {"a.mha", meta_header() + kVoxels},
      {"a.nrrd", nrrd_header({{"space", "LPS"},
                              {"space directions", "(1,0,0) (0,1,0) (0,0,1)"},
                              {"space origin", "(0,0,0)"}}) +
                     kVoxels}};
  std::ostringstream printed;
  std::streambuf* const cerr = std::cerr.rdbuf(printed.rdbuf());
  int others = 0;
  const auto try_to_read = [&](const std::filesystem::path& path) {
    try {
      const InputVolume volume = read_label_volume(path);
      others += volume.values.size() != volume.frame.size();
    } catch (const Error& error) {
      others += error.code() != ErrorCode::BadInput;
    }
  };
  for (const auto& [name, bytes] : files) {
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      write_file(folder / name, bytes.substr(0, i));
      try_to_read(folder / name);
      for (const int flip : {0x01, 0x10, 0x80}) {
        std::string changed = bytes;
        changed[i] = static_cast<char>(changed[i] ^ flip);
        write_file(folder / name, changed);
        try_to_read(folder / name);
      }
    }
  }
  std::cerr.rdbuf(cerr);
  CHECK(others == 0);
  CHECK(printed.str().empty());
}
