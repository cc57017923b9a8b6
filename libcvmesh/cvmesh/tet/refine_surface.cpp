// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/refine_surface.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/tet/open_gaps.h"
#include "cvmesh/tet/split_surface_edges.h"
#include "cvmesh/tet/tet_improver.h"
#include "cvmesh/tet/tet_part.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr double kDegree = std::numbers::pi / 180;
/// Rounds of splits. Some in a row may be in vain: what one leaves poor, the next may mend (femur
/// at 21,393 vertices: 10 poor tets with none in vain, 6 with three, 0 with five).
constexpr int kMostRounds = 24, kMostInVain = 5;
/// The same once no tet is poor by what is reported: the rest lacks a degree or two.
constexpr int kFewInVain = 1;
/// In these rounds new vertices are tried only in tets below this angle, little above that of poor
/// ones: those that are merely modest were tried before, and what moves around them makes others
/// poor (femur: 1.7 s instead of 19, none poor instead of two).
constexpr double kInsertBelowDeg = 18;
/// Of the splits that there may be, for the rounds before gaps are opened by barred moves: what is
/// poor after these needs some, too (pelvis at 60,000 vertices: no poor tet instead of 63).
constexpr double kFirstShare = 0.75;
/// Tets of a round in which new vertices are tried, and for each split edge. A femur's rounds ask
/// for up to 220 a split, and one of a single split for 463; in noise each try makes others poor.
constexpr std::size_t kTriesPerRound = 500, kTriesPerSplit = 250;

/// Rings of vertices around the poor tets that take part. With eight the tets of a femur and a
/// torso are the same as if all took part, with four they are not.
constexpr int kRings = 8;
/// Vertices of the surface keep away from facets that are so near, over the longest way of one.
constexpr double kReachOverShift = 2.1;

/// The poor tets, the worst first.
/// @param lack  what their sines lack, squared and summed
std::vector<std::int32_t> find_poor_tets(const TetMesh& mesh, double& lack) {
  static_assert(kPoorMinDeg < 180 - kPoorMaxDeg);
  const double enough = std::sin(kPoorMaxDeg * kDegree);
  std::vector<double> sine(mesh.tets.size());
  parallel_for_each_index(0, sine.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    const auto& p = mesh.points;
    sine[t] = min_dihedral_sine(p[a], p[b], p[c], p[d]);
  });
  std::vector<std::int32_t> poor;
  for (std::size_t t = 0; t < sine.size(); ++t)
    if (sine[t] < enough) poor.push_back(static_cast<std::int32_t>(t));
  std::sort(poor.begin(), poor.end(), [&](std::int32_t s, std::int32_t t) {
    return std::pair(sine[s], s) < std::pair(sine[t], t);
  });
  lack = 0;
  for (const std::int32_t t : poor)
    lack += (enough - sine[t]) * (enough - sine[t]);
  return poor;
}

/// A part of a mesh whose surface may be refined where tets stay poor, with what was done to it.
struct Refined {
  TetMesh mesh;
  std::vector<Vec3> home;  ///< where the part's surface's vertices were at first
  ImproveTetsStats stats;
  std::vector<std::int32_t> poor{};     ///< tets
  double lack = 0;                      ///< of them
  std::vector<std::int32_t> touched{};  ///< vertices at the edges that were split last

  /// Less is lacking, and no tet is much worse than the worst was.
  [[nodiscard]] bool is_better_than(const Refined& before) const {
    constexpr double kLeastAngleKept = 0.8, kLackKept = 0.95;
    return lack < kLackKept * before.lack &&
           stats.after.min_deg >= kLeastAngleKept * before.stats.after.min_deg;
  }
};

/// Splits edges of the surface at some tets, and improves what is around them; nothing where no
/// edge can be split, or none but those that were split `before`.
std::optional<Refined> split_and_improve(Refined refined,
                                         const std::vector<std::int32_t>& wanted,
                                         const Refined* before,
                                         const std::vector<bool>& is_frozen,
                                         std::size_t most,
                                         const ImproveTetsOptions& options,
                                         const StageContext& context) {
  constexpr int kPasses = 3;
  auto& [mesh, home, stats, poor, lack, touched] = refined;
  touched = split_surface_edges(mesh, wanted, is_frozen, options.min_split_edge_mm, most);
  if (touched.empty() || (before != nullptr && touched == before->touched)) return std::nullopt;
  const std::size_t splits = mesh.surface.points.size() - home.size();
  stats.edge_splits += splits;
  home.insert(home.end(), mesh.surface.points.begin() + static_cast<std::ptrdiff_t>(home.size()),
              mesh.surface.points.end());
  ImproveTetsOptions narrow = options;
  narrow.insert_below_deg = std::min(options.insert_below_deg, kInsertBelowDeg);
  TetImprover improver(mesh, narrow, context);
  improver.look_only_at(
      touched, std::min(options.few_insertion_tries, kTriesPerRound + kTriesPerSplit * splits));
  for (int pass = 0; pass < kPasses; ++pass) {
    improver.mend(stats);
    improver.flip(stats);
    stats.moves += improver.smooth();
    improver.insert(stats);
  }
  improver.mend(stats);
  improver.open_gaps(home, is_frozen, options.max_vertex_shift_mm, GapOpener::Barred::Stays, stats);
  stats.after = improver.measure();
  improver.close();
  poor = find_poor_tets(mesh, lack);
  return refined;
}

std::vector<Vec3> centroids(const TetMesh& mesh, const std::vector<std::int32_t>& tets) {
  std::vector<Vec3> result;
  result.reserve(tets.size());
  for (const std::int32_t t : tets) {
    Vec3 sum;
    for (const std::int32_t v : mesh.tets[t])
      sum += mesh.points[v];
    result.push_back(sum / 4);
  }
  return result;
}

/// Of the poor tets before, those around which there are fewer of them after.
std::vector<std::int32_t> where_it_helped(const Refined& before, const Refined& after) {
  const std::vector<Vec3> old_places = centroids(before.mesh, before.poor);
  const std::vector<Vec3> new_places = centroids(after.mesh, after.poor);
  const NeighbourTree old_tree(old_places), new_tree(new_places);
  const std::vector<Vec3>& points = before.mesh.points;
  std::vector<std::int32_t> helped, found;
  for (std::size_t n = 0; n < before.poor.size(); ++n) {
    const OpenTets::Tet& tet = before.mesh.tets[before.poor[n]];
    double longest = 0;
    for (const auto& [i, j, k, l] : OpenTets::kEdges)
      longest = std::max(longest, distance(points[tet[i]], points[tet[j]]));
    old_tree.within(old_places[n], longest, found);
    const std::size_t old_count = found.size();
    new_tree.within(old_places[n], longest, found);
    if (found.size() < old_count) helped.push_back(before.poor[n]);
  }
  return helped;
}

/// Splits edges in rounds; see `refine_surface`.
/// @return  whether what is kept is not what was given
bool refine_in_rounds(Refined& refined,
                      const std::vector<bool>& is_frozen,
                      std::size_t most_splits,
                      const ImproveTetsOptions& options,
                      const StageContext& context) {
  const std::size_t splits_before = refined.stats.edge_splits;
  const auto attempt = [&](const std::vector<std::int32_t>& wanted, const Refined* before) {
    auto tried = split_and_improve(refined, wanted, before, is_frozen,
                                   most_splits - refined.stats.edge_splits, options, context);
    if (tried)
      context.log->debug(
          "{}: {} edges of the surface split, {} insertions of {} tried, {} poor tets instead of "
          "{}, lacking {:.3g} instead of {:.3g}",
          kStage, tried->stats.edge_splits - refined.stats.edge_splits,
          tried->stats.insertions - refined.stats.insertions,
          tried->stats.insertion_tries - refined.stats.insertion_tries, tried->poor.size(),
          refined.poor.size(), tried->lack, refined.lack);
    return tried;
  };
  std::optional<Refined> best;  // where it is not `refined`
  const auto most_in_vain = [&] {
    return (best ? *best : refined).stats.after.poor > 0 ? kMostInVain : kFewInVain;
  };
  int rounds = 0, in_vain = 0;
  while (rounds++ < kMostRounds && in_vain <= most_in_vain() &&
         refined.stats.edge_splits < most_splits) {
    auto tried = attempt(refined.poor, nullptr);
    if (!tried) break;
    const Refined& to_beat = best ? *best : refined;
    if (!tried->is_better_than(to_beat))
      if (auto narrow = attempt(where_it_helped(refined, *tried), &*tried);
          narrow && (narrow->is_better_than(to_beat) || narrow->lack < tried->lack))
        tried = std::move(narrow);
    if (tried->is_better_than(to_beat)) {
      best.reset();
      in_vain = 0;
    } else {
      if (!best) best = std::move(refined);
      ++in_vain;
    }
    refined = std::move(*tried);
  }
  if (best) refined = std::move(*best);
  return refined.stats.edge_splits > splits_before;
}

/// Opens gaps by moves that are barred as a whole.
/// @return  whether less is lacking; else `refined` must not be used any more
bool open_barred_gaps(Refined& refined,
                      const std::vector<bool>& is_frozen,
                      const ImproveTetsOptions& options,
                      const StageContext& context) {
  auto& [mesh, home, stats, poor, lack, touched] = refined;
  const double lack_before = lack;
  const std::size_t count_before = poor.size();
  TetImprover improver(mesh, options, context);
  improver.open_gaps(home, is_frozen, options.max_vertex_shift_mm, GapOpener::Barred::GoesInPart,
                     stats);
  stats.after = improver.measure();
  improver.close();
  poor = find_poor_tets(mesh, lack);
  context.log->debug(
      "{}: {} poor tets instead of {} by moves in part, lacking {:.3g} instead of {:.3g}", kStage,
      poor.size(), count_before, lack, lack_before);
  return lack < lack_before;
}

/// Cuts out what is around some tets, lets `work(Refined&, is_frozen)` change it, and puts it back
/// if that returns true.
/// @param home  grows with the surface's vertices
/// @return      what `work` returned
template <typename Work>
bool work_around(TetMesh& mesh,
                 const std::vector<std::int32_t>& tets,
                 std::vector<Vec3>& home,
                 double max_vertex_shift_mm,
                 ImproveTetsStats& stats,
                 const Work& work) {
  TetPart part(mesh, tets, kRings, kReachOverShift * max_vertex_shift_mm);
  std::vector<Vec3> home_of_part = part.of_surface(home);
  Refined refined{std::move(part.mesh), std::move(home_of_part), stats};
  refined.poor = find_poor_tets(refined.mesh, refined.lack);
  if (!work(refined, part.is_frozen)) return false;
  stats = refined.stats;
  part.mesh = std::move(refined.mesh);
  part.put_back(mesh);
  home.insert(home.end(), refined.home.begin() + static_cast<std::ptrdiff_t>(part.is_frozen.size()),
              refined.home.end());
  return true;
}

}  // namespace

void refine_surface(TetMesh& mesh,
                    const std::vector<Vec3>& home,
                    const ImproveTetsOptions& options,
                    const StageContext& context,
                    ImproveTetsStats& stats) {
  const auto most =
      static_cast<std::size_t>(options.max_splits_per_vertex * static_cast<double>(home.size()));
  std::vector<Vec3> homes = home;
  const auto find_poor = [&] {
    double lack = 0;
    return find_poor_tets(mesh, lack);
  };
  const auto refine = [&](const std::vector<std::int32_t>& tets, std::size_t most_splits) {
    work_around(mesh, tets, homes, options.max_vertex_shift_mm, stats,
                [&](Refined& refined, const std::vector<bool>& is_frozen) {
                  context.log->debug("{}: {} of {} tets are around {} poor ones", kStage,
                                     refined.mesh.tets.size(), mesh.tets.size(), tets.size());
                  return refine_in_rounds(refined, is_frozen, most_splits, options, context);
                });
  };
  const auto most_at_first = static_cast<std::size_t>(kFirstShare * static_cast<double>(most));
  refine(find_poor(), most_at_first);
  const std::vector<std::int32_t> left = find_poor();
  const bool is_better =
      !left.empty() && options.max_vertex_shift_mm > 0 &&
      work_around(mesh, left, homes, options.max_vertex_shift_mm, stats,
                  [&](Refined& refined, const std::vector<bool>& is_frozen) {
                    return open_barred_gaps(refined, is_frozen, options, context);
                  });
  // What could not be helped may have lacked so much that no gain elsewhere counted beside it.
  if (is_better || (!left.empty() && stats.edge_splits >= most_at_first)) refine(find_poor(), most);
  std::tie(stats.shifted_vertices, stats.max_vertex_shift_mm) = shifts_from(homes, mesh.surface);
  OpenTets tets(mesh);
  stats.after = measure_dihedral_angles(tets);
  tets.close();
}

}  // namespace cvmesh
