// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/sheets.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/particles/short_loops.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

namespace cvmesh {
namespace {

constexpr char kStage[] = "seed particles";
constexpr double kFarFromCurves = std::numeric_limits<double>::infinity();
constexpr int kNewtonSteps = 8;  // converges in 2 to 4 from half a voxel
constexpr double kConvergedVox = 1e-4;
constexpr double kMaxProjectionVox = 0.5;  // farther away may be another interface

Vec3 barycentric(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 n = cross(b - a, c - a);
  const double n2 = squared_norm(n);
  if (!(n2 > 0)) return {1.0 / 3, 1.0 / 3, 1.0 / 3};
  const double wb = dot(cross(p - a, c - a), n) / n2;
  const double wc = dot(cross(b - a, p - a), n) / n2;
  return {1 - wb - wc, wb, wc};
}

}  // namespace

bool project_onto_zero(const LevelSets& level_sets,
                       const std::vector<Sides>& differences,
                       const std::array<bool, 3>& is_fixed,
                       double max_move_mm,
                       Vec3& p) {
  const int rows = static_cast<int>(differences.size());
  if (rows < 1 || rows > 3) return false;
  const double tolerance = kConvergedVox * level_sets.frame().voxel_mm();
  Vec3 x = p;
  for (int iteration = 0; iteration < kNewtonSteps; ++iteration) {
    Vec3 gradient[3];
    double value[3];
    for (int r = 0; r < rows; ++r) {
      const auto sample =
          level_sets.sample_difference(differences[r].inside, differences[r].outside, x);
      value[r] = sample.value;
      gradient[r] = sample.gradient;
      for (int axis = 0; axis < 3; ++axis)
        if (is_fixed[axis]) gradient[r][axis] = 0;
    }
    // The least step that solves all rows: orthogonalise the gradients one after the other.
    Vec3 step{}, direction[3];
    for (int r = 0; r < rows; ++r) {
      Vec3 d = gradient[r];
      for (int q = 0; q < r; ++q)
        d -= dot(d, direction[q]) * direction[q];
      const double length = norm(d);
      if (!(length > 0.05 * norm(gradient[r]))) return false;  // parallel, or a flat field
      direction[r] = d / length;
      step += ((-value[r] - dot(gradient[r], step)) / length) * direction[r];
    }
    x += step;
    if (!(distance(x, p) <= max_move_mm)) return false;
    if (norm(step) <= tolerance) {
      p = x;
      return true;
    }
  }
  return false;
}

Sheets::Sheets(const ParticleDomain& domain)
    : h_mm(domain.sizing_field.h_mm),
      domain_(domain),
      voxel_mm_(domain.level_sets.frame().voxel_mm()) {
  require(h_mm.size() == domain.dense.points.size(), ErrorCode::Internal, kStage,
          "the sizing field has " + std::to_string(h_mm.size()) + " values for " +
              std::to_string(domain.dense.points.size()) + " dense vertices");
  stars_ = find_vertex_stars(domain_.dense);
  link_facets();
  find_sheets();
  measure_sheets();
  lower_h();
}

void Sheets::link_facets() {
  const auto& facets = domain_.dense.facets;
  across_.assign(facets.size(), {-1, -1, -1});
  facet_normal_.resize(facets.size());
  parallel_for_each_index(0, facets.size(), [&](std::size_t f) {
    const auto& points = domain_.dense.points;
    const auto& v = facets[f];
    facet_normal_[f] = normalized(area_vector2(points[v[0]], points[v[1]], points[v[2]]));
    for (int k = 0; k < 3; ++k) {
      // The other facet of the edge, if there is exactly one and it is of the same patch.
      const auto a = v[k], b = v[(k + 1) % 3];
      std::int32_t other = -1;
      int count = 0;
      for (auto s = stars_.first[a]; s < stars_.first[a + 1]; ++s) {
        const auto g = stars_.facet[s];
        if (g == static_cast<std::int32_t>(f)) continue;
        const auto& w = facets[g];
        if (w[0] != b && w[1] != b && w[2] != b) continue;
        ++count;
        if (domain_.strata.patch_of[g] == domain_.strata.patch_of[f]) other = g;
      }
      if (count == 1) across_[f][k] = other;
    }
  });
}

void Sheets::find_sheets() {
  const auto& facets = domain_.dense.facets;
  sheet_of.assign(facets.size(), -1);
  std::vector<std::int32_t> stack;
  for (std::size_t seed = 0; seed < facets.size(); ++seed) {
    if (sheet_of[seed] >= 0) continue;
    const auto id = static_cast<std::int32_t>(sheets.size());
    Sheet sheet;
    sheet.patch = domain_.strata.patch_of[seed];
    stack.assign(1, static_cast<std::int32_t>(seed));
    sheet_of[seed] = id;
    while (!stack.empty()) {
      const auto f = stack.back();
      stack.pop_back();
      sheet.facets.push_back(f);
      for (const auto g : across_[f]) {
        if (g < 0) sheet.is_closed = false;
        if (g < 0 || sheet_of[g] >= 0) continue;
        sheet_of[g] = id;
        stack.push_back(g);
      }
    }
    std::sort(sheet.facets.begin(), sheet.facets.end());
    sheets.push_back(std::move(sheet));
  }
}

void Sheets::measure_sheets() {
  const auto& dense = domain_.dense;
  const auto& dimension = domain_.strata.dimension;
  vertex_normal_.assign(dense.points.size(), {});
  parallel_for_each_index(0, dense.points.size(), [&](std::size_t v) {
    Vec3 sum{};
    for (auto s = stars_.first[v]; s < stars_.first[v + 1]; ++s) {
      const auto f = stars_.facet[s];
      sum += facet_area(f) * facet_normal_[f];
    }
    vertex_normal_[v] = normalized(sum);
  });
  std::vector<std::int32_t> last_sheet(dense.points.size(), -1);
  for (std::size_t s = 0; s < sheets.size(); ++s) {
    Sheet& sheet = sheets[s];
    double angles = 0;
    std::size_t boundary_edges = 0;
    for (const auto f : sheet.facets) {
      const auto& v = dense.facets[f];
      for (int k = 0; k < 3; ++k) {
        if (last_sheet[v[k]] != static_cast<std::int32_t>(s)) {
          last_sheet[v[k]] = static_cast<std::int32_t>(s);
          ++sheet.vertex_count;
        }
        if (across_[f][k] < 0) ++boundary_edges;
        if (dimension[v[k]] == 2) continue;
        const Vec3 a = dense.points[v[(k + 1) % 3]] - dense.points[v[k]];
        const Vec3 b = dense.points[v[(k + 2) % 3]] - dense.points[v[k]];
        angles += std::atan2(norm(cross(a, b)), dot(a, b));
      }
    }
    // A boundary loop passes as many vertices as edges and turns by pi - angle at each.
    sheet.boundary_turns =
        (std::numbers::pi * static_cast<double>(boundary_edges) - angles) / (2 * std::numbers::pi);
    if (sheet.is_closed) sheet.boundary_turns = 0;
    const std::size_t edges = (3 * sheet.facets.size() + boundary_edges) / 2;
    const auto euler = static_cast<long long>(sheet.vertex_count + sheet.facets.size()) -
                       static_cast<long long>(edges);
    sheet.has_loops = euler < (sheet.is_closed ? 2 : 1);
  }
}

void Sheets::lower_h() {
  std::vector<std::size_t> order(sheets.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  // The largest first: it may take as long as all others.
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return sheets[a].facets.size() > sheets[b].facets.size();
  });
  std::vector<std::vector<LoweredSize>> lowered(sheets.size());
  parallel_for_each_index(
      0, order.size(),
      [&](std::size_t n) {
        Sheet& sheet = sheets[order[n]];
        sheet.field_count = count_at_h(sheet);
        if (sheet.has_loops && domain_.sizing_field.leaves_room)
          lowered[order[n]] =
              sizes_at_short_loops(domain_.dense, sheet.facets, domain_.sizing_field.delta, h_mm);
      },
      1);
  // A lowered h on a curve counts for all sheets around it.
  for (const auto& of_sheet : lowered)
    for (const LoweredSize& size : of_sheet)
      h_mm[size.vertex] = std::min(h_mm[size.vertex], size.h_mm);
  parallel_for_each_index(
      0, sheets.size(), [&](std::size_t s) { sheets[s].lattice_count = count_at_h(sheets[s]); }, 1);
}

double Sheets::count_at_h(const Sheet& sheet) const {
  double sum = 0;
  for (const auto f : sheet.facets) {
    const double h = facet_h(f);
    sum += 2 / std::sqrt(3.0) * facet_area(f) / (h * h);
  }
  return sum;
}

double Sheets::facet_area(std::int32_t f) const {
  const auto& v = domain_.dense.facets[f];
  const auto& p = domain_.dense.points;
  return 0.5 * norm(area_vector2(p[v[0]], p[v[1]], p[v[2]]));
}

double Sheets::facet_h(std::int32_t f) const {
  const auto& v = domain_.dense.facets[f];
  const auto& h = h_mm;
  return (h[v[0]] + h[v[1]] + h[v[2]]) / 3;
}

Sheets::OnFacet Sheets::nearest_in(std::int32_t facet, const Vec3& p) const {
  const auto& v = domain_.dense.facets[facet];
  const auto& points = domain_.dense.points;
  const Vec3 q = nearest_on_triangle(p, points[v[0]], points[v[1]], points[v[2]]);
  return {facet, q, squared_norm(p - q)};
}

// Downhill over edge neighbours; where these are no better and the way is not `is_short`, over all
// facets around the three vertices, which passes the small folds of a lattice surface.
Sheets::OnFacet Sheets::walk(std::int32_t facet, const Vec3& p, bool is_short) const {
  OnFacet best = nearest_in(facet, p);
  for (;;) {
    OnFacet next = best;
    for (const auto g : across_[best.facet]) {
      if (g < 0) continue;
      const OnFacet candidate = nearest_in(g, p);
      if (candidate.squared_distance < next.squared_distance) next = candidate;
    }
    if (next.facet == best.facet && !is_short)
      for (const auto v : domain_.dense.facets[best.facet])
        for (auto s = stars_.first[v]; s < stars_.first[v + 1]; ++s) {
          const auto g = stars_.facet[s];
          if (sheet_of[g] != sheet_of[facet]) continue;
          const OnFacet candidate = nearest_in(g, p);
          if (candidate.squared_distance < next.squared_distance) next = candidate;
        }
    if (next.facet == best.facet) return best;
    best = next;
  }
}

bool Sheets::project(const PatchKey& patch, Vec3& p) const {
  if (patch.wall != 0) return true;
  const auto& frame = domain_.level_sets.frame();
  Vec3 q = p;
  if (!project_onto_zero(domain_.level_sets, {patch.sides}, {false, false, false},
                         kMaxProjectionVox * voxel_mm_, q))
    return false;
  // The border of the image is a wall of its own; the inside of an interface stays off it.
  const Vec3 index = frame.mm_to_index(q);
  for (int axis = 0; axis < 3; ++axis)
    if (!(index[axis] > -0.5 && index[axis] < frame.dims[axis] - 0.5)) return false;
  p = q;
  return true;
}

void Sheets::describe_at(const OnFacet& at, SurfacePoint& point) const {
  const auto& v = domain_.dense.facets[at.facet];
  const auto& points = domain_.dense.points;
  const Vec3 w = barycentric(at.point, points[v[0]], points[v[1]], points[v[2]]);
  const auto& h = h_mm;
  point.facet = at.facet;
  point.h_mm = std::max(std::min({h[v[0]], h[v[1]], h[v[2]]}),
                        w.x * h[v[0]] + w.y * h[v[1]] + w.z * h[v[2]]);
  Vec3 normal{};
  point.curve_distance = kFarFromCurves;
  for (int k = 0; k < 3; ++k) {
    const bool is_inner = domain_.strata.dimension[v[k]] == 2;
    normal += w[k] * (is_inner ? vertex_normal_[v[k]] : facet_normal_[at.facet]);
    if (!is_inner)
      point.curve_distance = std::min(point.curve_distance, distance(at.point, points[v[k]]));
    if (across_[at.facet][k] < 0)
      point.curve_distance = std::min(
          point.curve_distance,
          distance(at.point, nearest_on_segment(at.point, points[v[k]], points[v[(k + 1) % 3]])));
  }
  point.normal = normalized(normal);
}

SurfacePoint Sheets::settle(const OnFacet& start) const {
  const PatchKey& patch = domain_.dense.patch_of[start.facet];
  SurfacePoint result;
  OnFacet at = start;
  result.position = start.point;
  Vec3 projected = start.point;
  if (project(patch, projected)) {
    const OnFacet carrier = patch.wall != 0 ? start : walk(start.facet, projected, true);
    if (carrier.squared_distance <= kMaxProjectionVox * kMaxProjectionVox * voxel_mm_ * voxel_mm_) {
      at = carrier;
      result.position = projected;
      result.is_projected = true;
    }
  }
  if (patch.wall != 0) {
    const int axis = (patch.wall - 1) / 2;
    result.position[axis] = domain_.dense.points[domain_.dense.facets[at.facet][0]][axis];
  }
  describe_at(at, result);
  return result;
}

SurfacePoint Sheets::move(std::int32_t facet, const Vec3& p) const {
  return settle(walk(facet, p, false));
}

SurfacePoint Sheets::place(std::int32_t facet, const Vec3& weights) const {
  const auto& v = domain_.dense.facets[facet];
  const auto& points = domain_.dense.points;
  const Vec3 p = weights.x * points[v[0]] + weights.y * points[v[1]] + weights.z * points[v[2]];
  return settle({facet, p, 0});
}

SurfacePoint Sheets::describe(std::int32_t facet, const Vec3& p) const {
  SurfacePoint point;
  point.position = p;
  describe_at(nearest_in(facet, p), point);
  return point;
}

std::int32_t Sheets::nearest_vertex(std::int32_t facet, const Vec3& p) const {
  const auto& points = domain_.dense.points;
  const auto& v = domain_.dense.facets[facet];
  return *std::min_element(v.begin(), v.end(), [&](std::int32_t a, std::int32_t b) {
    return squared_norm(points[a] - p) < squared_norm(points[b] - p);
  });
}

SurfacePoint Sheets::at_vertex(std::int32_t v, std::int32_t sheet) const {
  auto s = stars_.first[v];
  while (sheet_of[stars_.facet[s]] != sheet)
    ++s;
  const auto f = stars_.facet[s];
  return move(f, domain_.dense.points[v]);
}

std::vector<Sheets::Touch> Sheets::touching(std::int32_t v, std::int32_t w) const {
  std::vector<Touch> touches;
  for (auto s = stars_.first[v]; s < stars_.first[v + 1]; ++s) {
    const auto f = stars_.facet[s];
    const auto& corners = domain_.dense.facets[f];
    if (w >= 0 && corners[0] != w && corners[1] != w && corners[2] != w) continue;
    auto touch = std::find_if(touches.begin(), touches.end(),
                              [&](const Touch& t) { return t.sheet == sheet_of[f]; });
    if (touch == touches.end()) touch = touches.insert(touch, Touch{sheet_of[f], f, {}});
    touch->normal += facet_area(f) * facet_normal_[f];
  }
  for (Touch& t : touches)
    t.normal = normalized(t.normal);
  std::sort(touches.begin(), touches.end(),
            [](const Touch& a, const Touch& b) { return a.sheet < b.sheet; });
  return touches;
}

std::vector<std::vector<RimParticle>> find_rims(const Sheets& sheets,
                                                const std::vector<Particle>& corners_and_curves) {
  std::vector<std::vector<RimParticle>> rims(sheets.sheets.size());
  for (std::size_t i = 0; i < corners_and_curves.size(); ++i) {
    const Particle& p = corners_and_curves[i];
    for (const auto& touch : sheets.touching(p.carrier[0], p.carrier[1])) {
      SurfacePoint place;
      place.position = p.position;
      place.normal = touch.normal;
      place.h_mm = p.h_mm;
      place.facet = touch.facet;
      rims[touch.sheet].push_back(
          {static_cast<std::int32_t>(i), place, p.origin != ParticleOrigin::Bend});
    }
  }
  return rims;
}

double natural_count(const Sheet& sheet,
                     double lattice_count,
                     const std::vector<RimParticle>& rim) {
  const auto by_size =
      std::count_if(rim.begin(), rim.end(), [](const RimParticle& r) { return r.is_by_size; });
  return std::max(0.0, lattice_count - 0.5 * static_cast<double>(by_size) + sheet.boundary_turns);
}

}  // namespace cvmesh
