// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/labels/lattice_components.h"

#include "phantoms/phantoms.h"
#include "phantoms/write_nifti.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include "support/test_data.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>
#include <zlib.h>

namespace cvmesh {
namespace {

/// Components on the 14-neighbour lattice, by label.
std::map<Label, int> components(const InputVolume& volume) {
  Grid<MaterialId> ids(volume.frame);
  for (std::size_t n = 0; n < ids.values.size(); ++n) {
    ids.values[n] = static_cast<MaterialId>(volume.values[n]);
  }
  std::map<Label, int> count;
  for (const MaterialId id : find_lattice_components(ids).material_of)
    ++count[id];
  return count;
}

/// Labels that share a voxel face with `label`.
std::set<Label> neighbours(const InputVolume& volume, Label label) {
  const auto& dims = volume.frame.dims;
  std::set<Label> found;
  const auto look = [&](Label a, Label b) {
    if (a == b) return;
    if (a == label) found.insert(b);
    if (b == label) found.insert(a);
  };
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      for (int i = 0; i < dims[0]; ++i) {
        const Label here = volume(i, j, k);
        if (i + 1 < dims[0]) look(here, volume(i + 1, j, k));
        if (j + 1 < dims[1]) look(here, volume(i, j + 1, k));
        if (k + 1 < dims[2]) look(here, volume(i, j, k + 1));
      }
    }
  }
  return found;
}

std::vector<unsigned char> read_gzip(const std::filesystem::path& path) {
  const gzFile in = gzopen(path.c_str(), "rb");
  REQUIRE(in != nullptr);
  std::vector<unsigned char> bytes;
  unsigned char chunk[4096];
  for (int n = 0; (n = gzread(in, chunk, sizeof chunk)) > 0;) {
    bytes.insert(bytes.end(), chunk, chunk + n);
  }
  gzclose(in);
  return bytes;
}

template <typename T>
T value_at(const std::vector<unsigned char>& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

}  // namespace

TEST_CASE("femur: six tissues in as many pieces as anatomy has", "[examples][unit]") {
  const double size = GENERATE(0.24, 0.33, 0.5);
  CAPTURE(size);
  const InputVolume volume = examples::femur(size);
  CHECK(volume.frame.dims[0] == static_cast<int>(250 * size + 0.5));
  CHECK(volume.frame.dims[2] == static_cast<int>(500 * size + 0.5));
  CHECK(volume.frame.spacing_mm == Vec3{0.5, 0.4, 0.8});

  std::map<Label, int> pieces = components(volume);
  pieces.erase(0);
  REQUIRE(pieces.size() == 6);
  CHECK(pieces[1] == 1);  // prosthesis
  CHECK(pieces[2] == 1);  // cement
  CHECK(pieces[5] == 1);  // cortex
  CHECK(pieces[3] <= 4);  // below the plug, and pockets that cement and cortex part
  CHECK(pieces[4] <= 6);  // proximal, distal, and pockets
  CHECK(pieces[6] <= 4);  // three patches
}

TEST_CASE("femur: tissues touch what they touch in a patient", "[examples][unit]") {
  const InputVolume volume = examples::femur(examples::kMedium);
  // The box has a margin, so that no tissue is cut off.
  const auto& dims = volume.frame.dims;
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      for (int i = 0; i < dims[0]; ++i) {
        if (i == 0 || j == 0 || k == 0 || i + 1 == dims[0] || j + 1 == dims[1] ||
            k + 1 == dims[2]) {
          REQUIRE(volume(i, j, k) == 0);
        }
      }
    }
  }
  CHECK(neighbours(volume, 5).count(0) == 1);  // the cortex is the outside of the bone,
  CHECK(neighbours(volume, 4).count(0) == 1);  // the saw cut lays trabecular bone open,
  CHECK(neighbours(volume, 1).count(0) == 1);  // and head and neck of the prosthesis stand free.
  CHECK(neighbours(volume, 3).count(0) == 0);
  CHECK(neighbours(volume, 6).count(0) == 0);
  CHECK(neighbours(volume, 6).count(1) == 0);  // fibrous tissue is outside the cement mantle
  CHECK(neighbours(volume, 6).count(2) == 1);
  CHECK(neighbours(volume, 3).count(1) == 0);  // the mantle parts stem and canal
}

TEST_CASE("femur: a size out of range is refused", "[examples][unit]") {
  CHECK_THROWS_AS(examples::femur(0.1), Error);
  CHECK_THROWS_AS(examples::femur(3), Error);
}

TEST_CASE("body: sixty labels, each in one piece, none at the border", "[examples][unit]") {
  const InputVolume volume = examples::body(examples::kMinBodySize);
  CHECK(volume.frame.dims == std::array<std::int32_t, 3>{128, 128, 150});
  std::map<Label, int> pieces = components(volume);
  pieces.erase(0);
  REQUIRE(pieces.size() == 60);
  for (const auto& [label, count] : pieces) {
    CAPTURE(label);
    CHECK(count == 1);
  }
  CHECK(neighbours(volume, 0) == std::set<Label>{1});        // nothing but skin sees the air,
  CHECK(neighbours(volume, 2).count(4) == 0);                // and muscle parts fat and organs
  CHECK(neighbours(volume, 49) == std::set<Label>{47, 50});  // the aorta leaves the heart
  CHECK_THROWS_AS(examples::body(0.1), Error);
}

TEST_CASE("spheres, torus, plate: volumes are those of the shapes", "[examples][unit]") {
  using std::numbers::pi;
  const InputVolume spheres = examples::spheres(1);
  // A voxelised ball of radius R is off by noise of about sqrt(4 pi R²) / 2 voxels: 2 % is ample.
  CHECK(phantoms::volume_mm3(spheres, 1) == Approx(4.0 / 3 * pi * 9 * 9 * 9).epsilon(0.02));
  CHECK(components(spheres) == std::map<Label, int>{{1, 1}, {2, 1}, {3, 1}});
  CHECK(neighbours(spheres, 1) == std::set<Label>{2});
  CHECK(neighbours(spheres, 3) == std::set<Label>{0, 2});
  const InputVolume torus = examples::torus(1);
  CHECK(phantoms::volume_mm3(torus, 1) == Approx(2 * pi * pi * 17 * 7 * 7).epsilon(0.02));
  const InputVolume plate = examples::plate(1);
  CHECK(phantoms::volume_mm3(plate, 1) == Approx(36.0 * 26 * 2).epsilon(0.03));
  CHECK(components(plate) == std::map<Label, int>{{1, 1}});
}

TEST_CASE("write_nifti: header says where the voxels are", "[examples][unit]") {
  const test_data::TemporaryFolder folder;
  const InputVolume ball = phantoms::rotated(phantoms::ball(2, phantoms::kAnisotropic, 7),
                                             {1, -2, 3}, 75, {10, 20, -30});
  examples::write_nifti(ball, folder / "ball.nii.gz");
  const auto bytes = read_gzip(folder / "ball.nii.gz");
  REQUIRE(bytes.size() == 352 + ball.values.size());  // one byte per voxel
  CHECK(value_at<std::int32_t>(bytes, 0) == 348);
  CHECK(std::memcmp(bytes.data() + 344, "n+1", 4) == 0);

  const Affine& map = ball.frame.index_to_world;
  const double b = value_at<float>(bytes, 256), c = value_at<float>(bytes, 260),
               d = value_at<float>(bytes, 264), a = std::sqrt(1 - b * b - c * c - d * d);
  const double rotation[3][3] = {
      {a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)},
      {2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)},
      {2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - c * c - b * b}};
  for (int r = 0; r < 3; ++r) {
    CHECK(value_at<std::int16_t>(bytes, 42 + 2 * r) == ball.frame.dims[r]);
    CHECK(value_at<float>(bytes, 80 + 4 * r) == Approx(ball.frame.spacing_mm[r]));
    CHECK(value_at<float>(bytes, 280 + 16 * r + 12) == Approx(map.offset[r]));
    for (int n = 0; n < 3; ++n) {
      CAPTURE(r, n);
      CHECK(value_at<float>(bytes, 280 + 16 * r + 4 * n) == Approx(map.rows[r][n]).margin(1e-6));
      CHECK(rotation[r][n] * ball.frame.spacing_mm[n] == Approx(map.rows[r][n]).margin(1e-6));
    }
  }
  const std::vector<unsigned char> voxels(bytes.begin() + 352, bytes.end());
  CHECK(static_cast<std::size_t>(std::count(voxels.begin(), voxels.end(), 7)) ==
        phantoms::voxel_count(ball, 7));
}

TEST_CASE("write_nifti: labels beyond a byte are kept, a mirrored grid is marked",
          "[examples][unit]") {
  const test_data::TemporaryFolder folder;
  const InputVolume ball = phantoms::mirrored(phantoms::ball(2, phantoms::kIsotropic, -70000));
  examples::write_nifti(ball, folder / "ball.nii");
  const auto bytes = read_gzip(folder / "ball.nii");  // zlib reads plain files as they are
  REQUIRE(bytes.size() == 352 + 4 * ball.values.size());
  CHECK(value_at<float>(bytes, 76) == -1);  // qfac
  CHECK(value_at<float>(bytes, 280) == -1);
  std::size_t count = 0;
  for (std::size_t n = 0; n < ball.values.size(); ++n) {
    count += value_at<std::int32_t>(bytes, 352 + 4 * n) == -70000 ? 1 : 0;
  }
  CHECK(count == phantoms::voxel_count(ball, -70000));
}

TEST_CASE("write_nifti: a folder that is not there is an Output error and leaves nothing",
          "[examples][unit]") {
  const test_data::TemporaryFolder folder;
  try {
    examples::write_nifti(phantoms::ball(2), folder / "absent" / "ball.nii.gz");
    FAIL("no error");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Output);
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("phantoms: every small phantom is small, has labels and a margin", "[examples][unit]") {
  for (const auto& [name, volume] : phantoms::all_small()) {
    CAPTURE(name);
    CHECK(volume.values.size() == volume.frame.size());
    CHECK(volume.values.size() < 60000);
    const std::set<Label> labels(volume.values.begin(), volume.values.end());
    CHECK(labels.size() >= 2);
    CHECK((labels.count(0) == 1) == (name != "box without background"));
    if (labels.count(0) == 0) continue;
    const auto& dims = volume.frame.dims;
    int outermost = 0;
    for (int k = 0; k < dims[2]; ++k) {
      for (int j = 0; j < dims[1]; ++j) {
        for (int i = 0; i < dims[0]; ++i) {
          const bool is_inner =
              i > 0 && j > 0 && k > 0 && i + 1 < dims[0] && j + 1 < dims[1] && k + 1 < dims[2];
          if (!is_inner && volume(i, j, k) != 0) ++outermost;
        }
      }
    }
    CHECK(outermost == 0);
  }
}

TEST_CASE("phantoms: volumes are those of the shapes", "[examples][unit]") {
  using std::numbers::pi;
  CHECK(phantoms::volume_mm3(phantoms::ball(8), 1) == Approx(4.0 / 3 * pi * 512).epsilon(0.02));
  CHECK(phantoms::volume_mm3(phantoms::ball(5, phantoms::kAnisotropic), 1) ==
        Approx(4.0 / 3 * pi * 125).epsilon(0.02));
  const InputVolume wedge = phantoms::three_material_wedge(60, 12);
  CHECK(phantoms::volume_mm3(wedge, 1) == Approx(4.0 / 3 * pi * 1728 / 6).epsilon(0.06));
  const InputVolume boxes = phantoms::touching_boxes({8, 7, 6});
  CHECK(phantoms::voxel_count(boxes, 1) == 8 * 7 * 6);
  CHECK(phantoms::voxel_count(boxes, 2) == 8 * 7 * 6);
  CHECK(phantoms::voxel_count(phantoms::one_voxel_label(), 2) == 1);
  CHECK(components(phantoms::one_voxel_island()) == std::map<Label, int>{{1, 2}});
  CHECK(phantoms::voxel_count(phantoms::box_without_background(), 0) == 0);
  const InputVolume blobs = phantoms::random_blobs(3, 6);
  for (Label label = 1; label <= 6; ++label)
    CHECK(phantoms::voxel_count(blobs, label) > 0);
  CHECK(phantoms::random_blobs(3, 6).values == blobs.values);
  CHECK(phantoms::random_blobs(4, 6).values != blobs.values);
}

}  // namespace cvmesh
