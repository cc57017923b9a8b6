// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/smooth_level_sets.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/levelset/lattice_volume.h"
#include "cvmesh/levelset/padded_block.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

// Gradient descent with momentum [Polyak 1964], projected onto the constraints after each sweep.
//
// Two things differ from [Lempitsky 2010]. Bending counts only within two voxels of the boundary,
// where distances are known; the kink where they are cut off would bend the boundary otherwise. And
// the smoothing is adaptive: the pull to the labels is weak where the boundary is wide and flat, so
// that the long terraces of slightly tilted planes go, and strong where it is thin or curved. How
// much it is curved is what remains of the Laplacian of the distance in a window: terraces cancel,
// and the two walls of a thin part do not.
//
// Constants were measured on balls, rods, discs, tilted planes and the bunny (docs/level_sets.md).

namespace cvmesh {
namespace {

constexpr char kStage[] = "tightening";
constexpr int kBlock = BlockTable::kBlock;
constexpr int kBlockNodes = BlockTable::kBlockNodes;

// Values are signed distances in voxels while they are smoothed, cut off here: nodes beyond have no
// part in a boundary, and the blurred indicator tells no distance there.
constexpr float kClip = LevelSets::kVoxelsToOne;

// Bending counts fully up to kCore - 1 / kTaper voxels from the boundary, and not beyond kCore,
// whose neighbours are the last that are not cut off.
constexpr float kCore = 2.25F, kTaper = 2;

// Pull to the distances on flat boundaries: waves longer than 2 pi kFlatPull^(-1/4), fifteen
// voxels, follow the labels. On curved ones kCurvedPull per squared curvature, at most kMostPull.
constexpr float kFlatPull = 0.03F, kCurvedPull = 6, kMostPull = 0.5F;
// Specks are flattened by what smooths the rest: they are pulled stronger. A node belongs to one
// when at most kSpeckNodes of the 26 around it are on its side.
constexpr float kSpeckPull = 20;
constexpr int kSpeckNodes = 2;
// The radius for which these hold; smaller ones pull stronger, up to what the descent bears.
constexpr double kFullRadius = 0.8;
constexpr float kStrongestPull = 30;

// Bounds between which the descent converges fast: above the largest eigenvalue of the squared
// 7-point Laplacian (144) and the strongest pull, and about the pull of curved parts. Flat parts
// converge slower, and nothing oscillates against the constraints.
constexpr float kHighestEigenvalue = 180, kLowestEigenvalue = 0.3F;

// Corrections of the volume, one after each round of sweeps but the last. A move is Newton's; thin
// parts answer weaker than that foresees and get up to twice as much.
constexpr int kCorrections = 5;
constexpr float kThinGain = 1;
constexpr float kLargestMove = 0.5F, kFarthestDistance = 6;

// Sums over windows are kept in bricks of 4^3 nodes. Standard deviations of the windows, in bricks:
// wide enough for stairs to cancel, narrow against what the boundary follows.
constexpr int kBrick = 4;
constexpr int kBricksPerBlock = 8;
constexpr float kWindowSigma = 0.7F;
constexpr int kWindowReach = 2;
constexpr float kLeastWeight = 0.05F;  // of a window: nodes, or voxels per voxel

constexpr int kSweepHalo = 2;  // of the bilaplacian

std::size_t brick_in_block(int i, int j, int k) {
  return static_cast<std::size_t>((k / kBrick * 2 + j / kBrick) * 2 + i / kBrick);
}

// The inverse error function for |x| < 0.999 [Giles 2012].
float inverse_erf(float x) {
  const float w = -std::log((1 - x) * (1 + x));
  const auto polynomial = [](float t, const std::array<float, 9>& coefficients) {
    float p = 0;
    for (const float c : coefficients)
      p = c + p * t;
    return p;
  };
  if (w < 5)
    return x * polynomial(w - 2.5F, {2.81022636e-08F, 3.43273939e-07F, -3.5233877e-06F,
                                     -4.39150654e-06F, 0.00021858087F, -0.00125372503F,
                                     -0.00417768164F, 0.246640727F, 1.50140941F});
  return x * polynomial(std::sqrt(w) - 3,
                        {-0.000200214257F, 0.000100950558F, 0.00134934322F, -0.00367342844F,
                         0.00573950773F, -0.0076224613F, 0.00943887047F, 1.00167406F, 2.83297682F});
}

// A blurred indicator (sigma one voxel) as signed distance in voxels: across a plane at distance d
// it is erf(d / sqrt 2).
float distance_of(float indicator) {
  static const float kLargest = std::erf(kClip / std::sqrt(2.0F));
  return std::abs(indicator) >= kLargest ? std::copysign(kClip, indicator)
                                         : std::sqrt(2.0F) * inverse_erf(indicator);
}

// Sums over the bricks of all slots: `odd` changes its sign with the field, `even` does not.
struct BrickSums {
  std::vector<float> odd, even;

  explicit BrickSums(std::size_t slots)
      : odd(slots * kBricksPerBlock), even(slots * kBricksPerBlock) {}

  void add(std::size_t brick, float odd_part, float even_part) {
    odd[brick] += odd_part;
    even[brick] += even_part;
  }
};

// Steps to the nodes around one, by their distance.
struct NearSteps {
  float distance;
  std::vector<int> steps;  // in a padded block
};

std::array<NearSteps, 4> near_steps() {
  constexpr int kSpan = PaddedBlock<2>::kSpan, kSpan2 = PaddedBlock<2>::kSpan2;
  std::array<NearSteps, 4> shells;
  for (int k = -2; k <= 2; ++k)
    for (int j = -2; j <= 2; ++j)
      for (int i = -2; i <= 2; ++i)
        if (const int d2 = i * i + j * j + k * k; d2 >= 1 && d2 <= 4) {
          NearSteps& shell = shells[static_cast<std::size_t>(d2 - 1)];
          shell.distance = std::sqrt(static_cast<float>(d2));
          shell.steps.push_back(i + j * kSpan + k * kSpan2);
        }
  return shells;
}

// The signed distance that the nearest node of the other side tells, half a voxel less; `d` where
// there is none within two voxels.
float distance_by_nodes(float d, const float* f) {
  static const auto kShells = near_steps();
  for (const auto& [distance, steps] : kShells)
    for (const int step : steps)
      if ((f[step] > 0) != (*f > 0)) return std::copysign(distance - 0.5F, *f);
  return d;
}

class Smoother {
 public:
  Smoother(LevelSets& level_sets, const SmoothLevelSetsOptions& options)
      : reader_(level_sets, kClip),
        margin_(static_cast<float>(options.margin_vox)),
        current_(level_sets.values),
        distance_(current_.size()),
        previous_(current_.size()),
        active_rows_(reader_.size()),
        is_speck_(reader_.size() * kBricksPerBlock) {
    find_distances();
    find_pulls(options.r_vox);
  }

  // Calls report(fraction done) on the way.
  template <typename Report>
  void run(int sweeps, const Report& report) {
    int done = 0;
    for (int round = 0; round <= kCorrections; ++round) {
      const int until = static_cast<int>(std::int64_t{sweeps} * (round + 1) / (kCorrections + 1));
      relax(until - done, [&](int of_round) {
        report(static_cast<double>(done + of_round) / std::max(sweeps, 1));
      });
      done = until;
      if (round < kCorrections) correct_volume();
    }
    parallel_for_each_index(
        0, current_.size(), [&](std::size_t n) { current_[n] /= kClip; }, 1 << 16);
  }

 private:
  template <typename Body>
  void for_each_slot(const Body& body) const {
    parallel_for_each_index(0, reader_.size(), body, 16);
  }

  template <typename Body>
  static void for_each_node(const Body& body) {
    for (int k = 0; k < kBlock; ++k)
      for (int j = 0; j < kBlock; ++j)
        for (int i = 0; i < kBlock; ++i)
          body(i, j, k);
  }

  static std::size_t node_at(std::size_t slot, int i, int j, int k) {
    return slot * kBlockNodes + static_cast<std::size_t>((k * kBlock + j) * kBlock + i);
  }

  // The nearest value that has the sign of `own`.
  [[nodiscard]] float kept(float own, float value) const {
    return own > 0 ? std::clamp(value, margin_, kClip) : std::clamp(value, -kClip, -margin_);
  }

  void find_distances() {
    parallel_for_each_index(
        0, current_.size(), [&](std::size_t n) { previous_[n] = distance_of(current_[n]); },
        1 << 14);
    for_each_slot([&](std::size_t slot) {
      PaddedBlock<1> f;
      reader_.gather(slot, previous_, f);
      std::uint64_t rows = 0;
      for_each_node([&](int i, int j, int k) {
        const int at = PaddedBlock<1>::at(i, j, k);
        // Blurring by sigma moves a boundary by -sigma^2 / 2 times the Laplacian of its distance.
        const float d = f.values[at] - 0.5F * PaddedBlock<1>::laplacian(f.values.data(), at);
        const std::size_t n = node_at(slot, i, j, k);
        current_[n] = distance_[n] = kept(current_[n], d);
        if (std::abs(d) < kClip) rows |= std::uint64_t{1} << (k * kBlock + j);
        if (is_lonely(&f.values[static_cast<std::size_t>(at)]))
          is_speck_[slot * kBricksPerBlock + brick_in_block(i, j, k)] = 1;
      });
      active_rows_[slot] = dilated(rows);
    });
  }

  static bool is_lonely(const float* f) {
    constexpr int kSpan = PaddedBlock<1>::kSpan, kSpan2 = PaddedBlock<1>::kSpan2;
    int same = -1;  // without the node itself
    for (const int z : {-kSpan2, 0, kSpan2})
      for (const int y : {-kSpan, 0, kSpan})
        for (const int x : {-1, 0, 1})
          same += (f[x + y + z] > 0) == (*f > 0) ? 1 : 0;
    return same <= kSpeckNodes;
  }

  // Rows (j, k) of a block, bit 8 k + j, and their neighbours in the block.
  static std::uint64_t dilated(std::uint64_t rows) {
    constexpr std::uint64_t kFirst = 0x0101010101010101, kLast = kFirst << 7;
    return rows | rows << 8 | rows >> 8 | (rows & ~kLast) << 1 | (rows & ~kFirst) >> 1;
  }

  void find_pulls(const std::vector<double>& r_vox) {
    BrickSums bend(reader_.size());
    for_each_slot([&](std::size_t slot) {
      PaddedBlock<1> f;
      reader_.gather(slot, distance_, f);
      for_each_node([&](int i, int j, int k) {
        const int at = PaddedBlock<1>::at(i, j, k);
        if (std::abs(f.values[at]) > kCore - 0.5F / kTaper || !is_in_grid(slot, {i, j, k})) return;
        bend.add(slot * kBricksPerBlock + brick_in_block(i, j, k),
                 PaddedBlock<1>::laplacian(f.values.data(), at), 1);
      });
    });
    pull_.resize(bend.odd.size());
    for_each_slot([&](std::size_t slot) {
      const auto curvature = window_ratios(slot, bend);
      std::array<bool, kBricksPerBlock> is_speck;
      for (std::size_t c = 0; c < kBricksPerBlock; ++c) {
        is_speck[c] = is_near_speck(slot, c);
        const float pull = is_speck[c] ? kSpeckPull
                                       : std::clamp(kCurvedPull * curvature[c] * curvature[c],
                                                    kFlatPull, kMostPull);
        pull_[slot * kBricksPerBlock + c] =
            std::min(strengthening(slot, c, bend, r_vox) * pull, kStrongestPull);
      }
      if (std::find(is_speck.begin(), is_speck.end(), true) != is_speck.end())
        measure_by_nodes(slot, is_speck);
    });
  }

  // Factor of the pull for the least radius of the materials whose boundaries pass by a brick.
  [[nodiscard]] float strengthening(std::size_t slot,
                                    std::size_t brick,
                                    const BrickSums& bend,
                                    const std::vector<double>& r_vox) const {
    const auto& slots = reader_.level_sets().slots;
    double r = kFullRadius;
    for_each_slot_of_block(slot, [&](std::size_t s) {
      if (s == slot || bend.even[s * kBricksPerBlock + brick] > 0)
        r = std::min({r, r_vox[slots[s].material], r_vox[slots[s].mirror]});
    });
    constexpr double kLeastRadius = 0.01;  // the pull is the strongest long before
    return static_cast<float>(std::pow(kFullRadius / std::max(r, kLeastRadius), 4));
  }

  // Calls body(s) for all slots s of the block of a slot; they follow each other.
  template <typename Body>
  void for_each_slot_of_block(std::size_t slot, const Body& body) const {
    const auto& slots = reader_.level_sets().slots;
    std::size_t s = slot;
    while (s > 0 && slots[s - 1].block == slots[slot].block)
      --s;
    for (; s < slots.size() && slots[s].block == slots[slot].block; ++s)
      body(s);
  }

  // Whether a brick or one beside it, as far as this material is near, holds part of a speck.
  [[nodiscard]] bool is_near_speck(std::size_t slot, std::size_t brick) const {
    const int i = static_cast<int>(brick & 1), j = static_cast<int>(brick >> 1 & 1),
              k = static_cast<int>(brick >> 2);
    for (int z = k - 1; z <= k + 1; ++z)
      for (int y = j - 1; y <= j + 1; ++y)
        for (int x = i - 1; x <= i + 1; ++x) {
          const BrickPlace place = find_brick(slot, x, y, z);
          if (!place.is_stored) continue;
          bool is_found = false;
          for_each_slot_of_block(place.brick / kBricksPerBlock, [&](std::size_t s) {
            is_found =
                is_found || is_speck_[s * kBricksPerBlock + place.brick % kBricksPerBlock] != 0;
          });
          if (is_found) return true;
        }
    return false;
  }

  // Around a speck the blurred indicator tells next to nothing of distances.
  void measure_by_nodes(std::size_t slot, const std::array<bool, kBricksPerBlock>& is_speck) {
    PaddedBlock<2> f;
    reader_.gather(slot, previous_, f);
    for_each_node([&](int i, int j, int k) {
      if (!is_speck[brick_in_block(i, j, k)]) return;
      const std::size_t n = node_at(slot, i, j, k);
      const auto at = static_cast<std::size_t>(PaddedBlock<2>::at(i, j, k));
      current_[n] = distance_[n] =
          kept(current_[n], distance_by_nodes(distance_[n], &f.values[at]));
    });
  }

  template <typename Report>
  void relax(int sweeps, const Report& report) {
    const float high = std::sqrt(kHighestEigenvalue), low = std::sqrt(kLowestEigenvalue);
    const float step = 4 / ((high + low) * (high + low));
    const float momentum = (high - low) * (high - low) / ((high + low) * (high + low));
    previous_ = current_;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      for_each_slot([&](std::size_t slot) {
        if (active_rows_[slot] != 0) descend(slot, step, momentum);
      });
      current_.swap(previous_);
      report(sweep + 1);
    }
  }

  // One sweep over a slot, from current_ and previous_ into previous_.
  void descend(std::size_t slot, float step, float momentum) {
    using Padded = PaddedBlock<kSweepHalo>;
    Padded f, bend;
    reader_.gather(slot, current_, f);
    // In one go over the rows' ends, where the results mean nothing and are not read.
    for (int n = Padded::at(-1, -1, -1); n <= Padded::at(kBlock, kBlock, kBlock); ++n)
      bend.values[n] = std::clamp(kTaper * (kCore - std::abs(f.values[n])), 0.0F, 1.0F) *
                       Padded::laplacian(f.values.data(), n);
    for (int k = 0; k < kBlock; ++k)
      for (int j = 0; j < kBlock; ++j)
        if ((active_rows_[slot] >> (k * kBlock + j) & 1U) != 0)
          descend_row(&f.values[Padded::at(0, j, k)], &bend.values[Padded::at(0, j, k)],
                      &pull_[slot * kBricksPerBlock + brick_in_block(0, j, k)],
                      node_at(slot, 0, j, k), step, momentum);
  }

  void descend_row(const float* f,
                   const float* bend,
                   const float* pull,
                   std::size_t node,
                   float step,
                   float momentum) {
    constexpr int kSpan = PaddedBlock<kSweepHalo>::kSpan, kSpan2 = PaddedBlock<kSweepHalo>::kSpan2;
    const BlockRow pulls{pull[0], pull[0], pull[0], pull[0], pull[1], pull[1], pull[1], pull[1]};
    const BlockRow margin = margin_ - BlockRow{}, clip = kClip - BlockRow{};
    BlockRow here, left, right, front, back, below, above, value, distance, before;
    load(bend, here);
    load(bend - 1, left);
    load(bend + 1, right);
    load(bend - kSpan, front);
    load(bend + kSpan, back);
    load(bend - kSpan2, below);
    load(bend + kSpan2, above);
    const BlockRow bilaplacian = left + right + front + back + below + above - 6 * here;
    load(f, value);
    load(&distance_[node], distance);
    load(&previous_[node], before);
    const auto is_inside = value > 0;
    const BlockRow low = is_inside ? margin : -clip, high = is_inside ? clip : -margin;
    value = value - step * (bilaplacian + pulls * (value - distance)) + momentum * (value - before);
    value = value < low ? low : value;
    value = value > high ? high : value;
    store(value, &previous_[node]);
  }

  // Moves distances and fields by what the volume inside the boundary lacks, in a window.
  void correct_volume() {
    BrickSums volumes(reader_.size());
    for_each_slot([&](std::size_t slot) {
      if (active_rows_[slot] != 0) add_volumes(slot, volumes);
    });
    std::vector<float> moves(volumes.odd.size());
    for_each_slot([&](std::size_t slot) {
      const auto newton = window_ratios(slot, volumes);
      for (std::size_t c = 0; c < kBricksPerBlock; ++c) {
        const std::size_t brick = slot * kBricksPerBlock + c;
        const float gain = follows(brick) ? 1 : 1 + kThinGain * pull_[brick] / kMostPull;
        moves[brick] = std::clamp(gain * newton[c], -kLargestMove, kLargestMove);
      }
    });
    for_each_slot([&](std::size_t slot) {
      if (active_rows_[slot] != 0) apply_moves(slot, moves);
    });
  }

  // Whether the pull is so strong that the field just follows the distance.
  [[nodiscard]] bool follows(std::size_t brick) const { return pull_[brick] > kMostPull; }

  void add_volumes(std::size_t slot, BrickSums& volumes) const {
    constexpr int kSpan = PaddedBlock<1>::kSpan, kSpan2 = PaddedBlock<1>::kSpan2;
    PaddedBlock<1> f;
    reader_.gather(slot, current_, f);
    for_each_node([&](int i, int j, int k) {
      if (!is_in_grid(slot, {i + 1, j + 1, k + 1})) return;  // the cube above the node
      const float* low = &f.values[static_cast<std::size_t>(PaddedBlock<1>::at(i, j, k))];
      std::array<float, 8> corner;
      for (int c = 0; c < 8; ++c)
        corner[c] = low[(c & 1) + (c >> 1 & 1) * kSpan + (c >> 2) * kSpan2];
      const std::size_t brick = slot * kBricksPerBlock + brick_in_block(i, j, k);
      const CubeVolume cube = volume_in_cube(corner, follows(brick) ? 0 : 1.01F * margin_);
      if (cube.is_cut) volumes.add(brick, cube.lack, cube.slope);
    });
  }

  // Whether node `at` of the slot's block, which may stick out, lies in the grid.
  [[nodiscard]] bool is_in_grid(std::size_t slot, const std::array<int, 3>& at) const {
    const LevelSets& level_sets = reader_.level_sets();
    for (int axis = 0; axis < 3; ++axis)
      if (level_sets.slots[slot].block[axis] * kBlock + at[axis] >= level_sets.frame().dims[axis])
        return false;
    return true;
  }

  // A brick near a slot's block, by its place: 0 and 1 are the block's own.
  struct BrickPlace {
    bool is_stored = false;
    float sign = 1;  // of odd quantities
    std::size_t brick = 0;
  };

  [[nodiscard]] BrickPlace find_brick(std::size_t slot, int i, int j, int k) const {
    const int n = ((k >> 1) + 1) * 9 + ((j >> 1) + 1) * 3 + (i >> 1) + 1;
    std::int32_t entry = reader_.neighbours(slot)[static_cast<std::size_t>(n)];
    if (entry == BlockTable::kOutside || entry == BlockTable::kInside) return {};
    const float sign = BlockTable::is_mirrored(entry) ? -1.0F : 1.0F;
    if (BlockTable::is_mirrored(entry)) entry = BlockTable::mirrored(entry);
    return {true, sign,
            static_cast<std::size_t>(entry) * kBricksPerBlock +
                static_cast<std::size_t>(((k & 1) * 2 + (j & 1)) * 2 + (i & 1))};
  }

  // Odd over even sums in a window around each brick of a slot.
  [[nodiscard]] std::array<float, kBricksPerBlock> window_ratios(std::size_t slot,
                                                                 const BrickSums& sums) const {
    static const auto kWeights = [] {
      std::array<float, 2 * kWindowReach + 1> weights{};
      for (int d = -kWindowReach; d <= kWindowReach; ++d)
        weights[static_cast<std::size_t>(d + kWindowReach)] =
            std::exp(-0.5F * static_cast<float>(d * d) / (kWindowSigma * kWindowSigma));
      return weights;
    }();
    std::array<float, kBricksPerBlock> odd{}, even{};
    for (int k = -kWindowReach; k < 2 + kWindowReach; ++k)
      for (int j = -kWindowReach; j < 2 + kWindowReach; ++j)
        for (int i = -kWindowReach; i < 2 + kWindowReach; ++i) {
          const BrickPlace place = find_brick(slot, i, j, k);
          if (!place.is_stored || sums.even[place.brick] <= 0) continue;
          for (int c = 0; c < kBricksPerBlock; ++c) {
            const int di = i - (c & 1), dj = j - (c >> 1 & 1), dk = k - (c >> 2);
            if (std::max({std::abs(di), std::abs(dj), std::abs(dk)}) > kWindowReach) continue;
            const float weight = kWeights[static_cast<std::size_t>(di + kWindowReach)] *
                                 kWeights[static_cast<std::size_t>(dj + kWindowReach)] *
                                 kWeights[static_cast<std::size_t>(dk + kWindowReach)];
            odd[c] += weight * place.sign * sums.odd[place.brick];
            even[c] += weight * sums.even[place.brick];
          }
        }
    for (std::size_t c = 0; c < kBricksPerBlock; ++c)
      odd[c] /= even[c] + kLeastWeight;
    return odd;
  }

  // Moves are linear between the middles of the bricks.
  void apply_moves(std::size_t slot, const std::vector<float>& moves) {
    // Bricks -1 .. 2 along each axis; where there is none, the nearest of the block itself.
    std::array<float, 64> around;
    for (int n = 0; n < 64; ++n) {
      const int i = (n & 3) - 1, j = (n >> 2 & 3) - 1, k = (n >> 4) - 1;
      BrickPlace place = find_brick(slot, i, j, k);
      if (!place.is_stored)
        place = find_brick(slot, std::clamp(i, 0, 1), std::clamp(j, 0, 1), std::clamp(k, 0, 1));
      around[static_cast<std::size_t>(n)] = place.sign * moves[place.brick];
    }
    for_each_node([&](int i, int j, int k) {
      const std::array<float, 3> place{(static_cast<float>(i) + 2.5F) / kBrick,
                                       (static_cast<float>(j) + 2.5F) / kBrick,
                                       (static_cast<float>(k) + 2.5F) / kBrick};
      std::array<int, 3> low;
      std::array<float, 3> t;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = static_cast<int>(place[axis]);
        t[axis] = place[axis] - static_cast<float>(low[axis]);
      }
      float move = 0;
      for (int c = 0; c < 8; ++c) {
        const float weight = ((c & 1) != 0 ? t[0] : 1 - t[0]) * ((c & 2) != 0 ? t[1] : 1 - t[1]) *
                             ((c & 4) != 0 ? t[2] : 1 - t[2]);
        move +=
            weight * around[static_cast<std::size_t>(
                         ((low[2] + (c >> 2)) * 4 + low[1] + (c >> 1 & 1)) * 4 + low[0] + (c & 1))];
      }
      const std::size_t n = node_at(slot, i, j, k);
      distance_[n] = std::clamp(distance_[n] + move, -kFarthestDistance, kFarthestDistance);
      current_[n] = kept(current_[n], current_[n] + move);
    });
  }

  SlotReader reader_;
  float margin_;
  std::vector<float>& current_;             // the level sets' own values
  std::vector<float> distance_, previous_;  // per node
  std::vector<float> pull_;                 // per brick
  std::vector<std::uint64_t> active_rows_;  // per slot: rows that move
  std::vector<std::uint8_t> is_speck_;      // per brick
};

}  // namespace

LevelSets smooth_level_sets(LevelSets level_sets,
                            const SmoothLevelSetsOptions& options,
                            const StageContext& context,
                            double first_progress) {
  Smoother(level_sets, options).run(options.sweeps, [&](double fraction) {
    report_progress(context, kStage, first_progress + (1 - first_progress) * fraction);
  });
  return level_sets;
}

}  // namespace cvmesh
