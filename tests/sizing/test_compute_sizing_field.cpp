// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/sizing/compute_sizing_field.h"
#include "cvmesh/sizing/limit_gradation.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "support/analytic_level_sets.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace cvmesh {
namespace {

using test_support::analytic_level_sets;
using test_support::middle_of;
using test_support::plain_frame;

SizingOptions with(double epsilon, double delta = 0.4) {
  SizingOptions options;
  options.epsilon = epsilon;
  options.delta = delta;
  return options;
}

struct Surface {
  GridFrame frame;
  std::shared_ptr<const Grid<MaterialId>> labels;
  InterfaceMesh dense;
  Strata strata;
  std::vector<double> lfs;

  explicit Surface(const LevelSets& level_sets)
      : frame(level_sets.frame()), labels(level_sets.labels) {
    const auto context = silent_context();
    dense = extract_interfaces(level_sets, context);
    strata = find_strata(dense);
    const auto axis = extract_medial_axis(level_sets, dense, strata, {}, context);
    lfs = local_feature_size(dense, strata, axis.medial_axis, frame.voxel_mm(), context);
  }

  [[nodiscard]] SizingResult size(const SizingOptions& options) const {
    return compute_sizing_field(dense, strata, lfs, *labels, options, silent_context());
  }
};

Surface ball(double radius) {
  const int n = static_cast<int>(2 * radius) + 8;
  const auto frame = plain_frame({n, n, n});
  const Vec3 centre = middle_of(frame) + Vec3{0.13, 0.27, 0.41};
  return Surface(
      analytic_level_sets(frame, [&](const Vec3& p) { return radius - distance(p, centre); }));
}

// A ball on a thin stalk: sizes from one voxel to ten, in two materials that meet.
Surface lollipop() {
  const auto frame = plain_frame({40, 40, 60});
  const Vec3 centre{19.6, 19.3, 17.8};
  return Surface(analytic_level_sets(frame, 3, [&](MaterialId m, const Vec3& p) {
    const Vec3 d = p - centre;
    const double head = 12 - norm(d);
    const double stalk = std::min(2 - std::hypot(d.x, d.y), std::min(d.z, 36 - d.z));
    return m == 1 ? head : m == 2 ? std::min(stalk, -head) : -std::max(head, stalk);
  }));
}

double steepest_edge(const Surface& surface, const std::vector<double>& h) {
  double steepest = 0;
  for (const auto& facet : surface.dense.facets)
    for (int c = 0; c < 3; ++c) {
      const auto a = facet[c], b = facet[(c + 1) % 3];
      steepest = std::max(steepest, std::abs(h[a] - h[b]) /
                                        distance(surface.dense.points[a], surface.dense.points[b]));
    }
  return steepest;
}

TEST_CASE("compute_sizing_field: vertex count on a sphere is 14.5 over epsilon squared",
          "[sizing][unit]") {
  const Surface surface = ball(40);
  for (const double epsilon : {0.25, 0.5}) {
    const double theory = 2 / std::sqrt(3.0) * 4 * M_PI / (epsilon * epsilon);
    CHECK(surface.size(with(epsilon)).stats.expected_vertices == Approx(theory).epsilon(0.05));
  }
}

TEST_CASE("compute_sizing_field: a closed boundary has room for twelve vertices at any epsilon",
          "[sizing][unit]") {
  const Surface surface = ball(10);
  SizingOptions options = with(5);
  options.min_edge_mm = 30;
  const auto result = surface.size(options);
  CHECK(result.stats.expected_vertices == Approx(12).epsilon(0.01));
  CHECK(result.stats.capped_vertices == surface.dense.points.size());
}

TEST_CASE("compute_sizing_field: h follows epsilon where the feature size is uniform",
          "[sizing][unit]") {
  const Surface surface = ball(12);
  const auto half = surface.size(with(0.25)).sizing_field.h_mm;
  const auto full = surface.size(with(0.5)).sizing_field.h_mm;
  for (std::size_t v = 0; v < half.size(); ++v)
    CHECK(full[v] / half[v] == Approx(2).epsilon(0.1));
}

TEST_CASE("compute_sizing_field: h is Lipschitz on the dense surface and on the grid",
          "[sizing][property]") {
  const Surface surface = lollipop();
  for (const double epsilon : {0.5, 3.0})
    for (const double delta : {0.1, 0.4}) {
      const auto field = surface.size(with(epsilon, delta)).sizing_field;
      CHECK(steepest_edge(surface, field.h_mm) <= delta * (1 + 1e-9));
      const auto& grid = field.volume_h_mm;
      double steepest = 0;
      for (int k = 0; k + 1 < grid.frame.dims[2]; ++k)
        for (int j = 0; j + 1 < grid.frame.dims[1]; ++j)
          for (int i = 0; i + 1 < grid.frame.dims[0]; ++i)
            for (const float next : {grid(i + 1, j, k), grid(i, j + 1, k), grid(i, j, k + 1)})
              steepest = std::max(steepest, std::abs(double{grid(i, j, k)} - next));
      CHECK(steepest <= delta * 1.001);
    }
}

TEST_CASE("compute_sizing_field: h never exceeds what the closed form allows",
          "[sizing][property]") {
  const Surface surface = lollipop();
  const double epsilon = 2, delta = 0.4, floor = 0.8;
  const auto field = surface.size(with(epsilon, delta)).sizing_field;
  for (std::size_t v = 0; v < surface.lfs.size(); v += 37)
    for (std::size_t w = 0; w < surface.lfs.size(); w += 41) {
      const double bound = epsilon * std::max(surface.lfs[w], floor) +
                           delta * distance(surface.dense.points[v], surface.dense.points[w]);
      // First-order upwind distances are too long by up to a spacing or two.
      REQUIRE(field.h_mm[v] <= bound + delta * 2);
    }
}

TEST_CASE("compute_sizing_field: the volume agrees with the surface and grows inwards",
          "[sizing][unit]") {
  const Surface surface = ball(12);
  const auto field = surface.size(with(0.25)).sizing_field;
  for (std::size_t v = 0; v < field.h_mm.size(); ++v)
    CHECK(std::abs(field.at(surface.dense.points[v]) - field.h_mm[v]) < 0.4);
  const Vec3 centre = middle_of(surface.frame) + Vec3{0.13, 0.27, 0.41};
  // At the centre, 12 mm from everything, h0 + delta R; the grid rounds the peak off by a voxel or
  // two.
  const double peak = 0.25 * 12 + 0.4 * 12;
  CHECK(field.at(centre) < 1.05 * peak);
  CHECK(field.at(centre) > peak - 2 * 0.4);
}

TEST_CASE("compute_sizing_field: materials keep their own sizes", "[sizing][unit]") {
  const Surface surface = lollipop();
  SizingOptions options = with(1);
  options.per_material[2].max_edge_mm = 1.0;
  const auto h = surface.size(options).sizing_field.h_mm;
  for (std::size_t f = 0; f < surface.dense.facets.size(); ++f) {
    const Sides& sides = surface.dense.patch_of[f].sides;
    if (sides.inside == 2 || sides.outside == 2)
      for (const auto v : surface.dense.facets[f])
        CHECK(h[v] <= 1.0);
  }
  CHECK(*std::max_element(h.begin(), h.end()) > 5);

  // A coarser epsilon for a material works where it meets the exterior, which has none of its own.
  const auto fine = surface.size(with(0.3)).sizing_field.h_mm;
  SizingOptions mixed = with(0.3);
  mixed.per_material[1].epsilon = 0.6;
  const auto coarse = surface.size(mixed).sizing_field.h_mm;
  CHECK(*std::max_element(coarse.begin(), coarse.end()) >
        1.8 * *std::max_element(fine.begin(), fine.end()));
}

// Half a ball of material 1 and half a ball of material 2, which meet in a disc.
Surface two_halves() {
  const auto frame = plain_frame({40, 40, 40});
  const Vec3 centre{19.6, 19.3, 19.8};
  return Surface(analytic_level_sets(frame, 3, [&](MaterialId m, const Vec3& p) {
    const double ball = 14 - distance(p, centre), half = p.z - centre.z;
    return m == 0 ? -ball : m == 1 ? std::min(ball, half) : std::min(ball, -half);
  }));
}

// Calls visit(v, patch) for the vertices inside patches.
template <typename Visit>
void for_each_inner_vertex(const Surface& surface, const Visit& visit) {
  for (std::size_t f = 0; f < surface.dense.facets.size(); ++f)
    for (const auto v : surface.dense.facets[f])
      if (surface.strata.dimension[v] == 2) visit(v, surface.dense.patch_of[f].sides);
}

TEST_CASE("compute_sizing_field: interfaces have their own sizes instead of their materials'",
          "[sizing][unit]") {
  const Surface surface = two_halves();
  // Steep gradation: what is wanted is what comes, but next to the curve.
  SizingOptions options = with(0.5, 100);
  options.per_material[1].epsilon = 0.25;
  options.per_material[2].max_edge_mm = 1.5;
  options.per_interface[{2, 1}] = {.epsilon = 0.125, .max_edge_mm = 9.0};
  options.per_interface[{2, 0}] = {.max_edge_mm = 3.0};
  const auto h = surface.size(options).sizing_field.h_mm;
  std::size_t seen = 0;
  for_each_inner_vertex(surface, [&](std::int32_t v, const Sides& sides) {
    const double feature = std::max(surface.lfs[v], 0.8);
    const double wanted = sides == Sides{2, 1}   ? 0.125 * feature
                          : sides == Sides{2, 0} ? std::min(0.5 * feature, 3.0)
                                                 : 0.25 * feature;
    CHECK(h[v] <= wanted * (1 + 1e-9));
    // The grid carries the sizes of vertices beside this one over about a voxel.
    seen += h[v] > 0.999 * wanted;
  });
  CHECK(seen > surface.dense.points.size());

  // On the curve the smallest of the three rules.
  for (const auto& curve : surface.strata.curves)
    for (const auto v : curve.vertices)
      CHECK(h[v] <= 0.125 * std::max(surface.lfs[v], 0.8) * (1 + 1e-9));
}

TEST_CASE("compute_sizing_field: an interface may be coarser than its materials",
          "[sizing][unit]") {
  const Surface surface = two_halves();
  SizingOptions options = with(0.1, 100);
  options.per_interface[{1, 0}].epsilon = 0.4;
  const auto h = surface.size(options).sizing_field.h_mm;
  const auto uniform = surface.size(with(0.1, 100)).sizing_field.h_mm;
  double coarsest = 0;
  for_each_inner_vertex(surface, [&](std::int32_t v, const Sides& sides) {
    if (sides != Sides{1, 0}) CHECK(h[v] == Approx(uniform[v]));
    if (sides == Sides{1, 0}) coarsest = std::max(coarsest, h[v] / uniform[v]);
  });
  CHECK(coarsest == Approx(4));
}

TEST_CASE("compute_sizing_field: inside a box its sizes rule, outside h grows from them",
          "[sizing][unit]") {
  const Surface surface = ball(15);
  const Vec3 centre = middle_of(surface.frame);
  const double delta = 0.4;
  SizingOptions options = with(0.4, delta);
  options.per_material[1].epsilon = 0.5;
  const auto around = surface.size(options).sizing_field.h_mm;
  const Box3 box{{centre.x + 8, -100, -100}, {100, 100, 100}};
  options.boxes = {{box, {.epsilon = 0.1}}};
  const auto h = surface.size(options).sizing_field.h_mm;
  std::size_t unchanged = 0;
  for (std::size_t v = 0; v < h.size(); ++v) {
    const Vec3& p = surface.dense.points[v];
    if (box.contains(p)) {
      CHECK(h[v] == Approx(0.1 * surface.lfs[v]).epsilon(0.05));
    } else {
      CHECK(h[v] >= 0.1 * 13);  // the feature size is the radius, less a voxel or two
      // First-order upwind distances are too long by up to a spacing or two.
      CHECK(h[v] <= 0.1 * 15 + delta * (std::abs(box.lo.x - p.x) + 10 + 2));
      unchanged += h[v] == around[v];
    }
  }
  CHECK(unchanged > h.size() / 4);
}

TEST_CASE("compute_sizing_field: max_edge_mm of a box bounds the volume in it", "[sizing][unit]") {
  const Surface surface = ball(20);
  const Vec3 centre = middle_of(surface.frame) + Vec3{0.3, 0.2, 0.1};
  const auto peak = [&](const Box3& box) {
    SizingOptions options = with(0.25);
    options.boxes = {{box, {.max_edge_mm = 1.5}}};
    return surface.size(options).sizing_field;
  };
  const auto around = surface.size(with(0.25)).sizing_field;
  const double half = 4;
  const Vec3 reach{half, half, half};
  const auto field = peak({centre - reach, centre + reach});
  CHECK(around.at(centre) > 10);
  CHECK(field.at(centre) == Approx(1.5));
  CHECK(field.at(centre + Vec3{half - 1, 0, 0}) == Approx(1.5));
  // No surface is near, so none feels the box.
  CHECK(field.h_mm == around.h_mm);
  // Up to a spacing of the grid, h grows by delta outside.
  for (const double away : {2.0, 4.0, 6.0})
    CHECK(field.at(centre + Vec3{0, half + away, 0}) == Approx(1.5 + 0.4 * away).margin(0.4));
  // A box between the nodes reaches those beside it.
  const Vec3 node{std::floor(centre.x), std::floor(centre.y), std::floor(centre.z)};
  const auto speck = peak({node + Vec3{0.4, 0.4, 0.4}, node + Vec3{0.6, 0.6, 0.6}});
  CHECK(speck.at(node + Vec3{0.5, 0.5, 0.5}) == Approx(1.5 + 0.4 * 0.4 * std::sqrt(3.0)));
}

TEST_CASE("compute_sizing_field: where boxes overlap the last value rules", "[sizing][unit]") {
  const Surface surface = ball(20);
  const Box3 all{{-100, -100, -100}, {100, 100, 100}};
  const Vec3 centre = middle_of(surface.frame);
  SizingOptions options = with(1);
  options.boxes = {{all, {.epsilon = 0.1, .max_edge_mm = 1.0}}, {all, {.max_edge_mm = 1.5}}};
  const auto coarser = surface.size(options).sizing_field;
  CHECK(coarser.at(centre) == Approx(1.5));
  for (const double h : coarser.h_mm)
    CHECK(h == Approx(1.5));  // a tenth of the radius is more
  std::swap(options.boxes[0], options.boxes[1]);
  CHECK(surface.size(options).sizing_field.at(centre) == Approx(1));

  // A bound of the box takes the other one from outside along.
  SizingOptions bounded = with(0.1);
  bounded.max_edge_mm = 0.5;
  bounded.boxes = {{all, {.min_edge_mm = 3.0}}};
  for (const double h : surface.size(bounded).sizing_field.h_mm)
    CHECK(h == Approx(3));
}

TEST_CASE("compute_sizing_field: max_edge_mm of a material bounds its volume, too",
          "[sizing][unit]") {
  const Surface surface = ball(20);
  const Vec3 centre = middle_of(surface.frame);
  SizingOptions options = with(0.25);
  options.per_material[1].max_edge_mm = 1.5;
  const auto field = surface.size(options).sizing_field;
  CHECK(field.at(centre) == Approx(1.5));
  CHECK(field.at(centre + Vec3{10, 0, 0}) == Approx(1.5));
  for (const double h : field.h_mm)
    CHECK(h <= 1.5);
  const auto& frame = surface.frame;
  const double corner = 0.5 * frame.dims[0] * std::sqrt(3.0) - 20;
  CHECK(field.at({0, 0, 0}) == Approx(1.5 + 0.4 * corner).margin(1));

  // The interface keeps its own size; a box may coarsen a part.
  options.per_interface[{1, 0}] = {.max_edge_mm = 4.0};
  options.boxes = {{{centre - Vec3{3, 3, 3}, centre + Vec3{3, 3, 3}}, {.max_edge_mm = 2.0}}};
  const auto mixed = surface.size(options).sizing_field;
  CHECK(*std::max_element(mixed.h_mm.begin(), mixed.h_mm.end()) > 3.9);
  CHECK(mixed.at(centre) == Approx(2));
  CHECK(mixed.at(centre + Vec3{10, 0, 0}) == Approx(1.5));
}

TEST_CASE("SizingProblem: a cap of h at vertices rules there, and h grows from it",
          "[sizing][unit]") {
  const Surface surface = ball(15);
  const SizingProblem problem(surface.dense, surface.strata, surface.lfs, *surface.labels);
  const auto context = silent_context();
  SizingOptions options = with(0.4);
  options.min_edge_mm = 1.0;  // a cap is stronger
  const auto free = problem.field(options, context).sizing_field;
  const std::vector<double> none(surface.dense.points.size(), INFINITY);
  CHECK(problem.field(options, context, none).sizing_field.h_mm == free.h_mm);

  const std::size_t one = surface.dense.points.size() / 2;
  std::vector<double> cap = none;
  cap[one] = 0.3;
  const auto field = problem.field(options, context, cap).sizing_field;
  CHECK(field.h_mm[one] == 0.3);
  CHECK(steepest_edge(surface, field.h_mm) <= 0.4 * (1 + 1e-9));
  for (std::size_t v = 0; v < none.size(); ++v) {
    const double away = distance(surface.dense.points[v], surface.dense.points[one]);
    CHECK(field.h_mm[v] <= free.h_mm[v]);
    // Ways along the edges are up to a fifth longer than straight ones, or half an edge.
    CHECK(field.h_mm[v] <= 0.3 + 0.4 * (1.2 * away + 0.5));
    if (away > 16) CHECK(field.h_mm[v] == free.h_mm[v]);
  }
  CHECK(compute_sizing_field(surface.dense, surface.strata, surface.lfs, *surface.labels, options,
                             context, cap)
            .sizing_field.h_mm == field.h_mm);
}

TEST_CASE("compute_sizing_field: refuses values out of range and says what to do",
          "[sizing][unit]") {
  const Surface surface = ball(5);
  const auto message = [&](const SizingOptions& options) -> std::string {
    try {
      static_cast<void>(surface.size(options));
    } catch (const Error& error) {
      CHECK(error.code() == ErrorCode::BadParameter);
      return error.what();
    }
    return "";
  };
  CHECK(message(with(-1)).find("epsilon (-1)") != std::string::npos);
  CHECK(message(with(std::nan(""))) != "");
  CHECK(message(with(1, -0.1)).find("delta (-0.1)") != std::string::npos);
  SizingOptions crossed;
  crossed.min_edge_mm = 2.5;
  crossed.max_edge_mm = 2;
  CHECK(message(crossed).find("min_edge_mm (2.5) exceeds max_edge_mm (2)") != std::string::npos);
  SizingOptions material;
  material.per_material[1].epsilon = 0.0;
  CHECK(message(material).find("material 1: epsilon (0)") != std::string::npos);
  SizingOptions box;
  box.boxes = {{{}, {.min_edge_mm = 2.0, .max_edge_mm = 1.0}}};
  CHECK(message(box).find("box 0: min_edge_mm (2) exceeds max_edge_mm (1)") != std::string::npos);
  SizingOptions interface;
  interface.max_edge_mm = 2.0;
  interface.per_interface[{1, 0}].min_edge_mm = 3.0;
  CHECK(message(interface).find("interface of materials 0 and 1: min_edge_mm (3) exceeds") !=
        std::string::npos);
}

TEST_CASE("compute_sizing_field: says how much of a boundary has fewer than three facets around",
          "[sizing][unit]") {
  const Surface surface = lollipop();
  const auto fine = surface.size(with(1)).stats.share_below_three_facets;
  REQUIRE(fine.size() == 3);
  CHECK(fine[1] < 0.01);
  CHECK(fine[2] < 0.01);
  // The stalk would get edges of three radii, the ball has room for twelve vertices in any case.
  const auto coarse = surface.size(with(3, 1)).stats.share_below_three_facets;
  CHECK(coarse[1] < 0.05);
  CHECK(coarse[2] > 0.8);
  CHECK(coarse[2] <= 1);
  SizingOptions options = with(3, 1);
  options.per_material[2].epsilon = 2.0;
  CHECK(surface.size(options).stats.share_below_three_facets[2] < 0.01);
}

TEST_CASE("SizingProblem: a field does not depend on those before it", "[sizing][unit]") {
  const Surface surface = lollipop();
  const SizingProblem problem(surface.dense, surface.strata, surface.lfs, *surface.labels);
  for (const double epsilon : {4.0, 0.5, 2.0}) {
    const auto one = problem.field(with(epsilon), silent_context());
    const auto other = surface.size(with(epsilon));
    CHECK(one.sizing_field.h_mm == other.sizing_field.h_mm);
    CHECK(one.sizing_field.volume_h_mm.values == other.sizing_field.volume_h_mm.values);
    CHECK(one.stats.expected_vertices == other.stats.expected_vertices);
    CHECK(one.stats.capped_vertices == other.stats.capped_vertices);
  }
}

TEST_CASE("SizingProblem: refuses sizes that ask for more vertices than can be counted",
          "[sizing][unit]") {
  const Surface surface = ball(10);
  const SizingProblem problem(surface.dense, surface.strata, surface.lfs, *surface.labels);
  SizingOptions options;
  options.max_edge_mm = 1e-3;  // metres?
  CHECK_THROWS_WITH(problem.field(options, silent_context()),
                    Catch::Contains("above the bound of 1e+08") &&
                        Catch::Contains("raise epsilon or the bounds of the edge length"));
}

TEST_CASE("SizingProblem: without room small parts have the sizes of any other part",
          "[sizing][unit]") {
  const Surface surface = ball(10);
  SizingProblem problem(surface.dense, surface.strata, surface.lfs, *surface.labels);
  problem.drop_room();
  const auto result = problem.field(with(5), silent_context());
  // 14.5 over epsilon squared, as for a large ball
  const double theory = 2 / std::sqrt(3.0) * 4 * M_PI / 25;
  CHECK(result.stats.expected_vertices == Approx(theory).epsilon(0.1));
  CHECK(result.stats.capped_vertices == 0);
  CHECK_FALSE(result.sizing_field.leaves_room);
}

TEST_CASE("SizingProblem: the estimate of the vertices is close to what the field expects",
          "[sizing][unit]") {
  for (const Surface& surface : {ball(40), lollipop()}) {
    const SizingProblem problem(surface.dense, surface.strata, surface.lfs, *surface.labels);
    for (const double epsilon : {0.5, 1.0, 4.0}) {
      const double expected =
          problem.field(with(epsilon), silent_context()).stats.expected_vertices;
      // From there the search needs one or two fields.
      CHECK(problem.estimate_vertices(with(epsilon)) == Approx(expected).epsilon(0.05));
    }
    SizingOptions boxed = with(1);
    boxed.boxes = {{{{-99, -99, -99}, middle_of(surface.frame)}, {.max_edge_mm = 0.5}}};
    const double expected = problem.field(boxed, silent_context()).stats.expected_vertices;
    CHECK(problem.estimate_vertices(boxed) == Approx(expected).epsilon(0.05));
  }
}

TEST_CASE("compute_sizing_field: same values at 1, 2 and 8 threads", "[sizing][determinism]") {
  const auto run = [&](int threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    tbb::task_arena arena(threads);
    return arena.execute([&] { return lollipop().size(with(2)); });
  };
  const auto one = run(1);
  for (const int threads : {2, 8}) {
    const auto other = run(threads);
    CHECK(other.sizing_field.lfs_mm == one.sizing_field.lfs_mm);
    CHECK(other.sizing_field.h_mm == one.sizing_field.h_mm);
    CHECK(other.sizing_field.volume_h_mm.values == one.sizing_field.volume_h_mm.values);
    CHECK(other.stats.expected_vertices == one.stats.expected_vertices);
  }
}

TEST_CASE("extend_from_points: distance to a point, on coarsened and anisotropic grids",
          "[sizing][unit]") {
  for (const Vec3& spacing : {Vec3{1, 1, 1}, Vec3{0.5, 0.4, 0.8}, Vec3{1, 1, 5}}) {
    const auto frame = plain_frame({40, 50, 30}, spacing);
    const Vec3 source = frame.index_to_mm({13, 20, 11});
    for (const std::size_t max_nodes : {std::size_t{100000}, std::size_t{10000}}) {
      const auto u = extend_from_points({source}, {3.0}, 0.5,
                                        Grid<float>(coarsened(frame, max_nodes), kUnlimited));
      REQUIRE(u.frame.size() <= max_nodes);
      const Vec3 last = u.frame.index_to_mm(
          {double(u.frame.dims[0] - 1), double(u.frame.dims[1] - 1), double(u.frame.dims[2] - 1)});
      const Vec3 wanted = frame.index_to_mm({39, 49, 29});
      for (int axis = 0; axis < 3; ++axis)
        CHECK(last[axis] >= wanted[axis] - 1e-9);
      const double widest =
          std::max(u.frame.spacing_mm.x, std::max(u.frame.spacing_mm.y, u.frame.spacing_mm.z));
      for (int k = 0; k < u.frame.dims[2]; ++k)
        for (int j = 0; j < u.frame.dims[1]; ++j)
          for (int i = 0; i < u.frame.dims[0]; ++i) {
            const double truth =
                3 + 0.5 * distance(u.frame.index_to_mm({double(i), double(j), double(k)}), source);
            REQUIRE(u(i, j, k) > truth - 1e-3);
            REQUIRE(u(i, j, k) < truth + 0.5 * 2 * widest);
          }
    }
  }
}

TEST_CASE("limit_along_edges: a path falls off with slope delta from its lowest vertex",
          "[sizing][unit]") {
  // A strip of triangles along x.
  InterfaceMesh mesh;
  for (int n = 0; n < 20; ++n)
    mesh.points.push_back({0.5 * n, double(n % 2), 0});
  for (int n = 0; n + 2 < 20; ++n) {
    mesh.facets.push_back({n, n + 1, n + 2});
    mesh.patch_of.push_back({{1, 0}, 0});
  }
  std::vector<double> values(20, 100);
  values[0] = 1;
  limit_along_edges(mesh.points, find_vertex_neighbours(mesh, find_vertex_stars(mesh)), 0.25,
                    values);
  // Even vertices lie one apart on a straight edge path.
  for (int n = 0; n < 20; n += 2)
    CHECK(values[n] == Approx(1 + 0.25 * 0.5 * n));
}

TEST_CASE("limit_along_edges: the values that relaxing all edges to the end gives, bit for bit",
          "[sizing][unit]") {
  const Surface surface = lollipop();
  const auto neighbours = find_vertex_neighbours(surface.dense, find_vertex_stars(surface.dense));
  for (const double delta : {0.05, 0.4}) {
    std::vector<double> plain = surface.lfs, fast = surface.lfs;
    for (bool is_settled = false; !is_settled;) {
      is_settled = true;
      for (const auto& facet : surface.dense.facets)
        for (const auto v : facet)
          for (const auto w : facet) {
            const double bound =
                plain[v] + delta * distance(surface.dense.points[v], surface.dense.points[w]);
            is_settled = is_settled && plain[w] <= bound;
            plain[w] = std::min(plain[w], bound);
          }
    }
    CHECK(plain != surface.lfs);
    limit_along_edges(surface.dense.points, neighbours, delta, fast);
    CHECK(fast == plain);
  }
}

TEST_CASE("find_vertex_neighbours: each vertex across an edge, once", "[sizing][unit]") {
  InterfaceMesh tet;
  tet.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {5, 5, 5}};
  tet.facets = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  tet.patch_of.assign(4, {{1, 0}, 0});
  const auto neighbours = find_vertex_neighbours(tet, find_vertex_stars(tet));
  CHECK(neighbours.first == std::vector<std::int32_t>{0, 3, 6, 9, 12, 12});
  for (std::int32_t v = 0; v < 4; ++v) {
    std::vector<std::int32_t> around(neighbours.vertex.begin() + neighbours.first[v],
                                     neighbours.vertex.begin() + neighbours.first[v + 1]);
    around.push_back(v);
    std::sort(around.begin(), around.end());
    CHECK(around == std::vector<std::int32_t>{0, 1, 2, 3});
  }
}

TEST_CASE("SizingField: trilinear inside, clamped outside", "[sizing][unit]") {
  SizingField field;
  field.volume_h_mm = Grid<float>(plain_frame({3, 4, 5}, {2, 1, 1}));
  for (int k = 0; k < 5; ++k)
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 3; ++i)
        field.volume_h_mm(i, j, k) = static_cast<float>(1 + 2 * i + 10 * j + 100 * k);
  CHECK(field.at({2, 1, 1}) == Approx(1 + 2 + 10 + 100));
  CHECK(field.at({1, 0.5, 2.25}) == Approx(1 + 1 + 5 + 225));
  CHECK(field.at({-9, -9, -9}) == Approx(1));
  CHECK(field.at({99, 99, 99}) == Approx(1 + 4 + 30 + 400));
}

}  // namespace
}  // namespace cvmesh
