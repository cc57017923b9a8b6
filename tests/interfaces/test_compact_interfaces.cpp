// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/compact_interfaces.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/facet_shapes.h"
#include "cvmesh/mesh/validate.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "levelset/label_grids.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <vector>

using namespace cvmesh;
using label_grids::Labels;

namespace {

constexpr double kClearance = 0.001;

struct Both {
  InterfaceMesh full;
  CompactInterfaces compact;
  GridFrame frame;
};

Both make(const Labels& labels, double clearance_mm = kClearance) {
  Both both;
  auto level_sets = build_level_sets(label_grids::shared(labels),
                                     label_grids::material_count(labels), silent_context())
                        .level_sets;
  both.full = extract_interfaces(tighten(std::move(level_sets), {}, silent_context()).level_sets,
                                 silent_context());
  both.frame = labels.frame;
  both.compact = compact_interfaces(both.full, labels.frame, clearance_mm, silent_context());
  return both;
}

void check_promises(const Both& both, const Labels& labels) {
  const std::size_t materials = label_grids::material_count(labels);
  const InterfaceMesh& mesh = both.compact.mesh;
  const Validation validation = validate(mesh, materials);
  INFO(validation.summary());
  CHECK(validation.is_valid());
  CHECK(find_intersections(mesh).empty());
  CHECK(both.compact.stats.merged_vertices == both.full.points.size() - mesh.points.size());
  const auto is = boundary_topology(mesh, materials), was = boundary_topology(both.full, materials);
  const auto volume = label_grids::volumes(mesh, materials),
             full_volume = label_grids::volumes(both.full, materials);
  for (std::size_t m = 0; m < materials; ++m) {
    INFO("material " << m);
    CHECK(is[m].components == was[m].components);
    CHECK(is[m].euler == was[m].euler);
    CHECK(volume[m] == Approx(full_volume[m]).epsilon(1e-9).margin(1e-6));
  }
}

// Curves and corners, where they are, with what meets there.
std::set<std::tuple<double, double, double, int>> curve_points(const InterfaceMesh& mesh) {
  const Strata strata = find_strata(mesh);
  std::set<std::tuple<double, double, double, int>> points;
  for (std::size_t v = 0; v < mesh.points.size(); ++v)
    if (strata.dimension[v] < 2)
      points.emplace(mesh.points[v].x, mesh.points[v].y, mesh.points[v].z, strata.dimension[v]);
  return points;
}

double distance_to(const InterfaceMesh& mesh, const Vec3& p) {
  const FacetShapes shapes{mesh};
  double least = 1e300;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f)
    least = std::min(least, shapes.squared_distance(f, p));
  return std::sqrt(least);
}

}  // namespace

TEST_CASE(
    "compact_interfaces: valid, of the same topology, volumes and curves, without intersections, "
    "on every phantom",
    "[interfaces][property]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    const Both both = make(labels);
    check_promises(both, labels);
    CHECK(curve_points(both.compact.mesh) == curve_points(both.full));
  }
}

TEST_CASE("compact_interfaces: noise keeps its promises, too", "[interfaces][property]") {
  for (std::uint64_t seed = 1; seed <= 6; ++seed)
    for (const int materials : {2, 4}) {
      INFO("seed " << seed << ", " << materials << " materials");
      const Labels labels = label_grids::noise({10, 10, 10}, materials, seed);
      check_promises(make(labels), labels);
    }
}

TEST_CASE("compact_interfaces: of a ball a third of the vertices is left, near to where all were",
          "[interfaces][unit]") {
  const Labels labels = label_grids::ball(12);
  const Both both = make(labels);
  CHECK(both.compact.mesh.points.size() < 0.4 * both.full.points.size());
  CHECK(both.compact.stats.barred_nodes == 0);
  for (const Vec3& p : both.full.points)
    CHECK(distance_to(both.compact.mesh, p) < 0.04);
  const Vec3 centre = label_grids::ball_centre(12);
  for (const Vec3& p : both.compact.mesh.points)
    CHECK(distance(p, centre) == Approx(12).margin(0.5));
}

TEST_CASE("compact_interfaces: what was merged is told with the facet nearest to it",
          "[interfaces][unit]") {
  const Both both = make(label_grids::ball(6));
  const InterfaceMesh& mesh = both.compact.mesh;
  CHECK(both.compact.samples.size() > both.compact.stats.merged_vertices);
  for (const FacetSample& sample : both.compact.samples) {
    CHECK(std::find(both.full.points.begin(), both.full.points.end(), sample.position) !=
          both.full.points.end());
    const double d = std::sqrt(FacetShapes{mesh}.squared_distance(sample.facet, sample.position));
    CHECK(d == Approx(distance_to(mesh, sample.position)).margin(1e-12));
  }
}

TEST_CASE("compact_interfaces: a larger clearance bars the nodes where it is not kept",
          "[interfaces][unit]") {
  // Sheets a voxel apart, on either side of a plate: a quarter of a voxel is kept, one is not.
  const Labels labels = label_grids::sample({14, 14, 9}, [](const Vec3& p) -> MaterialId {
    return std::abs(p.z - 4) < 0.6 && std::abs(p.x - 6.5) < 5 && std::abs(p.y - 6.5) < 5 ? 1 : 0;
  });
  const Both kept = make(labels, 0.25), missed = make(labels, 1.5);
  CHECK(kept.compact.stats.barred_nodes < missed.compact.stats.barred_nodes);
  CHECK(missed.compact.stats.merged_vertices < kept.compact.stats.merged_vertices);
  check_promises(missed, labels);
}

TEST_CASE("compact_interfaces: 1 = 2 = 8 threads", "[interfaces][determinism]") {
  std::vector<Labels> volumes{label_grids::noise({12, 12, 12}, 3, 5)};
  for (const auto& [name, labels] : label_grids::phantoms())
    volumes.push_back(labels);
  for (const Labels& labels : volumes) {
    std::vector<CompactInterfaces> results;
    for (const int threads : {1, 2, 8}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(threads));
      tbb::task_arena arena(threads);
      arena.execute([&] { results.push_back(make(labels).compact); });
    }
    for (const auto& result : results) {
      CHECK(result.mesh.points == results[0].mesh.points);
      CHECK(result.mesh.facets == results[0].mesh.facets);
      CHECK(result.stats.barred_nodes == results[0].stats.barred_nodes);
      CHECK(std::equal(result.samples.begin(), result.samples.end(), results[0].samples.begin(),
                       results[0].samples.end(), [](const FacetSample& a, const FacetSample& b) {
                         return a.facet == b.facet && a.position == b.position;
                       }));
    }
  }
}
