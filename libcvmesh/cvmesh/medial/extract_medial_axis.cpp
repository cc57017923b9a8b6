// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/medial/extract_medial_axis.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/medial/feature_transform.h"
#include "cvmesh/medial/point_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr char kStage[] = "medial axis";

// Walls are opposed when their normals are more than 120 degrees apart.
constexpr double kOpposedCosine = -0.5;

// Walls whose normals are less than 25 degrees apart are one smooth wall, seen through sites that
// are far apart: between thick slices the sites leave gaps that look like medial pairs. True pairs
// pass: the ratio of the pruning asks for 70 degrees between the directions to the sites.
constexpr double kSameWallCosine = 0.9;

// The walls of a wedge are nearest to its curve within this many chords: 12 covers wedges down to
// 5 degrees.
constexpr double kWedgeReachChords = 12;
// The tangent plane of either wall of a wedge passes the curve closer than this. A plate that ends
// at a curve has one wall a whole chord away. The voxels are the noise of curves and normals.
constexpr double kWedgeOffsetChords = 0.4;
constexpr double kWedgeOffsetVox = 0.5;

// How far the centre of the touching ball may lie from the bisector point of a pair, in voxels: the
// pair's own resolution. Farther off, the normals are not to be trusted.
constexpr double kMaxCentreShiftVox = 1.5;
// Pairs of shorter chords may be two sites on one small bump. A branch of the axis is a row of
// points; one that has no other within reach is a bump. (A ball of radius 6 had such points half
// way to its surface.)
constexpr double kCertainChordVox = 2.2;
constexpr double kCompanyReachVox = 1.5;

using Triple = std::array<MaterialId, 3>;

// The junction curves, by the three materials that meet along them.
class JunctionCurves {
 public:
  JunctionCurves(const InterfaceMesh& dense, const Strata& strata) {
    std::map<Triple, std::vector<Vec3>> points;
    std::map<std::int32_t, std::set<MaterialId>> at_corner;
    for (const auto& curve : strata.curves) {
      std::set<MaterialId> materials;
      for (const auto& patch : curve.patches)
        if (patch.wall == 0) materials.insert({patch.sides.inside, patch.sides.outside});
      const auto triples = triples_of(materials);
      for (const auto v : curve.vertices) {
        if (strata.dimension[v] == 0)
          at_corner[v].insert(materials.begin(), materials.end());
        else
          for (const auto& t : triples)
            points[t].push_back(dense.points[v]);
      }
    }
    for (const auto& [v, materials] : at_corner)
      for (const auto& t : triples_of(materials))
        points[t].push_back(dense.points[v]);
    for (auto& [triple, list] : points)
      trees_.emplace(triple, PointTree(std::move(list)));
  }

  // The point nearest to p of the curves where these three meet; null when there is none.
  [[nodiscard]] const Vec3* nearest(Triple materials, const Vec3& p) const {
    std::sort(materials.begin(), materials.end());
    const auto found = trees_.find(materials);
    if (found == trees_.end()) return nullptr;
    return &found->second.points()[found->second.nearest(p).index];
  }

 private:
  static std::vector<Triple> triples_of(const std::set<MaterialId>& materials) {
    const std::vector<MaterialId> m(materials.begin(), materials.end());
    std::vector<Triple> triples;
    for (std::size_t a = 0; a < m.size(); ++a)
      for (std::size_t b = a + 1; b < m.size(); ++b)
        for (std::size_t c = b + 1; c < m.size(); ++c)
          triples.push_back({m[a], m[b], m[c]});
    return triples;
  }

  std::map<Triple, PointTree> trees_;
};

// What one slice of the volume contributes.
struct Found {
  MedialAxis axis;
  std::vector<bool> is_certain;
  std::size_t tested = 0, dropped = 0;
};

class PairTest {
 public:
  PairTest(const GridFrame& frame, const JunctionCurves& curves, const MedialAxisOptions& options)
      : spacing_(frame.spacing_mm), voxel_(frame.voxel_mm()), curves_(curves), options_(options) {}

  // Voxels p and q of material m (p == q for a voxel between two walls) with their nearest sites.
  void operator()(MaterialId m,
                  const Vec3& p,
                  const Vec3& q,
                  const InterfaceSite& site_p,
                  const InterfaceSite& site_q,
                  Found& found) const {
    ++found.tested;
    const Vec3 fp = site_p.point(), fq = site_q.point();
    const double chord_vox = norm(divided_by(fp - fq, spacing_));
    if (chord_vox <= options_.min_opposed_chord_vox) return;
    const Vec3 np = site_p.normal_into(m), nq = site_q.normal_into(m);
    const double chord = distance(fp, fq);
    const double cosine = dot(np, nq);
    const bool is_opposed = cosine < kOpposedCosine;
    const bool is_wide = cosine < kSameWallCosine && chord_vox > options_.min_chord_vox &&
                         chord > options_.min_chord_ratio * norm((p - fp) + (q - fq));
    if (!is_opposed && !is_wide) return;
    const Vec3 bisector = bisector_point(p, q, fp, fq);
    if (spans_wedge(m, site_p, site_q, bisector, chord)) {
      ++found.dropped;
      return;
    }
    found.axis.points.push_back(ball_centre(bisector, fp, fq, np, nq));
    found.is_certain.push_back(is_opposed || chord_vox > kCertainChordVox);
    found.axis.radius_mm.push_back(distance(bisector, fp));
    found.axis.material_of.push_back(m);
  }

 private:
  // The point of segment pq that is as far from fp as from fq: |m - fp|^2 - |m - fq|^2 is linear
  // along it, not positive at p and not negative at q.
  static Vec3 bisector_point(const Vec3& p, const Vec3& q, const Vec3& fp, const Vec3& fq) {
    const double at_p = squared_norm(p - fp) - squared_norm(p - fq);
    const double at_q = squared_norm(q - fp) - squared_norm(q - fq);
    if (!(at_q > at_p)) return 0.5 * (p + q);
    return p + std::clamp(-at_p / (at_q - at_p), 0.0, 1.0) * (q - p);
  }

  // Centre of the ball that touches both walls: fp + r np = fq + r nq in the least squares sense,
  // so r = -(fp - fq).(np - nq) / |np - nq|^2. Exact for spheres, tubes and plates.
  [[nodiscard]] Vec3 ball_centre(
      const Vec3& bisector, const Vec3& fp, const Vec3& fq, const Vec3& np, const Vec3& nq) const {
    const double n2 = squared_norm(np - nq);
    if (n2 < 0.5) return bisector;
    const double r = -dot(fp - fq, np - nq) / n2;
    const Vec3 centre = 0.5 * (fp + fq + r * (np + nq));
    const bool is_near = norm(divided_by(centre - bisector, spacing_)) <= kMaxCentreShiftVox;
    return r > 0 && is_near ? centre : bisector;
  }

  // Whether the two walls meet at a junction curve close by. The test compares planes, not normals
  // alone: it holds for any opening angle, and fails for a plate whose one wall ends at a curve.
  [[nodiscard]] bool spans_wedge(MaterialId m,
                                 const InterfaceSite& site_p,
                                 const InterfaceSite& site_q,
                                 const Vec3& middle,
                                 double chord) const {
    const MaterialId a = other_side(site_p, m), b = other_side(site_q, m);
    if (a == b || a == m || b == m) return false;
    const Vec3* c = curves_.nearest({m, a, b}, middle);
    if (c == nullptr) return false;
    const double reach = kWedgeReachChords * chord;
    const double offset = kWedgeOffsetChords * chord + kWedgeOffsetVox * voxel_;
    return is_wall_of_wedge(site_p, *c, reach, offset) &&
           is_wall_of_wedge(site_q, *c, reach, offset);
  }

  static bool is_wall_of_wedge(const InterfaceSite& site,
                               const Vec3& curve,
                               double reach,
                               double offset) {
    const Vec3 d = site.point() - curve;
    return norm(d) <= reach && std::abs(dot(d, site.normal_into(site.a))) <= offset;
  }

  // m itself when the site does not bound it (next to a junction of other materials).
  static MaterialId other_side(const InterfaceSite& site, MaterialId m) {
    return site.a == m ? site.b : site.b == m ? site.a : m;
  }

  Vec3 spacing_;
  double voxel_;
  const JunctionCurves& curves_;
  const MedialAxisOptions& options_;
};

// All pairs of 6-neighbours whose first voxel lies in slice k.
void find_in_slice(const LevelSets& level_sets,
                   const InterfaceSites& sites,
                   const Grid<std::int32_t>& nearest,
                   int k,
                   const PairTest& test,
                   Found& found) {
  const auto& labels = *level_sets.labels;
  const auto& dims = labels.frame.dims;
  const std::array<std::size_t, 3> stride{1, static_cast<std::size_t>(dims[0]),
                                          static_cast<std::size_t>(dims[0]) * dims[1]};
  std::size_t n = labels.frame.linear(0, 0, k);
  for (int j = 0; j < dims[1]; ++j)
    for (int i = 0; i < dims[0]; ++i, ++n) {
      const MaterialId m = labels.values[n];
      const std::int32_t fp = nearest.values[n];
      if (fp < 0) continue;
      const std::array<bool, 3> has_next{i + 1 < dims[0], j + 1 < dims[1], k + 1 < dims[2]};
      for (int axis = 0; axis < 3; ++axis) {
        if (!has_next[axis] || labels.values[n + stride[axis]] != m) continue;
        const std::int32_t fq = nearest.values[n + stride[axis]];
        if (fq == fp) continue;
        const Vec3 p = labels.frame.index_to_mm({double(i), double(j), double(k)});
        Vec3 q = p;
        q[axis] += labels.frame.spacing_mm[axis];
        test(m, p, q, sites.sites[fp], sites.sites[fq], found);
      }
    }
}

// A sheet one voxel thick has no pair of neighbours across it: there the voxel between two
// neighbouring crossings of one grid line is tested against both. Lines along z end the list of
// their first slice only, so they are taken line by line, like the others.
void find_on_lines(const LevelSets& level_sets,
                   const InterfaceSites& sites,
                   int axis,
                   std::size_t line_begin,
                   std::size_t line_end,
                   const PairTest& test,
                   Found& found) {
  const double step = level_sets.frame().spacing_mm[axis];
  for (std::size_t line = line_begin; line < line_end; ++line)
    for (auto s = sites.first[axis][line]; s + 1 < sites.first[axis][line + 1]; ++s) {
      const InterfaceSite &lo = sites.sites[s], &hi = sites.sites[s + 1];
      const double node = std::floor(lo.position_mm[axis] / step) + 1;
      if (std::floor(hi.position_mm[axis] / step) != node) continue;
      Vec3 p = lo.point();
      p[axis] = 0.5 * (lo.position_mm[axis] + hi.position_mm[axis]);
      test(lo.b, p, p, lo, hi, found);
    }
}

// Which points to keep: the certain ones, and the others that have company of their material. Near
// is meant in voxels, as chords are: between thick slices the points of a branch are far apart.
std::vector<bool> find_supported(const MedialAxis& axis,
                                 const std::vector<bool>& is_certain,
                                 const Vec3& spacing_mm) {
  std::vector<bool> is_kept = is_certain;
  if (std::find(is_certain.begin(), is_certain.end(), false) == is_certain.end()) return is_kept;
  std::vector<Vec3> in_voxels;
  in_voxels.reserve(axis.points.size());
  for (const Vec3& p : axis.points)
    in_voxels.push_back(divided_by(p, spacing_mm));
  const PointTree tree(std::move(in_voxels));
  std::vector<std::uint8_t> has_company(axis.points.size(), 0);
  parallel_for_each_index(0, axis.points.size(), [&](std::size_t n) {
    if (is_certain[n]) return;
    const auto hit = tree.nearest_if(tree.points()[n], kCompanyReachVox, [&](std::int32_t other) {
      return static_cast<std::size_t>(other) != n && axis.material_of[other] == axis.material_of[n];
    });
    has_company[n] = hit.index >= 0;
  });
  for (std::size_t n = 0; n < is_kept.size(); ++n)
    is_kept[n] = is_kept[n] || has_company[n] != 0;
  return is_kept;
}

void keep_only(const std::vector<bool>& is_kept, MedialAxis& axis) {
  std::size_t kept = 0;
  for (std::size_t n = 0; n < is_kept.size(); ++n) {
    if (!is_kept[n]) continue;
    axis.points[kept] = axis.points[n];
    axis.radius_mm[kept] = axis.radius_mm[n];
    axis.material_of[kept++] = axis.material_of[n];
  }
  axis.points.resize(kept);
  axis.radius_mm.resize(kept);
  axis.material_of.resize(kept);
}

void append(MedialAxis& axis, MedialAxis&& part) {
  axis.points.insert(axis.points.end(), part.points.begin(), part.points.end());
  axis.radius_mm.insert(axis.radius_mm.end(), part.radius_mm.begin(), part.radius_mm.end());
  axis.material_of.insert(axis.material_of.end(), part.material_of.begin(), part.material_of.end());
}

}  // namespace

MedialAxisResult extract_medial_axis(const LevelSets& level_sets,
                                     const InterfaceMesh& dense,
                                     const Strata& strata,
                                     const MedialAxisOptions& options,
                                     const StageContext& context) {
  const auto& frame = level_sets.frame();
  const InterfaceSites sites = find_interface_sites(level_sets);
  report_progress(context, kStage, 0.2);
  const Grid<std::int32_t> nearest = nearest_sites(frame, sites);
  report_progress(context, kStage, 0.7);

  const JunctionCurves curves(dense, strata);
  const PairTest test(frame, curves, options);
  // Slices first, then blocks of lines per axis: a fixed list of parts, joined in its order.
  constexpr std::size_t kLinesPerPart = 4096;

  struct Part {
    int axis;  // -1: slice `begin`
    std::size_t begin, end;
  };

  std::vector<Part> parts;
  for (int k = 0; k < frame.dims[2]; ++k)
    parts.push_back({-1, std::size_t(k), std::size_t(k)});
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t lines = sites.first[axis].size() - 1;
    for (std::size_t begin = 0; begin < lines; begin += kLinesPerPart)
      parts.push_back({axis, begin, std::min(lines, begin + kLinesPerPart)});
  }
  std::vector<Found> found(parts.size());
  parallel_for_each_index(
      0, parts.size(),
      [&](std::size_t n) {
        const Part& part = parts[n];
        if (part.axis < 0)
          find_in_slice(level_sets, sites, nearest, static_cast<int>(part.begin), test, found[n]);
        else
          find_on_lines(level_sets, sites, part.axis, part.begin, part.end, test, found[n]);
      },
      1);

  MedialAxisResult result;
  result.stats.sites = sites.sites.size();
  std::vector<bool> is_certain;
  for (auto& part : found) {
    result.stats.pairs_tested += part.tested;
    result.stats.pairs_dropped_at_curves += part.dropped;
    append(result.medial_axis, std::move(part.axis));
    is_certain.insert(is_certain.end(), part.is_certain.begin(), part.is_certain.end());
    part = {};
  }
  keep_only(find_supported(result.medial_axis, is_certain, frame.spacing_mm), result.medial_axis);
  result.stats.pairs_kept = result.medial_axis.points.size();
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
