// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/tet/dihedral_angles.h"

#include <cstddef>

namespace cvmesh {

/// Hill-climbing improvement of a tetrahedral mesh, the surface all but frozen [Freitag 1997,
/// Klingner 2008].
///
/// Two measures lead it: the smallest sine of the dihedral angles, worst tet first, up to a
/// comfortable angle; and from there on the mean radius ratio 3 r / R. A change is made only if the
/// tets that it touches gain by the first, or by the second without loss in the first, so the
/// worst angle of the mesh never falls. The changes:
/// - an interior edge goes, its ring triangulated anew in the best way (3-2 and 4-4 flips and their
///   general form); a face goes by the 2-3 flip; an interior vertex goes into a neighbour;
/// - an interior vertex moves to the best place found by a pattern search;
/// - a new vertex comes where tets stay poor. Changes and moves around it follow, and all of that
///   is taken back unless the worst tet gains: between the walls of a sparse surface TetGen adds no
///   vertices, and there new ones help. Tries are bounded, worst tet first: where most of the mesh
///   is poor, they would take far longer than everything else;
/// - a surface edge flips under a tet that lies flat between its two facets. The tet goes over to
///   the other material and must vanish there by an edge removal. The surface moves by less than
///   `max_surface_shift_mm` and keeps its vertices, its patches and its topology;
/// - vertices of the surface move by at most `max_vertex_shift_mm` where it presses tets flat
///   (`GapOpener`);
/// - last, where tets are still poor, the longest edges that they have on the surface are split in
///   their middles: what is flat is so only for as long as its edges are much longer than the gap
///   between two sheets. The state in which the tets lack least is kept (`refine_surface`).
///
/// Where two sheets of the surface meet in a narrow wedge, no interior change helps: such tets are
/// told apart (`DihedralAngles`). Interior vertices may go, and indices above those of the surface
/// may change.
struct ImproveTetsOptions {
  int passes = 6;  ///< upper bound; stops earlier once a pass changes little
  /// Below it the worst angle counts, above it the mean. Larger values cost much of the mean: 3r/R
  /// of 15,000 vertices of a liver 0.80 with 16, 0.77 with 25, 0.71 with 35.
  double comfort_deg = 16;
  /// A new vertex only for such a tet; 0: none. 20 takes 6 % less time for a bunny of 227,000 tets,
  /// whose smallest angle is then 17 degrees, not 22.
  double insert_below_deg = 27;
  double max_surface_shift_mm = 0;       ///< of flips of surface edges; 0: no such flips
  double max_vertex_shift_mm = 0;        ///< of vertices of the surface; 0: they stay
  double min_split_edge_mm = 0;          ///< shorter edges of the surface are not split
  double max_splits_per_vertex = 0;      ///< bound on split edges, over the vertices of the surface
  double max_insertions_per_vertex = 1;  ///< bound on new vertices, over those of the mesh
  /// Bound on tets in which new vertices are tried, over the vertices of the mesh, and how many are
  /// always allowed. Sparse surfaces of thin parts ask for up to 0.34 a vertex, pure noise for 2.
  double max_insertion_tries_per_vertex = 0.4;
  std::size_t few_insertion_tries = 20000;
  /// Larger meshes are cut into parts of at most so many tets, which are improved at the same time.
  std::size_t most_tets_of_part = 300'000;
};

struct ImproveTetsStats {
  int passes = 0;
  std::size_t moves = 0, edge_removals = 0, face_flips = 0, contractions = 0, insertions = 0;
  std::size_t insertion_tries = 0;  ///< tets in which new vertices were tried
  std::size_t surface_flips = 0;
  std::size_t shifted_vertices = 0;  ///< of the surface
  double max_vertex_shift_mm = 0;    ///< the longest way of one
  std::size_t edge_splits = 0;       ///< of the surface: so many vertices are new there
  DihedralAngles before, after;
};

/// Improves `mesh` in place and says what was done. Edge removals and moves are proposed in
/// parallel and carried out in order, and large meshes are improved in parts at the same time, then
/// on the cuts: the same bytes at any number of threads. About 4 microseconds per tet and pass on
/// two cores, 200 bytes per tet.
///
/// @throws Error Limit when `context.cancel` is set
ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context);

}  // namespace cvmesh
