// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/volume_reader.h"

#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cmath>
#include <map>

using namespace cvmesh;

namespace {

std::optional<InputVolume> read_if_there(const std::string& name) {
  const auto path = test_data::file(name);
  if (!path) {
    WARN("skipped: " << name << " is not in the folder of test data");
    return std::nullopt;
  }
  return read_label_volume(*path);
}

std::map<Label, std::size_t> voxels_per_label(const InputVolume& volume) {
  std::map<Label, std::size_t> counts;
  for (const Label label : volume.values)
    ++counts[label];
  return counts;
}

}  // namespace

TEST_CASE("read_label_volume: the oblique spine keeps its s-form", "[io][data]") {
  const auto volume = read_if_there("spine_verse004.nii.gz");
  if (!volume) return;
  const GridFrame& frame = volume->frame;
  CHECK(frame.dims == std::array<int, 3>{161, 338, 61});
  CHECK(frame.space == Space::Ras);
  CHECK(frame.spacing_mm.z == Approx(2.0003).margin(1e-3));
  // Oblique: no row is along an axis.
  const auto& rows = frame.index_to_world.rows;
  int entries = 0;
  for (const Vec3& row : rows)
    for (int k = 0; k < 3; ++k)
      entries += std::abs(row[k]) > 1e-6;
  CHECK(entries > 3);
  const auto counts = voxels_per_label(*volume);
  CHECK(counts.at(0) == 3116756);
  CHECK(counts.at(16) == 14110);
  CHECK(counts.at(24) == 29117);
}

TEST_CASE("read_label_volume: the tooth is the same from MetaImage and NIfTI", "[io][data]") {
  const auto meta = read_if_there("tooth.mha");
  const auto nifti = read_if_there("tooth.nii.gz");
  if (!meta || !nifti) return;
  CHECK(meta->frame.dims == nifti->frame.dims);
  CHECK(meta->values == nifti->values);
  CHECK(voxels_per_label(*meta).at(1) == 279490);
}

TEST_CASE("read_label_volume: the bunny is the same from NRRD and NIfTI", "[io][data]") {
  const auto nrrd = read_if_there("bunny.nrrd");
  const auto nifti = read_if_there("bunny.nii.gz");
  if (!nrrd || !nifti) return;
  CHECK(nrrd->frame.dims == std::array<int, 3>{173, 173, 181});
  CHECK(nrrd->frame.space == Space::Lps);
  CHECK(nrrd->values == nifti->values);
  CHECK(voxels_per_label(*nrrd).at(1) == 758706);
}

TEST_CASE("read_label_volume: the pelvis lies in one place, LPS and RAS up to sign",
          "[io][data][slow]") {
  const auto meta = read_if_there("pelvis_ref004.mha");
  const auto nifti = read_if_there("pelvis_ref004.nii.gz");
  if (!meta || !nifti) return;
  CHECK(meta->frame.space == Space::Lps);
  CHECK(nifti->frame.space == Space::Ras);
  CHECK(meta->values == nifti->values);
  const auto& dims = meta->frame.dims;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 index{corner & 1 ? dims[0] - 1.0 : 0, corner & 2 ? dims[1] - 1.0 : 0,
                     corner & 4 ? dims[2] - 1.0 : 0};
    const Vec3 lps = meta->frame.index_to_world(index), ras = nifti->frame.index_to_world(index);
    // NIfTI-1 stores single precision: 7 digits of 256 mm.
    CHECK(lps.x == Approx(-ras.x).margin(2e-5));
    CHECK(lps.y == Approx(-ras.y).margin(2e-5));
    CHECK(lps.z == Approx(ras.z).margin(2e-5));
  }
}
