// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_reader.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <cmath>
#include <cstdint>
#include <limits>

using namespace cvmesh;
using namespace cvmesh::image_files;

namespace {

std::vector<Label> counting_labels() {
  return counting<Label>();
}

void check_close(const Vec3& a, const Vec3& b, double tolerance) {
  CAPTURE(a.x, a.y, a.z, b.x, b.y, b.z);
  CHECK(distance(a, b) <= tolerance);
}

template <typename T>
void check_nifti_type(int datatype) {
  const test_data::TemporaryFolder folder;
  for (const int version : {1, 2})
    for (const bool is_swapped : {false, true})
      for (const bool is_packed : {false, true}) {
        CAPTURE(datatype, version, is_swapped, is_packed);
        Nifti nifti;
        nifti.version = version;
        nifti.is_swapped = is_swapped;
        nifti.datatype = datatype;
        nifti.voxels = bytes_of_all(counting<T>(), is_swapped);
        const auto path = folder / (is_packed ? "a.nii.gz" : "a.nii");
        write_file(path, is_packed ? gzip(nifti.bytes()) : nifti.bytes());
        const InputVolume volume = read_label_volume(path);
        CHECK(volume.frame.dims == std::array<int, 3>{4, 3, 2});
        CHECK(volume.values == counting_labels());
      }
}

template <typename T>
void check_meta_type(const std::string& type) {
  const test_data::TemporaryFolder folder;
  for (const bool is_big : {false, true})
    for (const bool is_packed : {false, true})
      for (const bool is_local : {false, true}) {
        CAPTURE(type, is_big, is_packed, is_local);
        const std::string raw = bytes_of_all(counting<T>(), is_big);
        const std::string data = is_packed ? zlib(raw) : raw;
        std::vector<std::pair<std::string, std::string>> fields = {
            {"ElementType", type},
            {"BinaryDataByteOrderMSB", is_big ? "True" : "False"},
            {"CompressedData", is_packed ? "True" : "False"}};
        if (is_packed) fields.push_back({"CompressedDataSize", std::to_string(data.size())});
        const auto path = folder / (is_local ? "a.mha" : "a.mhd");
        if (is_local) {
          write_file(path, meta_header(fields) + data);
        } else {
          write_file(path, meta_header(fields, "a.raw"));
          write_file(folder / "a.raw", data);
        }
        const InputVolume volume = read_label_volume(path, nullptr, {.allow_detached = !is_local});
        CHECK(volume.values == counting_labels());
        CHECK(volume.frame.space == Space::Lps);
      }
}

template <typename T>
void check_nrrd_type(const std::string& type) {
  const test_data::TemporaryFolder folder;
  for (const bool is_big : {false, true})
    for (const bool is_packed : {false, true}) {
      CAPTURE(type, is_big, is_packed);
      const std::string raw = bytes_of_all(counting<T>(), is_big);
      write_file(folder / "a.nrrd", nrrd_header({{"type", type},
                                                 {"endian", is_big ? "big" : "little"},
                                                 {"encoding", is_packed ? "gzip" : "raw"}}) +
                                        (is_packed ? gzip(raw) : raw));
      CHECK(read_label_volume(folder / "a.nrrd").values == counting_labels());
    }
}

}  // namespace

TEST_CASE("read_label_volume: every NIfTI type, version and byte order gives the same labels",
          "[io][unit]") {
  check_nifti_type<std::uint8_t>(2);
  check_nifti_type<std::int16_t>(4);
  check_nifti_type<std::int32_t>(8);
  check_nifti_type<float>(16);
  check_nifti_type<double>(64);
  check_nifti_type<std::int8_t>(256);
  check_nifti_type<std::uint16_t>(512);
  check_nifti_type<std::uint32_t>(768);
  check_nifti_type<std::int64_t>(1024);
  check_nifti_type<std::uint64_t>(1280);
}

TEST_CASE("read_label_volume: every MetaImage type, storage and byte order gives the same labels",
          "[io][unit]") {
  check_meta_type<std::uint8_t>("MET_UCHAR");
  check_meta_type<std::int8_t>("MET_CHAR");
  check_meta_type<std::uint16_t>("MET_USHORT");
  check_meta_type<std::int16_t>("MET_SHORT");
  check_meta_type<std::uint32_t>("MET_UINT");
  check_meta_type<std::int32_t>("MET_INT");
  check_meta_type<std::uint32_t>("MET_ULONG");
  check_meta_type<std::int32_t>("MET_LONG");
  check_meta_type<std::uint64_t>("MET_ULONG_LONG");
  check_meta_type<std::int64_t>("MET_LONG_LONG");
  check_meta_type<float>("MET_FLOAT");
  check_meta_type<double>("MET_DOUBLE");
}

TEST_CASE("read_label_volume: every NRRD type, encoding and byte order gives the same labels",
          "[io][unit]") {
  check_nrrd_type<std::uint8_t>("unsigned char");
  check_nrrd_type<std::int8_t>("signed char");
  check_nrrd_type<std::uint16_t>("uint16");
  check_nrrd_type<std::int16_t>("short");
  check_nrrd_type<std::uint32_t>("unsigned int");
  check_nrrd_type<std::int32_t>("int32_t");
  check_nrrd_type<std::uint64_t>("uint64");
  check_nrrd_type<std::int64_t>("long long");
  check_nrrd_type<float>("float");
  check_nrrd_type<double>("double");
}

TEST_CASE("read_label_volume: the whole range of Int32 survives", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  std::vector<std::int64_t> values(24, 0);
  values[0] = std::numeric_limits<std::int32_t>::min();
  values[1] = std::numeric_limits<std::int32_t>::max();
  values[2] = -1;
  nifti.datatype = 1024;
  nifti.voxels = bytes_of_all(values);
  write_file(folder / "a.nii", nifti.bytes());
  const InputVolume volume = read_label_volume(folder / "a.nii");
  CHECK(volume.values[0] == std::numeric_limits<std::int32_t>::min());
  CHECK(volume.values[1] == std::numeric_limits<std::int32_t>::max());
  CHECK(volume.values[2] == -1);
}

TEST_CASE("read_label_volume: a NIfTI s-form with shear and mirror is taken as it is",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.version = 2;  // doubles: exact values
  nifti.s_form.rows = {Vec3{-0.71, 0.2, 0.05}, Vec3{0.1, 0.93, -0.3}, Vec3{0.02, 0.4, 1.7}};
  nifti.s_form.offset = {-123.456, 78.9, 1e3 / 3};
  write_file(folder / "a.nii", nifti.bytes());
  const GridFrame frame = read_label_volume(folder / "a.nii", nullptr, {.allow_shear = true}).frame;
  CHECK(frame.index_to_world == nifti.s_form);
  CHECK(frame.index_to_world.determinant() < 0);
  CHECK(frame.space == Space::Ras);
  CHECK(frame.spacing_mm.x == Approx(std::sqrt(0.71 * 0.71 + 0.01 + 0.0004)).epsilon(1e-14));
  // Voxel (3, 2, 1) by hand, and through grid millimetres.
  const Vec3 expected{-0.71 * 3 + 0.2 * 2 + 0.05 - 123.456, 0.3 + 0.93 * 2 - 0.3 + 78.9,
                      0.06 + 0.8 + 1.7 + 1e3 / 3};
  check_close(frame.index_to_world({3, 2, 1}), expected, 1e-12);
  check_close(frame.mm_to_world(frame.index_to_mm({3, 2, 1})), expected, 1e-9);
}

TEST_CASE("read_label_volume: a NIfTI q-form is the rotation of its quaternion", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.version = 2;
  nifti.sform_code = 0;
  nifti.qform_code = 1;
  nifti.q_offset = {10, 20, 30};
  const double half = std::acos(-1.0) / 12;  // a turn of 30 degrees around z
  nifti.quaternion = {0, 0, std::sin(half)};
  for (const double qfac : {1.0, -1.0}) {
    nifti.pixdim = {qfac, 0.5, 2, 3, 1, 1, 1, 1};
    write_file(folder / "a.nii", nifti.bytes());
    const GridFrame frame = read_label_volume(folder / "a.nii").frame;
    const double c = std::sqrt(3.0) / 2, s = 0.5;
    check_close(frame.index_to_world({1, 0, 0}), {10 + 0.5 * c, 20 + 0.5 * s, 30}, 1e-12);
    check_close(frame.index_to_world({0, 1, 0}), {10 - 2 * s, 20 + 2 * c, 30}, 1e-12);
    check_close(frame.index_to_world({0, 0, 1}), {10, 20, 30 + 3 * qfac}, 1e-12);
    CHECK(frame.spacing_mm.x == Approx(0.5).epsilon(1e-14));
  }
}

TEST_CASE("read_label_volume: a half turn in single precision stays a rotation", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.sform_code = 0;
  nifti.qform_code = 1;
  // As floats these two sum to slightly more than 1 when squared.
  nifti.quaternion = {0, 0.70710683, 0.70710683};
  write_file(folder / "a.nii", nifti.bytes());
  const Affine map = read_label_volume(folder / "a.nii").frame.index_to_world;
  CHECK(map.determinant() == Approx(1).epsilon(1e-14));
  check_close(map({1, 0, 0}), {-1, 0, 0}, 1e-12);
}

TEST_CASE("read_label_volume: NIfTI oddities are told, and units become millimetres",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  std::vector<std::string> warnings;
  SECTION("an ordinary file has none") {
    write_file(folder / "a.nii", nifti.bytes());
    read_label_volume(folder / "a.nii", &warnings);
    CHECK(warnings.empty());
  }
  SECTION("neither form: voxel sizes alone") {
    nifti.sform_code = 0;
    nifti.pixdim = {1, 0.5, 2, 3, 1, 1, 1, 1};
    write_file(folder / "a.nii", nifti.bytes());
    const GridFrame frame = read_label_volume(folder / "a.nii", &warnings).frame;
    CHECK(frame.index_to_world({1, 1, 1}) == Vec3{0.5, 2, 3});
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0].find("no orientation") != std::string::npos);
  }
  SECTION("two forms that differ: the s-form") {
    nifti.qform_code = 1;
    nifti.q_offset = {100, 0, 0};
    write_file(folder / "a.nii", nifti.bytes());
    const GridFrame frame = read_label_volume(folder / "a.nii", &warnings).frame;
    CHECK(frame.index_to_world({0, 0, 0}) == Vec3{0, 0, 0});
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0].find("differently") != std::string::npos);
  }
  SECTION("microns") {
    nifti.units = 3;
    nifti.s_form.rows = {Vec3{500, 0, 0}, Vec3{0, 500, 0}, Vec3{0, 0, 500}};
    nifti.s_form.offset = {1000, 0, 0};
    write_file(folder / "a.nii", nifti.bytes());
    const GridFrame frame = read_label_volume(folder / "a.nii", &warnings).frame;
    CHECK(frame.spacing_mm.x == Approx(0.5).epsilon(1e-14));
    CHECK(frame.index_to_world({0, 0, 0}).x == Approx(1).epsilon(1e-14));
    REQUIRE(warnings.size() == 1);
  }
}

TEST_CASE("read_label_volume: a NIfTI extension before the voxels is skipped", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.extension = std::string(4 + 100'000, '\7');
  nifti.voxels = bytes_of_all(counting<std::uint8_t>());
  write_file(folder / "a.nii", nifti.bytes());
  write_file(folder / "b.nii.gz", gzip(nifti.bytes()));
  CHECK(read_label_volume(folder / "a.nii").values == counting_labels());
  CHECK(read_label_volume(folder / "b.nii.gz").values == counting_labels());
}

TEST_CASE("read_label_volume: gzip members, padding and either name are all fine", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.voxels = bytes_of_all(counting<std::uint8_t>());
  const std::string bytes = nifti.bytes();
  write_file(folder / "members.nii.gz", gzip(bytes.substr(0, 360)) + gzip(bytes.substr(360)));
  write_file(folder / "padded.nii.gz", gzip(bytes) + std::string(512, '\0'));
  write_file(folder / "plain.nii.gz", bytes);  // unpacked on the way, by a browser
  write_file(folder / "packed.nii", gzip(bytes));
  write_file(folder / "CAPITALS.NII.GZ", gzip(bytes));
  for (const char* name :
       {"members.nii.gz", "padded.nii.gz", "plain.nii.gz", "packed.nii", "CAPITALS.NII.GZ"}) {
    CAPTURE(name);
    CHECK(read_label_volume(folder / name).values == counting_labels());
  }
}

TEST_CASE("read_label_volume: a.nii beside a.nii.gz is left alone", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti three, seven;
  three.voxels = std::string(24, '\3');
  seven.voxels = std::string(24, '\7');
  write_file(folder / "a.nii.gz", gzip(three.bytes()));
  write_file(folder / "a.nii", seven.bytes());
  CHECK(read_label_volume(folder / "a.nii.gz").values == std::vector<Label>(24, 3));
}

TEST_CASE("read_label_volume: trailing dimensions of one are no fourth dimension", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  nifti.voxels = bytes_of_all(counting<std::uint8_t>());
  nifti.dim = {5, 4, 3, 2, 1, 1, 1, 1};
  write_file(folder / "a.nii", nifti.bytes());
  CHECK(read_label_volume(folder / "a.nii").values == counting_labels());
  write_file(folder / "a.mha",
             meta_header({{"NDims", "4"},
                          {"DimSize", "4 3 2 1"},
                          {"Offset", "1 2 3 0"},
                          {"CenterOfRotation", "0 0 0 0"},
                          {"ElementSpacing", "1 2 3 1"},
                          {"TransformMatrix", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"}}) +
                 bytes_of_all(counting<std::uint8_t>()));
  const InputVolume volume = read_label_volume(folder / "a.mha");
  CHECK(volume.values == counting_labels());
  CHECK(volume.frame.index_to_world({1, 1, 1}) == Vec3{2, 4, 6});
}

TEST_CASE("read_label_volume: floats within the tolerance are rounded, never cut off",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  Nifti nifti;
  std::vector<float> values(24, 0.0f);
  values[1] = 1.9995f;
  values[2] = -2.9995f;
  values[3] = 3.0005f;
  nifti.datatype = 16;
  nifti.voxels = bytes_of_all(values);
  write_file(folder / "a.nii", nifti.bytes());
  const InputVolume volume = read_label_volume(folder / "a.nii");
  CHECK(volume.values[1] == 2);
  CHECK(volume.values[2] == -3);
  CHECK(volume.values[3] == 3);
}

TEST_CASE("read_label_volume: a MetaImage's matrix lists its axes one after the other",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  // Axis i points to +y, axis j to -x, axis k to +z, with spacings 2, 3, 4.
  write_file(folder / "a.mha", meta_header({{"TransformMatrix", "0 1 0 -1 0 0 0 0 1"},
                                            {"ElementSpacing", "2 3 4"},
                                            {"Offset", "10 20 30"},
                                            {"AnatomicalOrientation", "LPI"}}) +
                                   std::string(24, '\1'));
  const GridFrame frame = read_label_volume(folder / "a.mha").frame;
  CHECK(frame.index_to_world({1, 0, 0}) == Vec3{10, 22, 30});
  CHECK(frame.index_to_world({0, 1, 0}) == Vec3{7, 20, 30});
  CHECK(frame.index_to_world({0, 0, 1}) == Vec3{10, 20, 34});
  CHECK(frame.spacing_mm == Vec3{2, 3, 4});
  CHECK(frame.space == Space::Lps);
}

TEST_CASE("read_label_volume: a sheared and mirrored MetaImage is taken as it is", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.mha", meta_header({{"TransformMatrix", "-1 0.1 0 0 1 0 0 0 1"},
                                            {"Position", "1 2 3"},
                                            {"Offset", "1 2 3"}}) +
                                   std::string(24, '\1'));
  CHECK_THROWS(read_label_volume(folder / "a.mha"));  // two names for one thing
  write_file(folder / "a.mha",
             meta_header({{"TransformMatrix", "-1 0.1 0 0 1 0 0 0 1"}}) + std::string(24, '\1'));
  const GridFrame frame = read_label_volume(folder / "a.mha", nullptr, {.allow_shear = true}).frame;
  CHECK(frame.index_to_world({1, 0, 0}) == Vec3{-1, 0.1, 0});
  CHECK(frame.index_to_world.determinant() == -1);
}

TEST_CASE("read_label_volume: Windows line ends in a header do not shift the voxels",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  std::string text = meta_header({}, "a.raw"), windows;
  for (const char c : text)
    windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  write_file(folder / "a.mhd", windows);
  write_file(folder / "a.raw", bytes_of_all(counting<std::uint8_t>()));
  CHECK(read_label_volume(folder / "a.mhd", nullptr, {.allow_detached = true}).values ==
        counting_labels());
}

TEST_CASE("read_label_volume: an NRRD's space is the one it declares", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const std::pair<std::string, Space> cases[] = {
      {"left-posterior-superior", Space::Lps}, {"LPS", Space::Lps},
      {"right-anterior-superior", Space::Ras}, {"RAS", Space::Ras},
      {"left-anterior-superior", Space::Las},  {"LAS", Space::Las},
      {"scanner-xyz", Space::Unknown}};
  for (const auto& [name, space] : cases) {
    CAPTURE(name);
    write_file(folder / "a.nrrd", nrrd_header({{"space", name},
                                               {"space directions", "(0, 2,0) (-3,0,0) (0,0.5,4)"},
                                               {"space origin", "(10,20,30)"},
                                               {"kinds", "domain domain domain"}}) +
                                      bytes_of_all(counting<std::uint8_t>()));
    const InputVolume volume = read_label_volume(folder / "a.nrrd", nullptr, {.allow_shear = true});
    CHECK(volume.frame.space == space);
    CHECK(volume.frame.index_to_world({1, 0, 0}) == Vec3{10, 22, 30});
    CHECK(volume.frame.index_to_world({0, 1, 0}) == Vec3{7, 20, 30});
    CHECK(volume.frame.index_to_world({0, 0, 1}) == Vec3{10, 20.5, 34});
    CHECK(volume.values == counting_labels());
  }
}

TEST_CASE("read_label_volume: an NRRD without a space has spacings only", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.nrrd", nrrd_header({{"spacings", "0.5 nan 2"}}) + std::string(24, '\1'));
  const GridFrame frame = read_label_volume(folder / "a.nrrd").frame;
  CHECK(frame.space == Space::Unknown);
  CHECK(frame.spacing_mm == Vec3{0.5, 1, 2});
  CHECK(frame.index_to_world({1, 1, 1}) == Vec3{0.5, 1, 2});
}

TEST_CASE("read_label_volume: an NRRD header may be long and point to a plain sibling",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  std::string text = nrrd_header({{"data file", "a.raw"}});
  text.pop_back();
  for (int i = 0; i < 5000; ++i)
    text += "Segment" + std::to_string(i) + "_Name:=a name of some length\n";
  write_file(folder / "a.nrrd", text + "\n");
  write_file(folder / "a.raw", bytes_of_all(counting<std::uint8_t>()));
  CHECK(read_label_volume(folder / "a.nrrd", nullptr, {.allow_detached = true}).values ==
        counting_labels());
}

TEST_CASE("read_label_volume: a path without a folder works, sibling included", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "a.mhd", meta_header({}, "a.raw"));
  write_file(folder / "a.raw", bytes_of_all(counting<std::uint8_t>()));
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  const InputVolume volume = read_label_volume("a.mhd", nullptr, {.allow_detached = true});
  std::filesystem::current_path(before);
  CHECK(volume.values == counting_labels());
}

TEST_CASE("read_label_volume: one volume of a 4-D file by its number", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const std::string frames = bytes_of_all(counting<std::uint8_t>(72));
  Nifti nifti;
  nifti.dim = {4, 4, 3, 2, 3, 1, 1, 1};
  nifti.voxels = frames;
  write_file(folder / "a.nii", nifti.bytes());
  write_file(folder / "a.nii.gz", gzip(nifti.bytes()));
  const std::vector<std::pair<std::string, std::string>> meta = {
      {"NDims", "4"},
      {"DimSize", "4 3 2 3"},
      {"Offset", "0 0 0 0"},
      {"CenterOfRotation", "0 0 0 0"},
      {"ElementSpacing", "1 1 1 1"},
      {"TransformMatrix", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"}};
  write_file(folder / "a.mha", meta_header(meta) + frames);
  auto packed_meta = meta;
  packed_meta.emplace_back("CompressedData", "True");
  write_file(folder / "b.mha", meta_header(packed_meta) + zlib(frames));
  const std::vector<std::pair<std::string, std::string>> nrrd = {{"dimension", "4"},
                                                                 {"sizes", "4 3 2 3"}};
  write_file(folder / "a.nrrd", nrrd_header(nrrd) + frames);
  auto packed_nrrd = nrrd;
  packed_nrrd.emplace_back("encoding", "gzip");
  write_file(folder / "b.nrrd", nrrd_header(packed_nrrd) + gzip(frames));
  for (const char* name : {"a.nii", "a.nii.gz", "a.mha", "b.mha", "a.nrrd", "b.nrrd"}) {
    CAPTURE(name);
    for (const int chosen : {0, 1, 2}) {
      const InputVolume volume = read_label_volume(folder / name, nullptr, {.volume = chosen});
      CHECK(volume.frame.dims == std::array<int, 3>{4, 3, 2});
      CHECK(volume.values.front() == 24 * chosen);
      CHECK(volume.values.back() == 24 * chosen + 23);
    }
    CHECK_THROWS_WITH(read_label_volume(folder / name, nullptr, {.volume = 3}),
                      Catch::Contains("has no volume 3; choose 0 to 2"));
    CHECK_THROWS_WITH(read_label_volume(folder / name),
                      Catch::Contains("4 dimensions (4 x 3 x 2 x 3); choose one of its volumes"));
  }
  // A damaged volume that was not asked for is a damaged file.
  std::string cut = nifti.bytes();
  cut.pop_back();
  write_file(folder / "a.nii", cut);
  CHECK_THROWS_WITH(read_label_volume(folder / "a.nii", nullptr, {.volume = 0}),
                    Catch::Contains("cut short"));
  // A number for a file of one volume: only 0 exists.
  write_file(folder / "one.nii", Nifti{}.bytes());
  CHECK_NOTHROW(read_label_volume(folder / "one.nii", nullptr, {.volume = 0}));
  CHECK_THROWS(read_label_volume(folder / "one.nii", nullptr, {.volume = 1}));
}

TEST_CASE("read_label_volume: shear of a percent passes, more must be asked for", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const auto read_sheared = [&](double shear, const ReadVolumeOptions& options) {
    Nifti nifti;
    nifti.version = 2;
    nifti.s_form.rows[0] = {1, shear, 0};
    write_file(folder / "a.nii", nifti.bytes());
    return read_label_volume(folder / "a.nii", nullptr, options).frame.index_to_world;
  };
  CHECK(read_sheared(0.002, {}).rows[0] == Vec3{1, 0.002, 0});
  CHECK(read_sheared(-0.0099, {}).rows[0] == Vec3{1, -0.0099, 0});
  CHECK_THROWS_WITH(read_sheared(0.02, {}), Catch::Contains("--allow-shear"));
  CHECK_THROWS_WITH(read_sheared(-0.2, {}), Catch::Contains("sheared"));
  CHECK(read_sheared(0.2, {.allow_shear = true}).rows[0] == Vec3{1, 0.2, 0});
  // A sheared s-form wins over a straight q-form, as always: it is never dropped in silence.
  Nifti both;
  both.qform_code = 1;
  both.s_form.rows[0] = {1, 0.2, 0};
  write_file(folder / "both.nii", both.bytes());
  std::vector<std::string> warnings;
  CHECK_THROWS_WITH(read_label_volume(folder / "both.nii", &warnings),
                    Catch::Contains("--allow-shear"));
  read_label_volume(folder / "both.nii", &warnings, {.allow_shear = true});
  REQUIRE(warnings.size() == 1);
  CHECK(warnings[0].find("differently") != std::string::npos);
}
