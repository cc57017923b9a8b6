// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/surface/decimate_sequential.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace cvmesh {

/// What it took to give the slave's facets on one patch, or on all of a pair, the edges of the
/// master's.
struct EdgeConformity {
  std::size_t edges = 0;                ///< the master's, inside the patches
  std::size_t edges_differing = 0;      ///< of these, absent from the slave's before any flip
  std::size_t flips = 0;                ///< of the slave's edges
  std::size_t edges_not_flippable = 0;  ///< of the master's edges, still absent afterwards
  std::vector<std::int32_t> vertices_differing;  ///< ids: those in one of both only; ascending
  std::optional<Vec3> obstacle;                  ///< grid mm: the first of what is not conformal
};

/// One pass: all patches of a pair of materials.
struct ConformPass {
  Sides sides;  ///< slave inside, master outside
  EdgeConformity result;
};

struct ConformEdgesStats {
  std::vector<ConformPass> passes;  ///< in order of (slave, master)
  /// Edges that a slave gave up on an interface where it is the master itself, by flips that are
  /// not among those of the passes: a master has the same edge on the interface with the slave.
  std::size_t edges_given_up = 0;
  std::size_t boundaries_repeated = 0;  ///< see `DecimateSequentialResult`

  [[nodiscard]] EdgeConformity total() const;  ///< with the obstacle of the first pass that has one
};

struct ConformEdgesResult {
  InterfaceMesh mesh;                      ///< every patch as its master has it
  std::vector<std::vector<Vec3>> samples;  ///< per facet of `mesh`
  ConformEdgesStats stats;
};

/// Flips edges of `slave` until it is the same as `master`: two triangulations of one patch, facets
/// with one orientation. Edges of the rim are no subject; where rims or vertices differ nothing is
/// flipped, and all edges that differ count as not flippable.
///
/// First every edge goes whose flip gives an edge of the master. An edge that is then still absent
/// is put in as in Sloan's method [Sloan 1993]: the edges between its ends that it crosses are
/// flipped away, one by one. Which those are is decided in space (they are nearest to it), and not
/// in a plane, since a sparse patch has no good one; flips need not be convex either, because the
/// shapes in between do not matter: what is reached is the master's patch. No flip makes an edge
/// that the patch has already.
EdgeConformity conform_patch(const std::vector<VertexTriple>& master,
                             const std::vector<Vec3>& points,
                             std::vector<VertexTriple>& slave);

/// The boundaries made conformal by master/slave passes of edge flips, one for each pair of
/// materials that meet: at most (m^2 - m) / 2 for m materials (paper, §7.4).
///
/// A slave may have the edge that its master asks for already, but on another interface, and no
/// closed manifold has an edge twice. Where the slave is the master of that interface, it gives the
/// edge up there by a flip, before its own slaves follow. Elsewhere two masters contradict.
///
/// The stats say where edges could not be flipped. `mesh` is one whole only where all could, and
/// nobody has looked yet whether facets of different boundaries intersect, or have edges in common.
/// @param points  of the vertices that the boundaries name
ConformEdgesResult conform_edges(std::vector<OwnBoundary> boundaries,
                                 const std::vector<Vec3>& points,
                                 const StageContext& context);

}  // namespace cvmesh
