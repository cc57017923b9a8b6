// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/random_volumes.h"

#include "cvmesh/core/random.h"

#include "support/phantoms.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

namespace cvmesh::random_volumes {
namespace {

constexpr int kLeastSide = 8, kMostSide = 48;
constexpr int kMostLabels = 200;

/// Draws in a row from one seed: the order of the calls is part of what a seed means.
class Draws {
 public:
  Draws(std::uint64_t seed, const char* purpose) : random_(seed, purpose) {}

  double uniform() { return random_.uniform(count_++); }

  double between(double low, double high) { return low + (high - low) * uniform(); }

  /// low to high, both included.
  int integer(int low, int high) {
    return low +
           static_cast<int>(random_.bits(count_++) % (static_cast<std::uint64_t>(high) - low + 1));
  }

  /// low to high, more often near low: half of all draws lie in the first eighth.
  int mostly_low(int low, int high) {
    const double u = uniform();
    return low + static_cast<int>(u * u * u * (high - low + 0.999));
  }

  bool one_in(int n) { return integer(1, n) == 1; }

 private:
  CounterRandom random_;
  std::uint64_t count_ = 0;
};

Vec3 position(int i, int j, int k) {
  return {static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)};
}

template <typename LabelAt>
void fill(InputVolume& volume, const LabelAt& label_at) {
  const auto& [nx, ny, nz] = volume.frame.dims;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        volume(i, j, k) = label_at(i, j, k);
}

Vec3 point_in(Draws& draws, const std::array<int, 3>& dims) {
  return {draws.between(0, dims[0]), draws.between(0, dims[1]), draws.between(0, dims[2])};
}

void blobs(InputVolume& volume, Draws& draws, int labels) {
  const double size = *std::min_element(volume.frame.dims.begin(), volume.frame.dims.end());
  const int balls = labels + draws.integer(0, labels);
  for (int b = 0; b < balls; ++b) {
    const Vec3 middle = point_in(draws, volume.frame.dims);
    const double radius = draws.between(0.6, 0.45 * size);
    const Label label = 1 + b % labels;
    fill(volume, [&](int i, int j, int k) {
      return distance(position(i, j, k), middle) < radius ? label : volume(i, j, k);
    });
  }
}

/// Index of the nearest of some random points, and how much nearer it is than the second.
struct Nearest {
  int index = 0;
  double lead = 0;
};

template <typename LabelAt>
void by_nearest(InputVolume& volume, Draws& draws, int points, const LabelAt& label_at) {
  std::vector<Vec3> middles;
  for (int p = 0; p < points; ++p)
    middles.push_back(point_in(draws, volume.frame.dims));
  fill(volume, [&](int i, int j, int k) {
    double first = std::numeric_limits<double>::max(), second = first;
    Nearest nearest;
    for (int p = 0; p < points; ++p) {
      const double d = distance(position(i, j, k), middles[static_cast<std::size_t>(p)]);
      second = std::min(second, std::max(d, first));
      if (d < first) nearest.index = p;
      first = std::min(d, first);
    }
    nearest.lead = second - first;
    return label_at(nearest);
  });
}

void noise(InputVolume& volume, Draws& draws, int labels) {
  const double background = draws.one_in(3) ? 0 : draws.between(0.05, 0.9);
  fill(volume,
       [&](int, int, int) { return draws.uniform() < background ? 0 : draws.integer(1, labels); });
}

void vote(InputVolume& volume) {
  const InputVolume before = volume;
  fill(volume, [&](int i, int j, int k) {
    std::array<Label, 27> seen{};
    std::size_t count = 0;
    for (int dk = -1; dk <= 1; ++dk)
      for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di)
          if (before.frame.contains(i + di, j + dj, k + dk))
            seen[count++] = before(i + di, j + dj, k + dk);
    std::sort(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(count));
    std::size_t most = 0;
    Label winner = 0;
    for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
      while (end < count && seen[end] == seen[begin])
        ++end;
      if (end - begin > most) {
        most = end - begin;
        winner = seen[begin];
      }
    }
    return winner;
  });
}

void checkerboard(InputVolume& volume, Draws& draws, int labels) {
  const int cube = draws.integer(1, 4);
  const int first = draws.integer(0, 1);  // 0: cubes of background among them
  const int cycle = std::min(labels + 1 - first, 5);
  const int margin = draws.integer(0, 2);
  fill(volume, [&](int i, int j, int k) {
    const std::array<int, 3> at = {i, j, k};
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (at[axis] < margin || at[axis] >= volume.frame.dims[axis] - margin) return 0;
    return first + (i / cube + j / cube + k / cube) % cycle;
  });
}

void specks(InputVolume& volume, Draws& draws, int labels) {
  const Label around = draws.one_in(2) ? 0 : 1;
  const double share = draws.between(0.002, 0.1);
  fill(volume,
       [&](int, int, int) { return draws.uniform() < share ? draws.integer(1, labels) : around; });
}

void corners(InputVolume& volume, Draws& draws, int labels) {
  std::array<int, 3> at{};
  for (std::size_t axis = 0; axis < 3; ++axis)
    at[axis] = draws.integer(0, volume.frame.dims[axis] - 1);
  const int boxes = labels + draws.integer(4, 40);
  for (int b = 0; b < boxes; ++b) {
    std::array<int, 3> size{}, end{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      size[axis] = draws.integer(1, 3);
      end[axis] = std::min(at[axis] + size[axis], volume.frame.dims[axis]);
    }
    const Label label = 1 + b % labels;
    for (int k = at[2]; k < end[2]; ++k)
      for (int j = at[1]; j < end[1]; ++j)
        for (int i = at[0]; i < end[0]; ++i)
          volume(i, j, k) = label;
    for (std::size_t axis = 0; axis < 3; ++axis) {  // the next box starts diagonally beside it
      at[axis] += draws.one_in(4) ? 0 : (draws.one_in(2) ? size[axis] : -draws.integer(1, 3));
      if (at[axis] < 0 || at[axis] >= volume.frame.dims[axis])
        at[axis] = draws.integer(0, volume.frame.dims[axis] - 1);
    }
  }
}

void shells(InputVolume& volume, Draws& draws, int labels) {
  const Vec3 middle = point_in(draws, volume.frame.dims);
  const double outer = draws.between(3, 0.7 * volume.frame.dims[0]);
  const bool is_cube = draws.one_in(2);
  fill(volume, [&](int i, int j, int k) {
    const Vec3 d = position(i, j, k) - middle;
    const double r = is_cube ? std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)}) : norm(d);
    return r > outer ? 0 : 1 + static_cast<int>(r) % labels;
  });
}

void threads(InputVolume& volume, Draws& draws, int labels) {
  const Label around = draws.one_in(2) ? 0 : labels;
  fill(volume, [&](int, int, int) { return around; });
  const int walks = labels + draws.integer(0, 6);
  for (int w = 0; w < walks; ++w) {
    std::array<int, 3> at{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      at[axis] = draws.integer(0, volume.frame.dims[axis] - 1);
    const int steps = draws.integer(5, 80);
    for (int s = 0; s < steps; ++s) {
      volume(at[0], at[1], at[2]) = 1 + w % labels;
      for (std::size_t axis = 0; axis < 3; ++axis)  // diagonal steps among them
        at[axis] = std::clamp(at[axis] + draws.integer(-1, 1), 0, volume.frame.dims[axis] - 1);
    }
  }
}

void fill(InputVolume& volume, Kind kind, Draws& draws, int labels) {
  switch (kind) {
    case Kind::Blobs:
      return blobs(volume, draws, labels);
    case Kind::Cells:
      return by_nearest(volume, draws, labels + draws.integer(0, labels),
                        [&](const Nearest& n) { return 1 + n.index % labels; });
    case Kind::Noise:
      return noise(volume, draws, labels);
    case Kind::SmoothNoise:
      noise(volume, draws, labels);
      for (int votes = draws.integer(1, 4); votes > 0; --votes)
        vote(volume);
      return;
    case Kind::Checkerboard:
      return checkerboard(volume, draws, labels);
    case Kind::Specks:
      return specks(volume, draws, labels);
    case Kind::Corners:
      return corners(volume, draws, labels);
    case Kind::Walls:
      return by_nearest(volume, draws, labels, [&](const Nearest& n) {
        return n.lead < 1 ? labels : (draws.one_in(50) ? 0 : n.index);
      });
    case Kind::Shells:
      return shells(volume, draws, labels);
    case Kind::Threads:
      return threads(volume, draws, labels);
  }
}

/// Where nearly every voxel has a boundary, a voxel costs ten times what it costs elsewhere.
bool is_ragged(Kind kind) {
  return kind == Kind::Noise || kind == Kind::Checkerboard || kind == Kind::Specks ||
         kind == Kind::Threads;
}

/// Dims of which a run takes seconds, so that thousands of volumes can be tried.
std::array<int, 3> random_dims(Kind kind, Draws& draws) {
  const int most_voxels = is_ragged(kind) ? 5'000 : 40'000;
  std::array<int, 3> dims{};
  for (int& n : dims)
    n = draws.mostly_low(kLeastSide, kMostSide);
  while (dims[0] * dims[1] * dims[2] > most_voxels) {
    int& longest = *std::max_element(dims.begin(), dims.end());
    longest = std::max(kLeastSide, longest * 3 / 4);
  }
  return dims;
}

/// At least two voxels with a label above 0, whatever the kind left: an empty volume is no test.
void ensure_content(InputVolume& volume) {
  const auto is_label = [](Label label) { return label > 0; };
  const std::array<int, 3>& dims = volume.frame.dims;
  if (std::none_of(volume.values.begin(), volume.values.end(), is_label))
    volume(dims[0] / 2, dims[1] / 2, dims[2] / 2) = 1;
  const Label first = volume.values[0];
  const bool is_uniform = std::all_of(volume.values.begin(), volume.values.end(),
                                      [&](Label label) { return label == first; });
  if (is_uniform) volume(0, 0, 0) = first + 1;
}

/// Labels as users have them: mostly small, now and then gaps, large numbers and negative ones.
void rename(InputVolume& volume, Draws& draws) {
  if (!draws.one_in(8)) return;
  const Label stride = draws.integer(2, 100'000);
  const Label shift = draws.integer(-1'000, 1'000'000'000);
  for (Label& label : volume.values)
    if (label != 0) label = shift + stride * label != 0 ? shift + stride * label : 1;
}

GridFrame random_frame(const std::array<int, 3>& dims, Draws& draws) {
  Vec3 spacing{1, 1, 1};
  if (draws.one_in(2))
    spacing = {draws.between(0.3, 1.5), draws.between(0.3, 1.5), draws.between(0.3, 1.5)};
  if (draws.one_in(6)) spacing.z = 5 * std::min(spacing.x, spacing.y);
  return phantoms::centred_frame(dims, spacing);
}

InputVolume turned(InputVolume volume, Draws& draws) {
  if (draws.one_in(6)) volume = phantoms::mirrored(std::move(volume));
  if (!draws.one_in(3)) return volume;
  const double z = draws.between(-1, 1), angle = draws.between(0, 2 * std::numbers::pi);
  const double s = std::sqrt(1 - z * z);
  const Vec3 axis{s * std::cos(angle), s * std::sin(angle), z};
  const Vec3 shift = {draws.between(-200, 200), draws.between(-200, 200), draws.between(-200, 200)};
  return phantoms::rotated(std::move(volume), axis, draws.between(-180, 180), shift);
}

}  // namespace

const char* name_of(Kind kind) {
  constexpr std::array<const char*, kKinds> kNames = {
      "blobs",  "cells",   "noise", "smooth noise", "checkerboard",
      "specks", "corners", "walls", "shells",       "threads"};
  return kNames[static_cast<std::size_t>(kind)];
}

std::string RandomVolume::description() const {
  const std::set<Label> labels(volume.values.begin(), volume.values.end());
  const auto& [nx, ny, nz] = volume.frame.dims;
  return std::string(name_of(kind)) + " " + std::to_string(nx) + " x " + std::to_string(ny) +
         " x " + std::to_string(nz) + ", " + std::to_string(labels.size() - labels.count(0)) +
         " labels";
}

RandomVolume make(std::uint64_t seed, Kind kind, const std::array<int, 3>& dims, int labels) {
  Draws draws(seed, "random volume");
  RandomVolume result{kind, InputVolume(random_frame(dims, draws))};
  fill(result.volume, kind, draws, labels);
  ensure_content(result.volume);
  rename(result.volume, draws);
  result.volume = turned(std::move(result.volume), draws);
  return result;
}

RandomVolume make(std::uint64_t seed) {
  Draws draws(seed, "random shape");
  const auto kind = static_cast<Kind>(seed % kKinds);
  const std::array<int, 3> dims = random_dims(kind, draws);
  return make(seed, kind, dims, draws.mostly_low(2, kMostLabels));
}

}  // namespace cvmesh::random_volumes
