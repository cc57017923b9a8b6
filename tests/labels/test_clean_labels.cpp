// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/lattice_topology.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include <algorithm>
#include <cmath>
#include <optional>

using namespace cvmesh;

namespace {

InputVolume filled(int nx, int ny, int nz, Label label = 0) {
  return InputVolume(phantoms::centred_frame({nx, ny, nz}, phantoms::kAnisotropic), label);
}

void put_box(InputVolume& volume, std::array<int, 3> lo, std::array<int, 3> hi, Label label) {
  for (int k = lo[2]; k <= hi[2]; ++k) {
    for (int j = lo[1]; j <= hi[1]; ++j) {
      for (int i = lo[0]; i <= hi[0]; ++i)
        volume(i, j, k) = label;
    }
  }
}

CleanLabelsResult clean(const InputVolume& input, const CleanLabelsOptions& options = {}) {
  return clean_labels(input, options, silent_context());
}

// The user label of an input voxel in the result; nothing where the crop leaves it out.
std::optional<Label> label_at(const LabelVolume& labels, int i, int j, int k) {
  i -= labels.first_voxel[0];
  j -= labels.first_voxel[1];
  k -= labels.first_voxel[2];
  if (!labels.frame().contains(i, j, k)) return {};
  return labels.label_of[labels.ids(i, j, k)];
}

// Which code clean_labels fails with, and whether its message has `words`.
void check_fails(const InputVolume& input,
                 const CleanLabelsOptions& options,
                 ErrorCode code,
                 const std::string& words) {
  try {
    clean(input, options);
    FAIL("clean_labels accepted a bad input");
  } catch (const Error& error) {
    CHECK(error.code() == code);
    CHECK_THAT(error.what(), Catch::Contains(words));
  }
}

}  // namespace

TEST_CASE("clean_labels: ids are compact and ascend with the labels, negative ones first",
          "[labels][unit]") {
  InputVolume input = filled(12, 8, 8);
  put_box(input, {2, 2, 2}, {3, 5, 5}, 700);
  put_box(input, {4, 2, 2}, {6, 5, 5}, -3);
  put_box(input, {7, 2, 2}, {9, 5, 5}, 12);
  CleanLabelsOptions options;
  options.names[12] = "bone";
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.label_of == std::vector<Label>{0, -3, 12, 700});
  CHECK(result.labels.name_of ==
        std::vector<std::string>{"exterior", "label_-3", "bone", "label_700"});
  REQUIRE(result.stats.accounts.size() == 3);
  CHECK(result.stats.accounts[0].label == -3);
  CHECK(result.stats.accounts[0].voxels_in == 48);
  CHECK(result.stats.accounts[0].voxels_kept == 48);
  CHECK(result.stats.accounts[1].name == "bone");
  CHECK(result.stats.accounts[2].components_in == 1);
}

TEST_CASE("clean_labels: crops to the content and one layer, world coordinates stay",
          "[labels][unit]") {
  InputVolume input = phantoms::rotated(filled(20, 16, 12), {1, 2, 3}, 33, {5, -7, 11});
  put_box(input, {5, 4, 3}, {9, 8, 11}, 1);  // reaches the last slice
  const LabelVolume labels = clean(input).labels;
  CHECK(labels.first_voxel == std::array<int, 3>{4, 3, 2});
  CHECK(labels.frame().dims == std::array<int, 3>{7, 7, 10});
  CHECK(labels.input_dims == std::array<int, 3>{20, 16, 12});
  const Vec3 before = input.frame.index_to_world({7, 6, 5});
  const Vec3 after = labels.frame().index_to_world({3, 3, 3});
  CHECK(distance(before, after) < 1e-12);
  CHECK(labels.ids(3, 3, 3) == 1);
  CHECK(labels.ids(0, 3, 3) == kExterior);
  CHECK(labels.ids(3, 3, 9) == 1);  // no exterior layer where the input ends
}

TEST_CASE("clean_labels: a volume without label 0 keeps its box", "[labels][unit]") {
  const InputVolume input = phantoms::box_without_background({9, 8, 7});
  const LabelVolume labels = clean(input).labels;
  CHECK(labels.frame().dims == input.frame.dims);
  CHECK(std::count(labels.ids.values.begin(), labels.ids.values.end(), kExterior) == 0);
  CHECK(labels.label_of == std::vector<Label>{0, 1, 2});
}

TEST_CASE("clean_labels: mesh_background makes label 0 a material of the whole box",
          "[labels][unit]") {
  InputVolume input = filled(9, 9, 9);
  put_box(input, {3, 3, 3}, {5, 5, 5}, 4);
  put_box(input, {4, 4, 4}, {4, 4, 4}, -2);
  CleanLabelsOptions options;
  options.mesh_background = true;
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.frame().dims == input.frame.dims);
  CHECK(result.labels.label_of == std::vector<Label>{0, -2, 0, 4});
  CHECK(label_at(result.labels, 0, 0, 0) == 0);
  CHECK(result.labels.ids(0, 0, 0) == 2);
  REQUIRE(result.stats.accounts.size() == 3);
  CHECK(result.stats.accounts[1].label == 0);
  CHECK(result.stats.accounts[1].voxels_kept == 729 - 27);
}

TEST_CASE("clean_labels: islands go to the label they share most faces with", "[labels][unit]") {
  // Label 1 left, label 2 right; islands of label 1 inside label 2 and in the open.
  InputVolume input = filled(20, 12, 12);
  put_box(input, {2, 2, 2}, {8, 9, 9}, 1);
  put_box(input, {9, 2, 2}, {17, 9, 9}, 2);
  put_box(input, {13, 5, 5}, {14, 5, 5}, 1);
  input(17, 9, 9) = 1;  // at a corner of label 2: three faces to it, three to the exterior
  input(18, 5, 5) = 1;  // one face to label 2, five to the exterior
  CleanLabelsOptions options;
  options.min_island_voxels = 3;
  const CleanLabelsResult result = clean(input, options);
  CHECK(label_at(result.labels, 13, 5, 5) == 2);
  CHECK(label_at(result.labels, 14, 5, 5) == 2);
  CHECK(label_at(result.labels, 17, 9, 9) == 0);  // a tie: the smaller label
  CHECK(label_at(result.labels, 18, 5, 5).value_or(0) == 0);
  CHECK(result.stats.islands_removed == 3);
  CHECK(result.stats.island_voxels == 4);
  CHECK(result.stats.accounts[0].components_in == 4);
  CHECK(result.stats.accounts[0].components_kept == 1);
  CHECK(result.stats.accounts[0].voxels_in == 7 * 64 + 4);
  CHECK(result.stats.accounts[0].voxels_kept == 7 * 64);
  CHECK(result.stats.accounts[1].voxels_kept == 9 * 64 - 1);
}

TEST_CASE("clean_labels: a tie between a negative label and the exterior goes to the negative",
          "[labels][unit]") {
  InputVolume input = filled(16, 8, 8);
  put_box(input, {2, 2, 2}, {5, 5, 5}, -1);
  put_box(input, {8, 2, 2}, {11, 5, 5}, 3);
  input(5, 5, 5) = 3;
  CleanLabelsOptions options;
  options.min_island_voxels = 2;
  CHECK(label_at(clean(input, options).labels, 5, 5, 5) == -1);
}

TEST_CASE("clean_labels: the default removes nothing, not even one voxel", "[labels][unit]") {
  const CleanLabelsResult result = clean(phantoms::one_voxel_island());
  CHECK(result.stats.islands_removed == 0);
  CHECK(result.stats.accounts[0].components_kept == 2);
}

TEST_CASE("clean_labels: the largest component stays however small it is", "[labels][unit]") {
  const InputVolume input = phantoms::one_voxel_label();
  CleanLabelsOptions options;
  options.min_island_voxels = 1000000;
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.stats.islands_removed == 0);
  CHECK(result.labels.label_of == std::vector<Label>{0, 1, 2});
  CHECK(result.stats.accounts[1].voxels_kept == 1);
}

TEST_CASE("clean_labels: an island that grew by another's voxels is counted anew",
          "[labels][unit]") {
  // In the exterior: a bar of three voxels of label 1 with one voxel of label 2 in its gap. The
  // voxel goes to label 1 first and makes one bar of six, which is no island at a bound of six.
  InputVolume input = filled(24, 9, 9);
  put_box(input, {2, 2, 2}, {4, 6, 6}, 1);
  put_box(input, {18, 2, 2}, {21, 6, 6}, 2);
  put_box(input, {8, 4, 4}, {10, 4, 4}, 1);
  put_box(input, {12, 4, 4}, {13, 4, 4}, 1);
  put_box(input, {10, 3, 4}, {12, 3, 4}, 1);  // wraps the voxel: it shares most faces with label 1
  put_box(input, {10, 5, 4}, {12, 5, 4}, 1);
  input(11, 4, 4) = 2;
  input(11, 4, 5) = 1;
  CleanLabelsOptions options;
  options.min_island_voxels = 12;
  const CleanLabelsResult result = clean(input, options);
  CHECK(label_at(result.labels, 11, 4, 4) == 1);
  CHECK(label_at(result.labels, 8, 4, 4) == 1);  // 5 + 3 + 3 + 1 voxels and the one received
  CHECK(result.stats.islands_removed == 1);
}

TEST_CASE("clean_labels: no island is left on noise, and voxels are conserved",
          "[labels][property]") {
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const InputVolume input = phantoms::voxel_noise(seed, 3, 12);
    for (const std::size_t bound : {2U, 5U, 50U}) {
      CleanLabelsOptions options;
      options.min_island_voxels = bound;
      const CleanLabelsResult result = clean(input, options);
      const auto topology = lattice_topology(result.labels.ids, result.labels.material_count());
      for (std::size_t m = 1; m < topology.size(); ++m) {
        // All components but the largest have at least `bound` voxels.
        CHECK(topology[m].voxels >= (topology[m].components - 1) * bound);
        CHECK(topology[m].components == result.stats.accounts[m - 1].components_kept);
        CHECK(topology[m].voxels == result.stats.accounts[m - 1].voxels_kept);
      }
    }
  }
}

TEST_CASE("clean_labels: dropped labels become exterior and the crop follows", "[labels][unit]") {
  InputVolume input = filled(30, 10, 10);
  put_box(input, {3, 3, 3}, {5, 6, 6}, 1);
  put_box(input, {20, 3, 3}, {26, 6, 6}, 2);
  CleanLabelsOptions options;
  options.drop_labels = {2};
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.label_of == std::vector<Label>{0, 1});
  CHECK(result.labels.frame().dims == std::array<int, 3>{5, 6, 6});
  REQUIRE(result.stats.accounts.size() == 2);
  CHECK(result.stats.accounts[1].is_dropped);
  CHECK(result.stats.accounts[1].voxels_in == 7 * 16);
  CHECK(result.stats.accounts[1].voxels_kept == 0);
  CHECK_FALSE(result.stats.accounts[0].is_dropped);
  CHECK(result.labels.frame().index_to_world({0, 0, 0}) == input.frame.index_to_world({2, 2, 2}));
}

TEST_CASE("clean_labels: dropped labels join a meshed background", "[labels][unit]") {
  InputVolume input = filled(8, 8, 8, 5);  // no label 0 at all
  put_box(input, {2, 2, 2}, {4, 4, 4}, 6);
  CleanLabelsOptions options;
  options.drop_labels = {6};
  options.mesh_background = true;
  const LabelVolume labels = clean(input, options).labels;
  CHECK(labels.label_of == std::vector<Label>{0, 0, 5});
  CHECK(labels.ids(3, 3, 3) == 1);
  CHECK(labels.ids(0, 0, 0) == 2);
}

TEST_CASE("clean_labels: bad inputs are refused with the way out", "[labels][unit]") {
  InputVolume input = filled(6, 6, 6);
  check_fails(input, {}, ErrorCode::BadInput, "label 0");
  check_fails(filled(6, 6, 6, 7), {}, ErrorCode::BadInput, "label 7");
  input(3, 3, 3) = 4;
  CleanLabelsOptions options;
  options.drop_labels = {9};
  check_fails(input, options, ErrorCode::BadParameter, "label 9");
  options.drop_labels = {0};
  check_fails(input, options, ErrorCode::BadParameter, "background already");
  options.drop_labels = {4};
  check_fails(input, options, ErrorCode::BadInput, "no label to mesh");
  check_fails(InputVolume{}, {}, ErrorCode::BadInput, "no voxels");
  InputVolume image = filled(64, 64, 32);
  for (std::size_t i = 0; i < image.values.size(); ++i)
    image.values[i] = static_cast<Label>(i);
  check_fails(image, {}, ErrorCode::BadInput, "65534");
}
