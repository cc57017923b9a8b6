// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/random.h"
#include "cvmesh/labels/simple_change.h"
#include "cvmesh/levelset/distance_transform.h"
#include "cvmesh/levelset/guarded_flow.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "levelset/label_grids.h"
#include "support/catch.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <set>
#include <utility>

using namespace cvmesh;
using label_grids::Labels;

namespace {

GuardedFlowResult flow(const Labels& labels, double r_vox, int max_iterations = 200) {
  return guarded_flow(labels, std::vector<double>(label_grids::material_count(labels), r_vox),
                      max_iterations, silent_context());
}

bool is_equal(const std::vector<LatticeTopology>& a, const std::vector<LatticeTopology>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const LatticeTopology& s, const LatticeTopology& t) {
                      return s.components == t.components && s.euler == t.euler;
                    });
}

// Pairs of materials on lattice edges.
std::set<std::pair<MaterialId, MaterialId>> touching_pairs(const Labels& labels) {
  std::set<std::pair<MaterialId, MaterialId>> pairs;
  const auto [nx, ny, nz] = labels.frame.dims;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        for (int m = 1; m < 8; ++m) {
          const int x = i + (m & 1), y = j + (m >> 1 & 1), z = k + (m >> 2);
          if (!labels.frame.contains(x, y, z) || labels(x, y, z) == labels(i, j, k)) continue;
          pairs.insert(std::minmax(labels(x, y, z), labels(i, j, k)));
        }
  return pairs;
}

// Lattice edges between materials: the area of the boundary, in lattice edges.
std::size_t cut_edges(const Labels& labels) {
  std::size_t cut = 0;
  const auto [nx, ny, nz] = labels.frame.dims;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        for (int m = 1; m < 8; ++m) {
          const int x = i + (m & 1), y = j + (m >> 1 & 1), z = k + (m >> 2);
          if (labels.frame.contains(x, y, z) && labels(x, y, z) != labels(i, j, k)) ++cut;
        }
  return cut;
}

}  // namespace

TEST_CASE("squared_distances: equal to brute force, also on anisotropic grids",
          "[levelset][unit]") {
  const std::array<int, 3> dims{13, 19, 11};
  const CounterRandom random(1, "sites");
  for (const Vec3 step : {Vec3{1, 1, 1}, Vec3{1.25, 1, 2.5}}) {
    for (const double density : {0.2, 0.01, 0.0006}) {
      std::vector<std::uint8_t> sites(13 * 19 * 11);
      std::vector<Vec3> places;
      for (std::size_t n = 0; n < sites.size(); ++n) {
        sites[n] = random.uniform(n) < density ? 1 : 0;
        if (sites[n] != 0)
          places.push_back({double(n % 13), double(n / 13 % 19), double(n / 13 / 19)});
      }
      REQUIRE(!places.empty());
      const auto d2 = squared_distances(dims, step, sites);
      const auto within = squared_distances(dims, step, sites, 4);
      for (std::size_t n = 0; n < sites.size(); ++n) {
        const Vec3 p{double(n % 13), double(n / 13 % 19), double(n / 13 / 19)};
        double nearest = 1e30;
        for (const Vec3& q : places)
          nearest = std::min(nearest, squared_norm(scaled_by(p - q, step)));
        // Squares and sums of the steps are exact in float here.
        REQUIRE(d2[n] == static_cast<float>(nearest));
        REQUIRE(within[n] == (nearest <= 16 ? static_cast<float>(nearest) : kNoSite));
      }
    }
  }
}

TEST_CASE("squared_distances: no site gives no distance", "[levelset][unit]") {
  const auto d2 = squared_distances({3, 4, 5}, {1, 1, 1}, std::vector<std::uint8_t>(60));
  CHECK(std::all_of(d2.begin(), d2.end(), [](float v) { return v == kNoSite; }));
}

TEST_CASE("is_simple_change: equal to a count of components and Euler numbers on all 2^14 links",
          "[levelset][labels][unit]") {
  // The middle node of 3^3 is 1; its link takes 1 or 2 in all ways; the twelve nodes that are no
  // neighbours are 3 and touch neither side's part of the link through the middle node. A part P of
  // the link is contractible when its complex has one component and Euler number 1.
  GridFrame frame;
  frame.dims = {3, 3, 3};
  int simple = 0, different = 0;
  for (unsigned link = 0; link < 1U << 14; ++link) {
    Labels labels(frame, 3);
    for (unsigned n = 0; n < 14; ++n)
      labels(1 + kLinkSteps[n][0], 1 + kLinkSteps[n][1], 1 + kLinkSteps[n][2]) =
          (link >> n & 1U) != 0 ? 2 : 1;
    labels(1, 1, 1) = 3;  // out of the way of the count
    const auto parts = lattice_topology(labels, 4);
    const bool expected = parts[1].components == 1 && parts[1].euler == 1 &&
                          parts[2].components == 1 && parts[2].euler == 1;
    labels(1, 1, 1) = 1;
    if (is_simple_change(labels, 1, 1, 1, 2) != expected) ++different;
    simple += expected ? 1 : 0;
  }
  CHECK(different == 0);
  CHECK(simple > 1000);
  CHECK(simple < 1 << 13);
}

TEST_CASE(
    "is_simple_change: no simple change alters the topology or adds a contact, at the border "
    "as inside",
    "[levelset][labels][property]") {
  int simple = 0, refused = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    const int side = 3 + static_cast<int>(seed % 3);
    const int materials = 2 + static_cast<int>(seed / 3 % 3);
    // Half of the volumes are blocks of 2^3 nodes: noise alone has few simple nodes.
    Labels labels = label_grids::noise({side, side, side}, materials, seed);
    if (seed % 2 == 0) {
      const Labels coarse = labels;
      for (int k = 0; k < side; ++k)
        for (int j = 0; j < side; ++j)
          for (int i = 0; i < side; ++i)
            labels(i, j, k) = coarse(i / 2, j / 2, k / 2);
    }
    // The materials must be the same ones in each count.
    labels(0, 0, 0) = static_cast<MaterialId>(materials - 1);
    const auto before = label_grids::topology(labels);
    const auto pairs_before = touching_pairs(labels);
    for (int k = 0; k < side; ++k)
      for (int j = 0; j < side; ++j)
        for (int i = 0; i < side; ++i)
          for (MaterialId to = 0; to < materials; ++to) {
            if (to == labels(i, j, k)) continue;
            if (!is_simple_change(labels, i, j, k, to)) {
              ++refused;
              continue;
            }
            ++simple;
            Labels changed = labels;
            changed(i, j, k) = to;
            REQUIRE(is_equal(before, label_grids::topology(changed)));
            const auto pairs_after = touching_pairs(changed);
            REQUIRE(std::includes(pairs_before.begin(), pairs_before.end(), pairs_after.begin(),
                                  pairs_after.end()));
          }
  }
  CHECK(simple > 500);
  CHECK(refused > 500);
}

TEST_CASE("is_simple_change: the last node of a material on a box face stays, corners stay",
          "[levelset][labels][unit]") {
  // A column of 1 that ends on the low z face: its foot may not go, its other end may.
  Labels column = label_grids::sample({7, 7, 7}, [](const Vec3& p) -> MaterialId {
    return p.x == 3 && p.y == 3 && p.z < 4 ? 1 : 0;
  });
  CHECK_FALSE(is_simple_change(column, 3, 3, 0, 0));
  CHECK(is_simple_change(column, 3, 3, 3, 0));
  CHECK_FALSE(is_simple_change(column, 3, 3, 1, 0));

  // A flat boundary across a box edge moves along it, but not into or out of a corner.
  Labels half =
      label_grids::sample({7, 7, 7}, [](const Vec3& p) -> MaterialId { return p.x < 3 ? 1 : 0; });
  CHECK(is_simple_change(half, 2, 0, 0, 0));
  CHECK(is_simple_change(half, 3, 0, 0, 1));
  Labels corner = label_grids::sample(
      {7, 7, 7}, [](const Vec3& p) -> MaterialId { return p.x < 1 && p.y < 1 && p.z < 2 ? 1 : 0; });
  CHECK_FALSE(is_simple_change(corner, 0, 0, 0, 0));
}

TEST_CASE("guarded_flow: every material keeps its topology on every phantom and radius",
          "[levelset][property]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    const auto before = label_grids::topology(labels);
    const auto pairs = touching_pairs(labels);
    for (const double r : {1.0, 2.0, 4.0}) {
      INFO(name << ", r = " << r);
      const auto result = flow(labels, r);
      CHECK(is_equal(before, label_grids::topology(result.labels)));
      const auto pairs_after = touching_pairs(result.labels);
      CHECK(std::includes(pairs.begin(), pairs.end(), pairs_after.begin(), pairs_after.end()));
      // The flow shortens boundaries, and comes to rest. Cut edges weigh the area of a boundary by
      // its direction, by up to a fifth either way; a few hundredths are not a longer boundary.
      CHECK(static_cast<double>(cut_edges(result.labels)) <=
            1.05 * static_cast<double>(cut_edges(labels)));
      CHECK(result.iterations < 200);
      std::size_t changed = 0;
      for (std::size_t n = 0; n < labels.values.size(); ++n)
        changed += labels.values[n] != result.labels.values[n] ? 1 : 0;
      CHECK(result.nodes_changed == changed);
    }
  }
}

TEST_CASE("guarded_flow: parts thinner than the radius survive", "[levelset][unit]") {
  // Plain tightening with r = 3 removes every one of these; 85 % of their voxels leaves room for
  // rounded ends and rims.
  const auto kept = [](const Labels& labels) {
    return static_cast<double>(label_grids::count(flow(labels, 3).labels, 1)) /
           static_cast<double>(label_grids::count(labels, 1));
  };
  CHECK(kept(label_grids::rod(1, 12, {0, 0, 1})) >= 0.85);
  CHECK(kept(label_grids::rod(1, 12, {1, 2, 5})) >= 0.85);
  CHECK(kept(label_grids::rod(1.5, 12, {1, 2, 5})) >= 0.85);
  CHECK(kept(label_grids::rod(2, 12, {3, 1, 4})) >= 0.85);
  CHECK(kept(label_grids::disc(10, 0.5, {0, 0, 1})) >= 0.85);
  CHECK(kept(label_grids::disc(10, 0.9, {1, 2, 5})) >= 0.85);
  CHECK(kept(label_grids::disc(10, 1.5, {2, 1, 4})) >= 0.85);
}

TEST_CASE("guarded_flow: a spike on a ball keeps its root", "[levelset][unit]") {
  // A rod of radius 2 on a ball of radius 9: the flow may round where they meet but not thin it.
  const Labels labels = label_grids::sample({34, 34, 50}, [](const Vec3& p) -> MaterialId {
    const Vec3 q = p - Vec3{16.5, 16.5, 16};
    return norm(q) < 9 || (std::hypot(q.x, q.y) < 2 && q.z > 0 && q.z < 26) ? 1 : 0;
  });
  const Labels tightened = flow(labels, 4).labels;
  for (int k = 22; k < 40; ++k) {
    const auto slice_count = [&](const Labels& l) {
      std::size_t n = 0;
      for (int j = 0; j < 34; ++j)
        for (int i = 0; i < 34; ++i)
          n += l(i, j, k) == 1 ? 1 : 0;
      return n;
    };
    INFO("slice " << k);
    CHECK(static_cast<double>(slice_count(tightened)) >=
          0.6 * static_cast<double>(slice_count(labels)));
  }
}

TEST_CASE("guarded_flow: a narrow cleft stays open", "[levelset][unit]") {
  // Two slabs of one material two nodes apart, joined at one end: their gap is part of the shape.
  const Labels labels = label_grids::sample({40, 24, 24}, [](const Vec3& p) -> MaterialId {
    const bool is_in_box = p.x >= 6 && p.x < 34 && p.y >= 6 && p.y < 18 && p.z >= 4 && p.z < 20;
    const bool is_in_cleft = p.x >= 14 && (p.z == 11 || p.z == 12);
    return is_in_box && !is_in_cleft ? 1 : 0;
  });
  const Labels tightened = flow(labels, 4).labels;
  std::size_t filled = 0, cleft = 0;
  for (int k = 11; k <= 12; ++k)
    for (int j = 6; j < 18; ++j)
      for (int i = 16; i < 32; ++i) {
        ++cleft;
        filled += tightened(i, j, k) == 1 ? 1 : 0;
      }
  CHECK(static_cast<double>(filled) < 0.1 * static_cast<double>(cleft));
}

TEST_CASE("guarded_flow: a noisy ball gets smoother, a ball stays as it is", "[levelset][unit]") {
  const Labels noisy = label_grids::noisy_ball(12, 0.25, 5);
  const Labels ball = label_grids::ball(12);
  const auto wrong = [&](const Labels& l) {
    std::size_t n = 0;
    for (std::size_t v = 0; v < l.values.size(); ++v)
      n += l.values[v] != ball.values[v] ? 1 : 0;
    return n;
  };
  const Labels tightened = flow(noisy, 2).labels;
  // A ball of radius 12 itself has the least boundary its volume can have.
  const double excess_before =
      static_cast<double>(cut_edges(noisy)) / static_cast<double>(cut_edges(ball)) - 1;
  const double excess_after =
      static_cast<double>(cut_edges(tightened)) / static_cast<double>(cut_edges(ball)) - 1;
  CHECK(excess_after < 0.4 * excess_before);
  CHECK(wrong(tightened) < wrong(noisy));
  CHECK(static_cast<double>(wrong(flow(ball, 2).labels)) <
        0.01 * static_cast<double>(label_grids::count(ball, 1)));
}

TEST_CASE("guarded_flow: a step in a wall is rounded to the radius", "[levelset][unit]") {
  // A cube loses its edges: of a square edge, tightening by r takes (1 - pi/4) r^2 of the section.
  const Labels cube = label_grids::sample({40, 40, 40}, [](const Vec3& p) -> MaterialId {
    return std::min({p.x, p.y, p.z}) >= 8 && std::max({p.x, p.y, p.z}) < 32 ? 1 : 0;
  });
  const auto section = [](const Labels& l) {
    std::size_t n = 0;
    for (int j = 0; j < 40; ++j)
      for (int i = 0; i < 40; ++i)
        n += l(i, j, 20) == 1 ? 1 : 0;
    return static_cast<double>(n);
  };
  const double lost = section(cube) - section(flow(cube, 4).labels);
  const double expected = 4 * (1 - 0.785398) * 16;  // 13.7 nodes
  CHECK(lost > 0.3 * expected);
  CHECK(lost < 1.8 * expected);
}

TEST_CASE("guarded_flow: a grid of one label, or one node thick, passes", "[levelset][unit]") {
  GridFrame frame;
  frame.dims = {9, 8, 7};
  CHECK(flow(Labels(frame, 0), 2).nodes_changed == 0);
  const Labels sheet = label_grids::noise({12, 11, 1}, 3, 2);
  const auto result = flow(sheet, 2);
  CHECK(is_equal(label_grids::topology(sheet), label_grids::topology(result.labels)));
}

TEST_CASE("guarded_flow: 1 = 2 = 8 threads", "[levelset][determinism]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    std::vector<GuardedFlowResult> results;
    for (const int threads : {1, 2, 8}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(threads));
      tbb::task_arena arena(threads);
      arena.execute([&] { results.push_back(flow(labels, 2)); });
    }
    for (const auto& result : results) {
      CHECK(result.labels.values == results[0].labels.values);
      CHECK(result.iterations == results[0].iterations);
      CHECK(result.nodes_guarded == results[0].nodes_guarded);
    }
  }
}

TEST_CASE("guarded_flow: every refused move is in a place that says whose it is",
          "[levelset][unit]") {
  // A rod of two nodes' width would be eaten from its ends; the guard keeps it in one piece.
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    const GuardedFlowResult result = flow(labels, 3);
    std::size_t nodes = 0, last = labels.values.size();
    for (const GuardedPlace& place : result.guarded) {
      CHECK(place.nodes <= last);
      last = place.nodes;
      nodes += place.nodes;
      const Vec3 index = labels.frame.mm_to_index(place.position);
      CHECK(labels.frame.contains(int(index.x), int(index.y), int(index.z)));
    }
    CHECK(nodes == result.nodes_guarded);
  }
}

TEST_CASE("guarded_flow: materials below one voxel stay where they are", "[levelset][unit]") {
  const Labels labels = label_grids::noisy_ball(8, 0.3, 3);
  const auto moved = [&](std::vector<double> r) {
    return guarded_flow(labels, r, 200, silent_context()).nodes_changed;
  };
  CHECK(moved({2, 2}) > 0);
  CHECK(moved({2, 0.9}) == 0);  // no boundary is left that may move
  CHECK(moved({0, 0}) == 0);
}

TEST_CASE("guarded_flow: a cancel is obeyed", "[levelset][unit]") {
  StageContext context = silent_context();
  const std::atomic<bool> cancel{true};
  context.cancel = &cancel;
  CHECK_THROWS_AS(guarded_flow(label_grids::ball(5), {2, 2}, 10, context), Error);
}
