// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"

#include "phantoms/absorb_crumbs.h"
#include "phantoms/implicit.h"
#include "phantoms/miniature_frame.h"
#include "phantoms/phantoms.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

namespace cvmesh::examples {
namespace {

enum Tissue : Label { kNone, kProsthesis, kCement, kCanal, kTrabecular, kCortical, kFibrous };

constexpr std::array<int, 3> kFullDims{250, 250, 500};
constexpr Vec3 kSpacing{0.5, 0.4, 0.8};
constexpr Vec3 kBox{125, 100, 400};  // mm, all shapes below live in it
/// In mm after scaling: at least 1.25 voxels across any layer.
constexpr double kThinnestLayer = 1;
/// In voxels; smaller pieces of a tissue are artefacts of sampling.
constexpr std::size_t kCrumb = 50;

/// The anatomy at full size, in mm from the corner of the box: x to the side of the head, y to the
/// front, z up. `size` only enters the thickness of the layers.
class Femur {
 public:
  explicit Femur(double size) : thinnest_(kThinnestLayer / size) {}

  /// Distances of a point, negative inside: of the bone as grown, and of the prosthesis.
  struct Distances {
    double bone, prosthesis;
  };

  [[nodiscard]] Distances distances(const Vec3& p) const { return {bone(p), prosthesis(p)}; }

  [[nodiscard]] Label tissue(const Vec3& p) const {
    if (prosthesis(p) < 0) return kProsthesis;
    const double d = bone(p);
    if (d >= 0 || is_resected(p)) return kNone;
    const double cortex = std::max(cortex_mm_(p.z), thinnest_);
    const double from_stem = stem(p);
    const double mantle = std::max(cement_mm(p), thinnest_);
    const bool is_in_cortex = d > -cortex;
    if (!is_in_cortex && (from_stem < mantle || is_cement_plug(p))) return kCement;
    // Fibrous tissue grows around a loose mantle and eats into the cortex, not through it.
    const bool is_eroded = d < -std::max(0.6 * cortex, thinnest_);
    if (is_eroded && from_stem >= mantle && from_stem < mantle + fibrous_mm(p)) return kFibrous;
    if (is_in_cortex) return kCortical;
    return canal(p) < 0 ? kCanal : kTrabecular;
  }

 private:
  [[nodiscard]] double bone(const Vec3& p) const {
    const double x = p.x - centre_x_(p.z), y = p.y - centre_y_(p.z);
    double d = superellipse(x, y, half_width_(p.z), half_depth_(p.z), 2.0);
    d = smooth_intersection(d, std::max(14 - p.z, p.z - 352), 12);
    d = smooth_union(d, ellipsoid(p, {86, 42, 32}, {21, 30, 26}), 12);  // medial condyle
    d = smooth_union(d, ellipsoid(p, {38, 43, 34}, {21, 29, 24}), 12);  // lateral condyle
    d = smooth_intersection(                                            // intercondylar notch
        d, -thick_segment(p, {62, 4, 2}, {62, 38, 12}, 13, 9), 6);
    d = smooth_union(d, thick_segment(p, kNeckFoot, kNeckTop, 18, 15), 10);
    d = smooth_union(d, ellipsoid(p, {36, 49, 352}, {15, 18, 26}), 10);  // greater trochanter
    d = smooth_union(d, ellipsoid(p, {73, 33, 296}, {9, 8, 13}), 8);     // lesser trochanter
    d = smooth_union(d, ellipsoid(p, {57.5, 38, 205}, {4, 4, 75}), 6);   // linea aspera
    return d + roughness(p);
  }

  // Unevenness of a real surface, half a millimetre high, tens of millimetres long.
  static double roughness(const Vec3& p) {
    return 0.25 * (std::sin(0.21 * p.x + 0.05 * p.z) +
                   std::sin(0.19 * p.y - 0.07 * p.z) * std::sin(0.11 * p.z + 1));
  }

  // The head and half of the neck are sawn off; the trochanters stay.
  [[nodiscard]] static bool is_resected(const Vec3& p) {
    const Vec3 normal = normalized(kNeckTop - kNeckFoot);
    return p.x > 52 && dot(p - kResection, normal) > 0;
  }

  [[nodiscard]] double stem(const Vec3& p) const {
    const double t = (p.z - kStemTip.z) / (kStemShoulder.z - kStemTip.z);
    const Vec3 axis = kStemTip + t * (kStemShoulder - kStemTip);
    const double side =
        superellipse(p.x - axis.x, p.y - axis.y, stem_half_width_(p.z), stem_half_depth_(p.z), 3.0);
    return smooth_intersection(side, std::max(kStemTip.z - p.z, p.z - kStemShoulder.z), 5);
  }

  [[nodiscard]] double prosthesis(const Vec3& p) const {
    const double neck = thick_segment(p, kStemShoulder - Vec3{0, 0, 8}, kHeadCentre, 7.5, 6);
    const double head = ellipsoid(p, kHeadCentre, {15, 15, 15});
    return std::min(smooth_union(stem(p), neck, 8), smooth_union(neck, head, 3));
  }

  // Cement is pressed in by hand: thicker here, thinner there.
  static double cement_mm(const Vec3& p) {
    return 3 + 0.7 * std::sin(0.09 * p.z) * std::sin(0.2 * p.x + 0.1 * p.y);
  }

  // The plug that closes the canal below the tip.
  [[nodiscard]] bool is_cement_plug(const Vec3& p) const {
    return p.z > kStemTip.z - 14 && p.z < kStemTip.z && canal(p) < 0;
  }

  [[nodiscard]] double canal(const Vec3& p) const {
    const double x = p.x - centre_x_(p.z), y = p.y - centre_y_(p.z);
    const double side = superellipse(x, y, canal_radius_(p.z), 1.05 * canal_radius_(p.z), 2.0);
    return smooth_intersection(side, std::max(78 - p.z, p.z - 312), 10);
  }

  // Three lens-shaped membranes around the mantle; thinner than the thinnest layer they are absent.
  [[nodiscard]] double fibrous_mm(const Vec3& p) const {
    struct Patch {
      double direction_deg, z, half_angle_deg, half_height, thickness;
    };

    static constexpr std::array<Patch, 3> kPatches{
        Patch{20, 262, 65, 30, 3.6}, Patch{165, 228, 60, 24, 3.0}, Patch{275, 302, 55, 22, 4.2}};
    const double direction_deg =
        std::atan2(p.y - centre_y_(p.z), p.x - centre_x_(p.z)) * 180 / std::numbers::pi;
    double thickness = 0;
    for (const Patch& patch : kPatches) {
      const double turn = std::remainder(direction_deg - patch.direction_deg, 360.0);
      const double u = turn / patch.half_angle_deg, v = (p.z - patch.z) / patch.half_height;
      const double full = std::max(patch.thickness, 1.4 * thinnest_);
      thickness = std::max(thickness, full * (1 - u * u - v * v));
    }
    return thickness < 0.5 * thinnest_ ? 0 : thickness;
  }

  static constexpr Vec3 kNeckFoot{54, 50, 322}, kNeckTop{88, 52, 362}, kResection{73, 51, 344};
  static constexpr Vec3 kStemTip{58, 55, 190}, kStemShoulder{57, 50.5, 338};
  static constexpr Vec3 kHeadCentre{95, 52.5, 370};

  double thinnest_;  // mm at full size
  Profile centre_x_{{10, 62}, {100, 61}, {220, 58}, {290, 57}, {345, 50}};
  Profile centre_y_{{10, 50}, {80, 51}, {180, 56}, {260, 55}, {330, 50}};
  Profile half_width_{{10, 38},  {60, 31},  {105, 21}, {160, 17.5},
                      {230, 17}, {280, 19}, {320, 23}, {352, 25}};
  Profile half_depth_{{10, 25},  {60, 23},    {105, 19}, {160, 18},
                      {230, 18}, {280, 18.5}, {320, 20}, {352, 18}};
  Profile cortex_mm_{{10, 2}, {60, 2.4}, {110, 4.5}, {160, 6}, {250, 6}, {300, 4.5}, {350, 2.2}};
  Profile canal_radius_{{78, 4}, {120, 10}, {160, 13}, {250, 13}, {285, 12}, {312, 8}};
  Profile stem_half_width_{{190, 4.5}, {240, 6}, {290, 9}, {338, 13}};
  Profile stem_half_depth_{{190, 4.5}, {240, 5.5}, {290, 7}, {338, 8}};
};

}  // namespace

InputVolume femur(double size) {
  require(size >= kMinFemurSize && size <= kMaxFemurSize, ErrorCode::BadParameter, "femur",
          "size (" + std::to_string(size) + ") is outside 0.24 to 2; choose one in between");
  const GridFrame frame = miniature_frame(kFullDims, kSpacing, size);
  Vec3 step;  // one voxel, in mm at full size
  for (int axis = 0; axis < 3; ++axis)
    step[axis] = kBox[axis] / frame.dims[axis];
  const Femur anatomy(size);
  const auto centre = [&](double i, double j, double k) {
    return scaled_by({i + 0.5, j + 0.5, k + 0.5}, step);
  };

  // Nine tenths of the box are air: whole blocks of it are passed over. The shapes' values may
  // exceed the true distance, so a block must be clear by four times its own radius.
  constexpr int kBlock = 8;
  const double clear = 4 * 0.5 * kBlock * norm(step);
  InputVolume volume(frame);
  for (int k0 = 0; k0 < frame.dims[2]; k0 += kBlock) {
    for (int j0 = 0; j0 < frame.dims[1]; j0 += kBlock) {
      for (int i0 = 0; i0 < frame.dims[0]; i0 += kBlock) {
        const double middle = 0.5 * (kBlock - 1);
        const auto [bone, prosthesis] =
            anatomy.distances(centre(i0 + middle, j0 + middle, k0 + middle));
        if (std::min(bone, prosthesis) > clear) continue;
        for (int k = k0; k < std::min(k0 + kBlock, frame.dims[2]); ++k) {
          for (int j = j0; j < std::min(j0 + kBlock, frame.dims[1]); ++j) {
            for (int i = i0; i < std::min(i0 + kBlock, frame.dims[0]); ++i) {
              volume(i, j, k) = anatomy.tissue(centre(i, j, k));
            }
          }
        }
      }
    }
  }
  // A crumb beside a crumb may need a second pass; more than that does not occur.
  absorb_crumbs(kCrumb, volume);
  absorb_crumbs(kCrumb, volume);
  return volume;
}

}  // namespace cvmesh::examples
