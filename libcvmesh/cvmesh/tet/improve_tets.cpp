// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/improve_tets.h"

#include "cvmesh/tet/refine_surface.h"
#include "cvmesh/tet/tet_improver.h"

#include <spdlog/spdlog.h>

#include <vector>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr int kPassesBeforeInsertion = 2;
/// A pass that changes fewer tets than one in this many is the last one.
constexpr std::size_t kQuietPass = 1000;

}  // namespace

ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context) {
  ImproveTetsStats stats;
  const std::vector<Vec3> home = mesh.surface.points;
  TetImprover improver(mesh, options, context);
  stats.before = improver.measure();
  while (stats.passes < options.passes) {
    ++stats.passes;
    const auto flips_of = [](const ImproveTetsStats& s) {
      return s.edge_removals + s.face_flips + s.contractions;
    };
    const std::size_t flips_then = flips_of(stats);
    improver.mend(stats);
    improver.flip(stats);
    if (stats.passes == kPassesBeforeInsertion) improver.shed(options.max_surface_shift_mm, stats);
    const std::size_t moves = improver.smooth();
    stats.moves += moves;
    // Flips and moves come first: they are cheaper, and most of what is poor at first goes by them.
    const bool may_insert = stats.passes > kPassesBeforeInsertion;
    const std::size_t insertions_then = stats.insertions, tries_then = stats.insertion_tries;
    if (may_insert) improver.insert(stats);
    const std::size_t inserted = stats.insertions - insertions_then;
    const std::size_t flips = flips_of(stats) - flips_then;
    context.log->debug("{}: improvement pass {}: {} flips, {} moves, {} insertions of {} tried",
                       kStage, stats.passes, flips, moves, inserted,
                       stats.insertion_tries - tries_then);
    if (may_insert && (flips + moves + inserted) * kQuietPass < improver.slot_count()) break;
  }
  improver.open_gaps(home, {}, options.max_vertex_shift_mm, stats);
  stats.after = improver.measure();
  improver.close();
  if (stats.after.poor == 0 || !(options.max_splits_per_vertex > 0)) return stats;
  refine_surface(mesh, home, options, context, stats);
  return stats;
}

}  // namespace cvmesh
