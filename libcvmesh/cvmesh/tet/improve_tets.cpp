// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/improve_tets.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/tet/refine_surface.h"
#include "cvmesh/tet/tet_improver.h"
#include "cvmesh/tet/tet_partition.h"

#include <spdlog/spdlog.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr int kPassesBeforeInsertion = 2;
/// A pass that changes fewer tets than one in this many is the last one.
constexpr std::size_t kQuietPass = 1000;

std::size_t flips_of(const ImproveTetsStats& stats) {
  return stats.edge_removals + stats.face_flips + stats.contractions;
}

/// Passes until one changes little.
void improve_in_passes(TetImprover& improver,
                       const std::vector<bool>& is_frozen,
                       const ImproveTetsOptions& options,
                       const StageContext& context,
                       ImproveTetsStats& stats) {
  for (int pass = 1; pass <= options.passes; ++pass) {
    stats.passes = std::max(stats.passes, pass);
    const std::size_t flips_then = flips_of(stats);
    improver.mend(stats);
    improver.flip(stats);
    if (pass == kPassesBeforeInsertion)
      improver.shed(options.max_surface_shift_mm, is_frozen, stats);
    const std::size_t moves = improver.smooth();
    stats.moves += moves;
    // Flips and moves come first: they are cheaper, and most of what is poor at first goes by them.
    const bool may_insert = pass > kPassesBeforeInsertion;
    const std::size_t insertions_then = stats.insertions, tries_then = stats.insertion_tries;
    if (may_insert) improver.insert(stats);
    const std::size_t inserted = stats.insertions - insertions_then;
    const std::size_t flips = flips_of(stats) - flips_then;
    context.log->debug("{}: improvement pass {}: {} flips, {} moves, {} insertions of {} tried",
                       kStage, pass, flips, moves, inserted, stats.insertion_tries - tries_then);
    if (may_insert && (flips + moves + inserted) * kQuietPass < improver.slot_count()) break;
  }
}

/// Improves parts of the mesh at the same time, each by itself; vertices on the cuts stay.
/// @return those vertices
std::vector<std::int32_t> improve_parts(TetMesh& mesh,
                                        const ImproveTetsOptions& options,
                                        const StageContext& context,
                                        ImproveTetsStats& stats) {
  TetPartition partition(mesh, options.most_tets_of_part);
  std::vector<ImproveTetsStats> stats_of(partition.parts.size());
  StageContext quiet = context;
  quiet.log = silent_context().log;  // they would all speak at the same time
  parallel_for_each_index(
      0, partition.parts.size(),
      [&](std::size_t p) {
        auto& [part, is_frozen, whole_of, facets] = partition.parts[p];
        ImproveTetsOptions own = options;
        own.few_insertion_tries = options.few_insertion_tries * part.tets.size() / mesh.tets.size();
        // A thread that waits here for others must not take on another part meanwhile.
        tbb::this_task_arena::isolate([&] {
          TetImprover improver(part, own, quiet);
          improve_in_passes(improver, is_frozen, own, quiet, stats_of[p]);
          improver.close();
        });
      },
      1);
  for (const ImproveTetsStats& part : stats_of) {
    stats.passes = std::max(stats.passes, part.passes);
    stats.moves += part.moves;
    stats.edge_removals += part.edge_removals;
    stats.face_flips += part.face_flips;
    stats.contractions += part.contractions;
    stats.insertions += part.insertions;
    stats.insertion_tries += part.insertion_tries;
    stats.surface_flips += part.surface_flips;
  }
  context.log->debug("{}: {} parts improved: {} flips, {} moves, {} insertions of {} tried", kStage,
                     stats_of.size(), flips_of(stats), stats.moves, stats.insertions,
                     stats.insertion_tries);
  return partition.join(mesh);
}

/// Bound on tets in which new vertices are tried around so many vertices.
std::size_t tries_at(std::size_t vertices, const ImproveTetsOptions& options) {
  return static_cast<std::size_t>(options.max_insertion_tries_per_vertex *
                                  static_cast<double>(vertices));
}

}  // namespace

ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context) {
  ImproveTetsStats stats;
  const std::vector<Vec3> home = mesh.surface.points;
  std::vector<std::int32_t> on_cuts;
  const bool has_parts = mesh.tets.size() > options.most_tets_of_part;
  if (has_parts) {
    OpenTets tets(mesh);
    stats.before = measure_dihedral_angles(tets);
    tets.close();
    on_cuts = improve_parts(mesh, options, context, stats);
  }
  TetImprover improver(mesh, options, context);
  if (has_parts)
    improver.look_only_at(on_cuts, tries_at(on_cuts.size(), options));
  else
    stats.before = improver.measure();
  improve_in_passes(improver, {}, options, context, stats);
  improver.open_gaps(home, {}, options.max_vertex_shift_mm, GapOpener::Barred::Stays, stats);
  stats.after = improver.measure();
  improver.close();
  if (stats.after.poor == 0 || !(options.max_splits_per_vertex > 0)) return stats;
  refine_surface(mesh, home, options, context, stats);
  return stats;
}

}  // namespace cvmesh
