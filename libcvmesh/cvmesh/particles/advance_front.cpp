// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/advance_front.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/particles/size_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace cvmesh {
namespace {

// Steps are a little shorter than h, so that the gaps where fronts meet make up for it.
constexpr double kSpacing = 0.97;
constexpr double kNeighbourReach = 1.5;  // over h: farther points are not of the first ring
constexpr double kLeastSpacing = 0.75;   // over h: nearer to another point nothing is placed
constexpr double kGap = 0.8;             // over h: this far from all others a point is missing
constexpr double kFullAngle = 2 * std::numbers::pi;
constexpr double kIdealAngle = std::numbers::pi / 3;
// A new point is fitted to the points of the first ring: springs of length h in its tangent plane.
constexpr double kFitReach = 1.35;  // over h
constexpr int kFitSteps = 2;
constexpr double kFitDamping = 0.2, kLongestFit = 0.3;  // the step over h
constexpr double kLongestStretch = 1.3;  // of a step that the curved surface shortens
// The mean h of two points this near is less than this over the h of one.
constexpr double kLargestMean = 1.5;
// Points this near have at least this part of one's own h, by the slope of the sizing field (up to
// delta 0.8; where it is larger, a point that was missed is deleted as coincident later).
constexpr double kLeastSize = 0.4;

class Front {
 public:
  Front(const Sheets& sheets,
        double h_scale,
        double clearance_mm,
        const std::vector<SurfacePoint>& rim,
        const CounterRandom& random)
      : sheets_(sheets), h_scale_(h_scale), clearance_(clearance_mm), random_(random) {
    for (const SurfacePoint& p : rim)
      add(p, p.h_mm);
    rim_size_ = placed_.size();
  }

  std::vector<SurfacePoint> grow(const Sheet& sheet) {
    spread();
    // Where no front came by: another start there.
    for (const auto& [v, f] : vertices_far_from_all(sheet)) {
      const Vec3& p = sheets_.domain().dense.points[v];
      if (!is_free(p, sheets_.vertex_normal(v), h_scale_ * sheets_.h_mm[v], kGap)) continue;
      const SurfacePoint there = sheets_.move(f, p);
      const double h = h_scale_ * there.h_mm;
      if (there.curve_distance < clearance_ ||
          !is_free(there.position, there.normal, h, kLeastSpacing))
        continue;
      add(there, h);
      spread();
    }
    return {placed_.begin() + static_cast<std::ptrdiff_t>(rim_size_), placed_.end()};
  }

 private:
  struct Spoke {
    double angle, length;
  };

  void add(const SurfacePoint& p, double h) {
    grid_.add(static_cast<std::int32_t>(placed_.size()), p.position, h);
    placed_.push_back(p);
    h_.push_back(h);
  }

  struct Place {
    std::int32_t vertex, facet;
  };

  // In random order.
  [[nodiscard]] std::vector<Place> vertices_far_from_all(const Sheet& sheet) const {
    const auto& dense = sheets_.domain().dense;
    std::vector<Place> inner;
    std::vector<std::uint8_t> is_far(3 * sheet.facets.size(), 0);
    parallel_for_each_index(0, sheet.facets.size(), [&](std::size_t n) {
      for (int k = 0; k < 3; ++k) {
        const auto v = dense.facets[sheet.facets[n]][k];
        // Each vertex once: at the first of its facets.
        if (sheets_.domain().strata.dimension[v] == 2 && sheets_.first_facet(v) == sheet.facets[n])
          is_far[3 * n + k] =
              is_free(dense.points[v], sheets_.vertex_normal(v), h_scale_ * sheets_.h_mm[v], kGap);
      }
    });
    for (std::size_t n = 0; n < is_far.size(); ++n)
      if (is_far[n] != 0) {
        const auto f = sheet.facets[n / 3];
        inner.push_back({dense.facets[f][n % 3], f});
      }
    std::vector<Place> shuffled;
    for (const auto n : random_.permutation(inner.size()))
      shuffled.push_back(inner[n]);
    return shuffled;
  }

  void spread() {
    for (; next_ < placed_.size(); ++next_)
      complete(next_);
  }

  // Whether no point is nearer than `spacing` times the mean h.
  [[nodiscard]] bool is_free(const Vec3& p, const Vec3& normal, double h, double spacing) const {
    bool is_free = true;
    grid_.visit_near(p, kLargestMean * spacing * h, kLeastSize * h, [&](std::int32_t j) {
      const SurfacePoint& q = placed_[j];
      if (is_free && dot(q.normal, normal) > 0 && distance(q.position, p) < spacing * mean_h(j, h))
        is_free = false;
    });
    return is_free;
  }

  [[nodiscard]] double mean_h(std::size_t at, double h) const { return 0.5 * (h_[at] + h); }

  // Directions and distances of the neighbours of a point in its tangent plane, by angle.
  void find_spokes(std::size_t at, const TangentFrame& frame) {
    spokes_.clear();
    const SurfacePoint& p = placed_[at];
    grid_.visit_near(
        p.position, kNeighbourReach * kLargestMean * h_[at], kLeastSize * h_[at],
        [&](std::int32_t j) {
          if (static_cast<std::size_t>(j) == at) return;
          const SurfacePoint& q = placed_[j];
          const Vec3 d = q.position - p.position;
          if (norm(d) >= kNeighbourReach * mean_h(at, h_[j]) || !(dot(p.normal, q.normal) > 0))
            return;
          spokes_.push_back({std::atan2(dot(d, frame.v), dot(d, frame.u)), norm(d)});
        });
    std::sort(spokes_.begin(), spokes_.end(), [](const Spoke& a, const Spoke& b) {
      return a.angle != b.angle ? a.angle < b.angle : a.length < b.length;
    });
  }

  void complete(std::size_t at) {
    if (placed_[at].facet < 0) return;
    const TangentFrame frame(placed_[at].normal);
    find_spokes(at, frame);
    if (spokes_.empty()) {
      const double angle = kFullAngle * random_.uniform(placed_[at].facet, 1);
      if (!place(at, frame.at_angle(angle))) return;
      spokes_.push_back({angle, h_[at]});
    }
    const auto spokes = spokes_;
    for (std::size_t k = 0; k < spokes.size(); ++k) {
      const double from = spokes[k].angle;
      double to = k + 1 < spokes.size() ? spokes[k + 1].angle : spokes.front().angle + kFullAngle;
      const int parts = static_cast<int>(std::lround((to - from) / kIdealAngle));
      for (int part = 1; part < parts; ++part) {
        const double angle = from + (to - from) * part / parts;
        place(at, frame.at_angle(angle));
      }
    }
  }

  // A new point at distance h from an old one, unless it leaves the sheet or comes too near to
  // another.
  bool place(std::size_t at, const Vec3& direction) {
    const SurfacePoint from = placed_[at];
    double step = kSpacing * h_[at];
    SurfacePoint there;
    double h = h_[at];
    for (int round = 0; round < 2; ++round) {
      there = sheets_.move(from.facet, from.position + step * direction);
      h = h_scale_ * there.h_mm;
      const double wanted = kSpacing * mean_h(at, h),
                   reached = distance(there.position, from.position);
      if (!(reached > 0)) return false;
      step *= std::clamp(wanted / reached, 1 / kLongestStretch, kLongestStretch);
    }
    for (int n = 0; n < kFitSteps; ++n)
      fit(there);
    h = h_scale_ * there.h_mm;
    if (there.curve_distance < clearance_) return false;
    if (!is_free(there.position, there.normal, h, kLeastSpacing)) return false;
    add(there, h);
    return true;
  }

  // A Gauss-Newton step of the springs to all points around, not only to the one that it came from:
  // without it the errors of one ring are handed on to the next.
  void fit(SurfacePoint& point) const {
    const double h = h_scale_ * point.h_mm;
    const TangentFrame frame(point.normal);
    double gu = 0, gv = 0, huu = kFitDamping, huv = 0, hvv = kFitDamping;
    grid_.visit_near(point.position, kLargestMean * kFitReach * h, kLeastSize * h,
                     [&](std::int32_t j) {
                       const Vec3 d = point.position - placed_[j].position;
                       const double length = norm(d), ideal = kSpacing * mean_h(j, h);
                       if (length > kFitReach * ideal || !(length > 0) ||
                           !(dot(placed_[j].normal, point.normal) > 0))
                         return;
                       const double du = dot(d, frame.u) / length, dv = dot(d, frame.v) / length;
                       gu += du * (ideal - length);
                       gv += dv * (ideal - length);
                       huu += du * du;
                       huv += du * dv;
                       hvv += dv * dv;
                     });
    const double determinant = huu * hvv - huv * huv;
    Vec3 step = ((hvv * gu - huv * gv) / determinant) * frame.u +
                ((huu * gv - huv * gu) / determinant) * frame.v;
    const double length = norm(step);
    if (length > kLongestFit * h) step *= kLongestFit * h / length;
    point = sheets_.move(point.facet, point.position + step);
  }

  const Sheets& sheets_;
  double h_scale_, clearance_;
  CounterRandom random_;
  SizeGrid grid_;
  std::vector<SurfacePoint> placed_;
  std::vector<double> h_;
  std::vector<Spoke> spokes_;
  std::size_t rim_size_ = 0, next_ = 0;
};

}  // namespace

std::vector<SurfacePoint> advance_front(const Sheets& sheets,
                                        const Sheet& sheet,
                                        const std::vector<SurfacePoint>& rim,
                                        double h_scale,
                                        double clearance_mm,
                                        const CounterRandom& random) {
  return Front(sheets, h_scale, clearance_mm, rim, random).grow(sheet);
}

}  // namespace cvmesh
