// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/lattice_topology.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>

#include "support/catch.h"
#include "support/phantoms.h"
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <sstream>

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

// The voxels of `box`, as a file would hold them that was cropped before.
InputVolume part_of(const InputVolume& input, const VoxelBox& box) {
  InputVolume part(cropped(input.frame, box.lo, box.dims()));
  for (int k = box.lo[2]; k <= box.hi[2]; ++k) {
    for (int j = box.lo[1]; j <= box.hi[1]; ++j) {
      for (int i = box.lo[0]; i <= box.hi[0]; ++i)
        part(i - box.lo[0], j - box.lo[1], k - box.lo[2]) = input(i, j, k);
    }
  }
  return part;
}

// A box of label 1 that has one voxel of background around it.
InputVolume block() {
  InputVolume input = filled(12, 12, 12);
  put_box(input, {1, 1, 1}, {10, 10, 10}, 1);
  return input;
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
  // All are listed, smallest first, ties by first voxel.
  REQUIRE(result.stats.islands.size() == 3);
  CHECK(result.stats.islands[0].first_voxel == std::array<int, 3>{18, 5, 5});
  CHECK(result.stats.islands[0].given_to == 0);
  CHECK(result.stats.islands[1].first_voxel == std::array<int, 3>{17, 9, 9});
  CHECK(result.stats.islands[1].voxels == 1);
  CHECK(result.stats.islands[2].first_voxel == std::array<int, 3>{13, 5, 5});
  CHECK(result.stats.islands[2].label == 1);
  CHECK(result.stats.islands[2].given_to == 2);
  CHECK(result.stats.islands[2].voxels == 2);
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

TEST_CASE("clean_labels: merged labels become one material whose components join",
          "[labels][unit]") {
  InputVolume input = filled(20, 8, 8);
  put_box(input, {2, 2, 2}, {4, 5, 5}, 2);
  put_box(input, {5, 2, 2}, {7, 5, 5}, 3);  // beside label 2
  put_box(input, {8, 2, 2}, {9, 5, 5}, 2);
  put_box(input, {12, 2, 2}, {15, 5, 5}, 4);
  put_box(input, {16, 2, 2}, {17, 5, 5}, 5);
  CleanLabelsOptions options;
  options.merge_labels = {{2, {3, 4}}};
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.label_of == std::vector<Label>{0, 2, 5});
  CHECK(label_at(result.labels, 6, 3, 3) == 2);
  CHECK(label_at(result.labels, 13, 3, 3) == 2);
  const auto& accounts = result.stats.accounts;
  REQUIRE(accounts.size() == 4);
  CHECK(accounts[0].voxels_in == 5 * 16);
  CHECK(accounts[0].voxels_kept == 12 * 16);
  CHECK(accounts[0].components_in == 2);
  CHECK(accounts[0].components_kept == 2);
  CHECK_FALSE(accounts[0].merged_into);
  CHECK(accounts[1].label == 3);
  CHECK(accounts[1].merged_into == 2);
  CHECK(accounts[1].voxels_in == 3 * 16);
  CHECK(accounts[1].components_in == 1);
  CHECK(accounts[1].voxels_kept == 0);
  CHECK(accounts[1].components_kept == 0);
  CHECK_FALSE(accounts[1].is_dropped);
  CHECK(accounts[2].merged_into == 2);
  CHECK(accounts[3].voxels_kept == 2 * 16);
}

TEST_CASE("clean_labels: labels may merge into one that is not in the volume", "[labels][unit]") {
  InputVolume input = filled(12, 8, 8);
  put_box(input, {2, 2, 2}, {4, 5, 5}, 7);
  put_box(input, {5, 2, 2}, {8, 5, 5}, -3);
  CleanLabelsOptions options;
  options.merge_labels = {{2, {-3, 7}}};
  options.names[2] = "bone";
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.label_of == std::vector<Label>{0, 2});
  CHECK(result.labels.name_of[1] == "bone");
  REQUIRE(result.stats.accounts.size() == 3);
  CHECK(result.stats.accounts[1].label == 2);
  CHECK(result.stats.accounts[1].voxels_in == 0);
  CHECK(result.stats.accounts[1].voxels_kept == 7 * 16);
  CHECK(result.stats.accounts[1].components_kept == 1);
}

TEST_CASE("clean_labels: merges come before islands, and beside drops", "[labels][unit]") {
  InputVolume input = filled(20, 8, 8);
  put_box(input, {2, 2, 2}, {5, 5, 5}, 1);
  input(6, 3, 3) = 2;  // an island of label 2, but a part of label 1 once merged
  put_box(input, {9, 2, 2}, {12, 5, 5}, 2);
  put_box(input, {15, 2, 2}, {17, 5, 5}, 3);
  CleanLabelsOptions options;
  options.min_island_voxels = 5;
  options.merge_labels = {{1, {2}}};
  options.drop_labels = {3};
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.stats.islands.empty());
  CHECK(result.labels.label_of == std::vector<Label>{0, 1});
  CHECK(result.stats.accounts[0].voxels_kept == 64 + 1 + 64);
  CHECK(result.stats.accounts[2].is_dropped);
}

TEST_CASE("clean_labels: contradictory merges are refused with the way out", "[labels][unit]") {
  InputVolume input = filled(8, 8, 8);
  for (int label = 1; label <= 4; ++label)
    input(label, 3, 3) = label;
  const auto refuses = [&](const std::map<Label, std::vector<Label>>& merges,
                           const std::string& words, const std::vector<Label>& drops = {}) {
    CleanLabelsOptions options;
    options.merge_labels = merges;
    options.drop_labels = drops;
    check_fails(input, options, ErrorCode::BadParameter, words);
  };
  refuses({{2, {9}}}, "merge_labels.2 names label 9, which is not in the volume; it has 0, 1, 2");
  refuses({{0, {3, 4}}}, "merge_labels.0 turns labels 3, 4 into the background; use drop_labels");
  refuses({{2, {0}}}, "merge_labels.2 names label 0, the background");
  refuses({{2, {}}}, "merge_labels.2 is empty; list the labels that become 2");
  refuses({{2, {3, 3}}}, "label 3 is named by merge_labels.2 and again by merge_labels.2");
  refuses({{1, {3}}, {2, {3}}}, "label 3 is named by merge_labels.1 and again by merge_labels.2");
  refuses({{1, {2}}, {2, {3}}}, "label 2 is named by merge_labels.1 and again by merge_labels.2");
  refuses({{2, {2}}}, "label 2 is named by merge_labels.2");
  refuses({{2, {3}}}, "label 3 is named by drop_labels and again by merge_labels.2", {3});
  refuses({{2, {3}}}, "label 2 is named by drop_labels and again by merge_labels.2", {2});

  CleanLabelsOptions options;
  options.merge_labels = {{1, {2}}};
  const InputVolume no_background = phantoms::box_without_background({9, 8, 7});
  check_fails(no_background, options, ErrorCode::BadInput,
              "only label 1 is left by merge_labels; a mesh needs at least two labels");
}

TEST_CASE("clean_labels: a hole below the bound is filled, one of its size is not",
          "[labels][unit]") {
  InputVolume input = block();
  put_box(input, {4, 5, 6}, {6, 5, 6}, 0);
  CleanLabelsOptions options;
  CHECK(clean(input, options).stats.holes_filled == 0);  // the default fills none
  options.min_hole_voxels = 3;
  CHECK(clean(input, options).stats.holes_filled == 0);
  options.min_hole_voxels = 4;
  const CleanLabelsResult result = clean(input, options);
  CHECK(label_at(result.labels, 5, 5, 6) == 1);
  CHECK(result.stats.accounts[0].voxels_kept == 1000);
  CHECK(result.stats.holes_filled == 1);
  CHECK(result.stats.hole_voxels == 3);
  REQUIRE(result.stats.holes.size() == 1);
  CHECK(result.stats.holes[0].label == 0);
  CHECK(result.stats.holes[0].given_to == 1);
  CHECK(result.stats.holes[0].voxels == 3);
  CHECK(result.stats.holes[0].first_voxel == std::array<int, 3>{4, 5, 6});
}

TEST_CASE("clean_labels: what is open to the outside is no hole", "[labels][unit]") {
  CleanLabelsOptions options;
  options.min_hole_voxels = 1000000;
  CHECK(clean(phantoms::torus(9, 3), options).stats.holes.empty());

  InputVolume input = filled(10, 10, 10, 1);
  put_box(input, {4, 4, 0}, {6, 4, 0}, 0);  // at the border of the volume
  CHECK(clean(input, options).stats.holes.empty());

  // The lattice joins voxels along (1, 1, 1), but not along (1, -1, 1).
  input = block();
  input(9, 9, 9) = input(10, 10, 10) = 0;
  CHECK(clean(input, options).stats.holes.empty());
  input = block();
  input(9, 2, 9) = input(10, 1, 10) = 0;
  CHECK(clean(input, options).stats.hole_voxels == 1);
}

TEST_CASE("clean_labels: holes go to the label they share most faces with", "[labels][unit]") {
  InputVolume input = block();
  put_box(input, {1, 1, 1}, {5, 10, 10}, 2);
  put_box(input, {1, 1, 9}, {10, 10, 10}, -1);
  input(6, 5, 4) = 0;                       // one face to label 2, five to label 1
  put_box(input, {5, 5, 6}, {6, 5, 6}, 0);  // five to each of them: the smaller
  put_box(input, {2, 2, 8}, {4, 4, 8}, 0);  // nine to label -1, nine and twelve to label 2
  put_box(input, {8, 8, 9}, {8, 8, 9}, 0);  // one to label 1, five to label -1
  CleanLabelsOptions options;
  options.min_hole_voxels = 10;
  const CleanLabelsResult result = clean(input, options);
  CHECK(label_at(result.labels, 6, 5, 4) == 1);
  CHECK(label_at(result.labels, 5, 5, 6) == 1);
  CHECK(label_at(result.labels, 6, 5, 6) == 1);
  CHECK(label_at(result.labels, 3, 3, 8) == 2);
  CHECK(label_at(result.labels, 8, 8, 9) == -1);
  REQUIRE(result.stats.holes.size() == 4);
  const auto& holes = result.stats.holes;
  CHECK(std::is_sorted(holes.begin(), holes.end(), [](const auto& a, const auto& b) {
    return a.first_voxel[2] < b.first_voxel[2];
  }));
}

TEST_CASE("clean_labels: islands go before holes are counted", "[labels][unit]") {
  InputVolume input = block();
  put_box(input, {4, 4, 4}, {6, 6, 6}, 0);
  input(5, 5, 5) = 1;  // alone in the cavity: background first, then filled with it
  CleanLabelsOptions options;
  options.min_island_voxels = 2;
  options.min_hole_voxels = 27;
  CHECK(clean(input, options).stats.holes_filled == 0);
  options.min_hole_voxels = 28;
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.stats.island_voxels == 1);
  CHECK(result.stats.hole_voxels == 27);
  CHECK(result.stats.accounts[0].voxels_kept == 1000);
  CHECK(result.stats.accounts[0].components_kept == 1);
}

TEST_CASE("clean_labels: holes of a meshed background are filled, up to all of it",
          "[labels][unit]") {
  InputVolume input = block();
  put_box(input, {4, 4, 4}, {5, 4, 4}, 0);
  CleanLabelsOptions options;
  options.mesh_background = true;
  options.min_hole_voxels = 3;
  const CleanLabelsResult open = clean(input, options);
  CHECK(open.labels.label_of == std::vector<Label>{0, 0, 1});
  CHECK(open.stats.accounts[0].voxels_kept == 1728 - 1000);
  CHECK(open.stats.accounts[1].voxels_kept == 1000);

  input = phantoms::box_without_background({9, 8, 7});
  put_box(input, {2, 2, 2}, {3, 2, 2}, 0);
  for (const bool mesh_background : {true, false}) {
    options.mesh_background = mesh_background;
    const CleanLabelsResult result = clean(input, options);
    CHECK(result.labels.label_of == std::vector<Label>{0, 1, 2});
    CHECK(std::count(result.labels.ids.values.begin(), result.labels.ids.values.end(), kExterior) ==
          0);
  }

  input = filled(6, 6, 6, 5);
  input(3, 3, 3) = 0;
  check_fails(input, options, ErrorCode::BadInput, "only label 5 is left by min_hole_voxels");
}

TEST_CASE("clean_labels: no small hole is left on noise, and voxels are conserved",
          "[labels][property]") {
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const InputVolume input = phantoms::voxel_noise(seed, 4, 12);
    CleanLabelsOptions options;
    const CleanLabelsResult before = clean(input, options);
    options.min_hole_voxels = 4;
    const CleanLabelsResult after = clean(input, options);
    REQUIRE(after.stats.holes_filled > 0);
    std::map<Label, std::size_t> received;
    for (const RemovedComponent& hole : after.stats.holes)
      received[hole.given_to] += hole.voxels;
    for (std::size_t a = 0; a < after.stats.accounts.size(); ++a)
      CHECK(after.stats.accounts[a].voxels_kept ==
            before.stats.accounts[a].voxels_kept + received[after.stats.accounts[a].label]);
    std::size_t listed = 0;
    for (const RemovedComponent& hole : after.stats.holes) {
      const auto [i, j, k] = hole.first_voxel;
      CHECK(input(i, j, k) == 0);
      CHECK(label_at(after.labels, i, j, k) == hole.given_to);
      CHECK(hole.voxels < 4);
      listed += hole.voxels;
    }
    CHECK(listed == after.stats.hole_voxels);

    InputVolume again(after.labels.frame());
    for (std::size_t v = 0; v < again.values.size(); ++v)
      again.values[v] = after.labels.label_of[after.labels.ids.values[v]];
    CHECK(clean(again, options).stats.holes_filled == 0);
  }
}

TEST_CASE("clean_labels: a region of interest is as if the volume ended there",
          "[labels][property]") {
  const VoxelBox region{{5, 4, 6}, {20, 17, 19}};
  for (const std::uint64_t seed : {1, 2, 3}) {
    const InputVolume input =
        phantoms::rotated(phantoms::random_blobs(seed, 4), {1, 2, 3}, 33, {5, -7, 11});
    CleanLabelsOptions options;
    options.min_island_voxels = 5;
    options.min_hole_voxels = 5;
    const LabelVolume expected = clean(part_of(input, region), options).labels;
    options.region_of_interest = region;
    const LabelVolume labels = clean(input, options).labels;
    CHECK(labels.label_of == expected.label_of);
    CHECK(labels.ids.values == expected.ids.values);
    CHECK(labels.frame().dims == expected.frame().dims);
    CHECK(labels.input_dims == input.frame.dims);
    for (int axis = 0; axis < 3; ++axis)
      CHECK(labels.first_voxel[axis] == expected.first_voxel[axis] + region.lo[axis]);
    const Vec3 first{double(labels.first_voxel[0]), double(labels.first_voxel[1]),
                     double(labels.first_voxel[2])};
    CHECK(distance(labels.frame().index_to_world({0, 0, 0}), input.frame.index_to_world(first)) <
          1e-12);
  }
}

TEST_CASE("clean_labels: a region of interest opens the holes and cuts the bridges at its border",
          "[labels][unit]") {
  InputVolume input = block();
  put_box(input, {4, 4, 4}, {5, 4, 4}, 0);
  put_box(input, {8, 8, 7}, {8, 8, 7}, 0);
  CleanLabelsOptions options;
  options.min_hole_voxels = 10;
  CHECK(clean(input, options).stats.holes_filled == 2);
  options.region_of_interest = VoxelBox{{5, 2, 2}, {11, 11, 11}};
  const CleanLabelsResult result = clean(input, options);
  REQUIRE(result.stats.holes.size() == 1);
  CHECK(result.stats.holes[0].first_voxel == std::array<int, 3>{8, 8, 7});  // of the input
  CHECK(label_at(result.labels, 5, 4, 4) == 0);
  CHECK(result.labels.first_voxel == std::array<int, 3>{5, 2, 2});
  CHECK(result.stats.accounts[0].voxels_in == 1000 - 3);
  CHECK(result.stats.accounts[0].voxels_kept == 6 * 9 * 9 - 1);
}

TEST_CASE("clean_labels: labels outside the region of interest are listed and named in the log",
          "[labels][unit]") {
  InputVolume input = filled(30, 8, 8);
  put_box(input, {2, 2, 2}, {5, 5, 5}, 1);
  put_box(input, {8, 2, 2}, {11, 5, 5}, 2);
  put_box(input, {14, 2, 2}, {17, 5, 5}, 3);
  put_box(input, {20, 2, 2}, {24, 5, 5}, 4);
  CleanLabelsOptions options;
  options.region_of_interest = VoxelBox{{0, 0, 0}, {15, 7, 7}};
  options.merge_labels = {{4, {1}}, {6, {3}}};
  std::ostringstream text;
  StageContext context = silent_context();
  context.log = std::make_shared<spdlog::logger>(
      "test", std::make_shared<spdlog::sinks::ostream_sink_st>(text));
  const CleanLabelsResult result = clean_labels(input, options, context);
  CHECK_THAT(text.str(), Catch::Contains("without a voxel inside region_of_interest: label 4"));
  CHECK(result.labels.label_of == std::vector<Label>{0, 2, 4, 6});
  const auto& accounts = result.stats.accounts;
  REQUIRE(accounts.size() == 5);
  CHECK_FALSE(accounts[0].is_outside_region);
  CHECK(accounts[2].voxels_in == 64);  // of the whole input, half of it outside
  CHECK(accounts[3].is_outside_region);
  CHECK(accounts[3].voxels_in == 80);
  CHECK(accounts[3].components_in == 1);
  CHECK(accounts[3].voxels_kept == 64);  // label 1 merged into it
  CHECK(accounts[4].voxels_kept == 32);
  CHECK_FALSE(accounts[4].is_outside_region);  // was nowhere in the input

  options.merge_labels = {{6, {4}}};
  const CleanLabelsResult without = clean(input, options);
  CHECK(without.labels.label_of == std::vector<Label>{0, 1, 2, 3});
  REQUIRE(without.stats.accounts.size() == 5);
  CHECK(without.stats.accounts[3].is_outside_region);
  CHECK(without.stats.accounts[3].voxels_kept == 0);
  CHECK(without.stats.accounts[4].voxels_kept == 0);
}

TEST_CASE("clean_labels: a region of interest that does not fit is refused", "[labels][unit]") {
  InputVolume input = filled(12, 10, 8);
  put_box(input, {6, 2, 2}, {9, 5, 5}, 5);
  put_box(input, {9, 2, 2}, {9, 5, 5}, 6);
  const auto refuses = [&](const VoxelBox& region, ErrorCode code, const std::string& words) {
    CleanLabelsOptions options;
    options.region_of_interest = region;
    check_fails(input, options, code, words);
  };
  refuses({{0, 7, 0}, {11, 3, 7}}, ErrorCode::BadParameter,
          "region_of_interest begins at j = 7 and ends at j = 3; give the first voxel");
  refuses({{0, 0, 0}, {11, 9, 8}}, ErrorCode::BadParameter,
          "region_of_interest reaches k = 8, outside the volume of 12 x 10 x 8 voxels; keep k "
          "between 0 and 7");
  refuses({{-1, 0, 0}, {11, 9, 7}}, ErrorCode::BadParameter, "reaches i = -1, outside");
  refuses({{0, 0, 0}, {4, 9, 7}}, ErrorCode::BadInput,
          "no label to mesh is left by region_of_interest");
  refuses({{0, 0, 0}, {5, 9, 7}}, ErrorCode::BadInput,
          "no label to mesh is left by region_of_interest");
  refuses({{7, 3, 3}, {8, 4, 4}}, ErrorCode::BadInput,
          "only label 5 is left by region_of_interest; a mesh needs at least two labels");
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

TEST_CASE("clean_labels: only the labels to keep are left, with what is merged into them",
          "[labels][unit]") {
  InputVolume input = filled(30, 10, 10);
  put_box(input, {3, 3, 3}, {5, 6, 6}, 1);
  put_box(input, {8, 3, 3}, {10, 6, 6}, 2);
  put_box(input, {20, 3, 3}, {26, 6, 6}, 3);
  put_box(input, {13, 3, 3}, {15, 6, 6}, 4);
  CleanLabelsOptions options;
  options.keep_labels = {2};
  options.merge_labels = {{2, {4}}, {1, {3}}};
  const CleanLabelsResult result = clean(input, options);
  CHECK(result.labels.label_of == std::vector<Label>{0, 2});
  REQUIRE(result.stats.accounts.size() == 4);
  CHECK(result.stats.accounts[0].is_dropped);
  CHECK(result.stats.accounts[1].voxels_kept == 2 * 3 * 16);
  CHECK(result.stats.accounts[2].is_dropped);
  CHECK_FALSE(result.stats.accounts[3].is_dropped);

  const auto refusal = [&](const CleanLabelsOptions& bad) {
    try {
      clean(input, bad);
    } catch (const Error& error) {
      CHECK(error.code() == ErrorCode::BadParameter);
      return std::string(error.what());
    }
    return std::string();
  };
  CleanLabelsOptions bad;
  bad.keep_labels = {2};
  bad.drop_labels = {1};
  CHECK(refusal(bad).find("keep_labels (2) and drop_labels (1)") != std::string::npos);
  bad = {};
  bad.keep_labels = {9};
  CHECK(refusal(bad).find("keep_labels") != std::string::npos);
  bad.keep_labels = {0};
  CHECK(refusal(bad).find("mesh_background") != std::string::npos);
}
