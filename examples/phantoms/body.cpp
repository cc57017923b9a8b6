// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"

#include "phantoms/absorb_crumbs.h"
#include "phantoms/implicit.h"
#include "phantoms/miniature_frame.h"
#include "phantoms/phantoms.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace cvmesh::examples {
namespace {

constexpr std::array<int, 3> kFullDims{512, 512, 600};
constexpr Vec3 kSpacing{0.9, 0.9, 1.0};
/// In mm after scaling: at least 1.25 voxels across any layer.
constexpr double kThinnestLayer = 1.25;
/// In voxels; smaller pieces of a tissue are artefacts of sampling.
constexpr std::size_t kCrumb = 50;

// Layers of the trunk; the organs follow from kFirstOrgan on.
enum Layer : Label { kSkin = 1, kFat, kMuscle, kCavity, kFirstOrgan };

constexpr int kVertebrae = 17, kRibPairs = 9;
constexpr double kVertebraStep = 26, kLowestVertebra = 110;  // mm

// x to the left of the body, y to the front, z up, in mm from the middle of the lowest slice.
using Shape = std::function<double(const Vec3&)>;

struct Organ {
  Shape shape;
  Vec3 lo, hi;  // outside this box the shape is positive
};

/// The anatomy at full size; `size` only enters the thickness of the layers.
class Body {
 public:
  explicit Body(double size) : thinnest_(kThinnestLayer / size) {
    add_bones();
    add_organs();
  }

  /// Labels of one row of voxels, of a slice at height z.
  template <typename Put>
  void for_each_voxel(
      double y, double z, double first_x, double step_x, int count, const Put& put) const {
    std::vector<std::size_t> near;
    for (std::size_t n = 0; n < organs_.size(); ++n)
      if (y >= organs_[n].lo.y && y <= organs_[n].hi.y && z >= organs_[n].lo.z &&
          z <= organs_[n].hi.z)
        near.push_back(n);
    for (int i = 0; i < count; ++i)
      put(i, tissue({first_x + i * step_x, y, z}, near));
  }

 private:
  [[nodiscard]] Label tissue(const Vec3& p, const std::vector<std::size_t>& near) const {
    const double d = trunk(p, 0);
    if (d >= 0) return 0;
    const double skin = std::max(2.5, thinnest_), fat = skin + std::max(fat_mm_(p.z), thinnest_);
    if (d > -skin) return kSkin;
    if (d > -fat) return kFat;
    for (const std::size_t n : near)
      if (p.x >= organs_[n].lo.x && p.x <= organs_[n].hi.x && organs_[n].shape(p) < 0)
        return static_cast<Label>(kFirstOrgan + n);
    return d > -(fat + std::max(22.0, thinnest_)) ? kMuscle : kCavity;
  }

  // A section `inset` mm smaller than the trunk.
  [[nodiscard]] double trunk(const Vec3& p, double inset) const {
    const double side =
        superellipse(p.x, p.y, half_width_(p.z) - inset, half_depth_(p.z) - inset, 2.4);
    return smooth_intersection(side, std::max(25 - p.z, p.z - 575) + inset, 30);
  }

  // Earlier ones win where two overlap.
  void add(const Vec3& lo, const Vec3& hi, Shape shape) {
    organs_.push_back({std::move(shape), lo, hi});
  }

  void add_ellipsoid(const Vec3& centre, const Vec3& semi_axes) {
    add(centre - semi_axes, centre + semi_axes,
        [=](const Vec3& p) { return ellipsoid(p, centre, semi_axes); });
  }

  void add_tube(std::vector<Vec3> path, double radius) {
    Vec3 lo = path.front(), hi = lo;
    for (const Vec3& at : path)
      for (int axis = 0; axis < 3; ++axis) {
        lo[axis] = std::min(lo[axis], at[axis]);
        hi[axis] = std::max(hi[axis], at[axis]);
      }
    const Vec3 margin{radius, radius, radius};
    add(lo - margin, hi + margin, [path = std::move(path), radius](const Vec3& p) {
      double d = thick_segment(p, path[0], path[1], radius, radius);
      for (std::size_t n = 2; n < path.size(); ++n)
        d = smooth_union(d, thick_segment(p, path[n - 1], path[n], radius, radius), radius);
      return d;
    });
  }

  void add_bones() {
    const double cord = std::max(7.0, 2 * thinnest_), arch = cord + std::max(6.0, 1.5 * thinnest_);
    add_tube({{0, kCordY, 60}, {0, kCordY, 560}}, cord);
    for (int n = 0; n < kVertebrae; ++n) {
      const double z = kLowestVertebra + n * kVertebraStep;
      add({-40, -115, z - 11}, {40, -28, z + 11}, [=](const Vec3& p) {
        const double disc = superellipse(p.x, p.y - kSpineY, 24, 18, 2);
        const double body = smooth_intersection(disc, std::abs(p.z - z) - 10, 4);
        const double ring =
            smooth_intersection(std::hypot(p.x, p.y - kCordY) - arch, std::abs(p.z - z) - 7, 4);
        const double spine = thick_segment(p, {0, kCordY - arch, z}, {0, -105, z - 4}, 5, 4);
        return smooth_union(smooth_union(body, ring, 4), spine, 4);
      });
    }
    for (int n = 0; n < 2 * kRibPairs; ++n) {
      const double side = n % 2 == 0 ? 1 : -1;
      const double z = kLowestVertebra + (kVertebrae - kRibPairs + n / 2) * kVertebraStep;
      add({side > 0 ? 22.0 : -220.0, -140, z - 60}, {side > 0 ? 220.0 : -22.0, 140, z + 40},
          [this, side, z](const Vec3& p) {
            // A band on a shell inside the muscles, sloping down to the front.
            const double shell = trunk(p, 28), height = p.z - (z - 0.2 * (p.y + 70));
            const double band = std::hypot(shell / 4.5, height / 6.5) - 1;
            return std::max(4.5 * band, 26 - side * p.x);
          });
    }
    add({-20, 40, 300}, {20, 140, 540}, [this](const Vec3& p) {  // sternum
      const double plate = std::abs(trunk(p, 28)) - 5;
      return smooth_intersection(smooth_intersection(plate, std::abs(p.x) - 17, 4),
                                 std::max(310 - p.z, p.z - 530), 4);
    });
    for (const double side : {1.0, -1.0})  // hip bones
      add({side > 0 ? 20.0 : -140.0, -100, 40}, {side > 0 ? 140.0 : -20.0, 60, 190},
          [side](const Vec3& p) {
            const Vec3 q{side * p.x, p.y, p.z};
            const double wing = ellipsoid(q, {88, -30, 120}, {44, 60, 68});
            const double hollow = ellipsoid(q, {74, -12, 128}, {44, 60, 68});
            return smooth_intersection(wing, -hollow, 5);
          });
    add_ellipsoid({0, -70, 70}, {34, 18, 26});  // sacrum
  }

  void add_organs() {
    add_tube({{2, -22, 330}, {8, -32, 440}, {0, -20, 555}}, 9);  // oesophagus
    add_tube({{0, 2, 400}, {0, 4, 480}, {0, 8, 560}}, 9);        // trachea
    add_tube({{12, -28, 110}, {12, -30, 330}, {26, -26, 430}, {8, 22, 452}, {0, 24, 400}}, 12);
    add_tube({{-16, -24, 110}, {-18, -20, 260}, {-24, 8, 350}}, 11);  // vena cava
    add_ellipsoid({24, 34, 372}, {26, 24, 32});                       // blood
    add_ellipsoid({24, 34, 372}, {42, 38, 50});                       // heart
    add_ellipsoid({-52, 68, 262}, {14, 12, 26});                      // gall bladder
    for (const double side : {1.0, -1.0})
      add_ellipsoid({side * 62, -42, 228 + 6 * side}, {27, 21, 52});  // kidneys
    add_tube({{52, -8, 262}, {14, 14, 248}, {-26, 16, 240}}, 12);     // pancreas
    add_ellipsoid({98, -38, 292}, {26, 34, 46});                      // spleen
    add({-128, -72, 225}, {60, 88, 345}, [](const Vec3& p) {          // liver
      const double right = ellipsoid(p, {-68, 8, 285}, {60, 76, 60});
      const double left = ellipsoid(p, {-10, 42, 300}, {64, 40, 34});
      return smooth_union(right, left, 16);
    });
    add_tube({{44, 20, 330}, {66, 34, 290}, {30, 58, 252}}, 24);  // stomach
    add_ellipsoid({0, 30, 96}, {40, 32, 30});                     // bladder
    for (const double side : {1.0, -1.0})                         // lungs
      add_ellipsoid({side * 82, 0, 428}, {58, 70, 112});
  }

  static constexpr double kSpineY = -50, kCordY = -82;

  double thinnest_;  // mm at full size
  Profile half_width_{{0, 172}, {90, 190}, {200, 160}, {330, 176}, {480, 200}, {580, 190}};
  Profile half_depth_{{0, 120}, {90, 126}, {200, 114}, {330, 124}, {460, 130}, {580, 116}};
  Profile fat_mm_{{0, 18}, {120, 16}, {260, 14}, {420, 8}, {600, 6}};
  std::vector<Organ> organs_;
};

}  // namespace

InputVolume body(double size) {
  require(size >= kMinBodySize && size <= 1, ErrorCode::BadParameter, "body",
          "size (" + std::to_string(size) + ") is outside 0.25 to 1; choose one in between");
  const GridFrame frame = miniature_frame(kFullDims, kSpacing, size);
  Vec3 step;  // one voxel, in mm at full size
  for (int axis = 0; axis < 3; ++axis)
    step[axis] = kFullDims[axis] * kSpacing[axis] / frame.dims[axis];
  const Body anatomy(size);
  InputVolume volume(frame);
  const auto [nx, ny, nz] = frame.dims;
  const auto slices = static_cast<std::size_t>(nz);
  parallel_for_each_index(
      0, slices,
      [&, nx = nx, ny = ny](std::size_t slice) {
        const auto k = static_cast<int>(slice);
        for (int j = 0; j < ny; ++j)
          anatomy.for_each_voxel((j - 0.5 * (ny - 1)) * step.y, (k + 0.5) * step.z,
                                 -0.5 * (nx - 1) * step.x, step.x, nx,
                                 [&](int i, Label label) { volume(i, j, k) = label; });
      },
      1);
  absorb_crumbs(kCrumb, volume);
  absorb_crumbs(kCrumb, volume);
  return volume;
}

}  // namespace cvmesh::examples
