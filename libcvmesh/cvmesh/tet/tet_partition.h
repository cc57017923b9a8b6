// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// A tet mesh cut into parts of about the same number of tets, to be improved at the same time and
/// put together again. The cuts depend on the mesh alone.
///
/// Each part is a tet mesh of its own, with all facets of the surface between its vertices. The
/// vertices that several parts have are frozen; they are among the first ones of each part, as
/// those of the surface are, so that nobody takes them for vertices of the interior.
class TetPartition {
 public:
  struct Part {
    TetMesh mesh;
    std::vector<bool> is_frozen;         ///< per vertex of the part's surface
    std::vector<std::int32_t> whole_of;  ///< per vertex of the part's surface, ascending
    std::vector<std::int32_t> facets;    ///< of the whole, as in the part's surface
  };

  std::vector<Part> parts;

  /// Cuts across the longest side in halves until no part has more than `most_tets`, at least 1.
  TetPartition(const TetMesh& whole, std::size_t most_tets);

  /// Puts the parts in the place of what they were cut from; each may have other tets and vertices
  /// of the interior than before, and other corners of facets whose tets are all in it. Vertices of
  /// the surface come first, then those on the cuts, then those of the parts. The parts are gone.
  /// @param whole  as it was
  /// @return the vertices on the cuts, in the new numbering
  std::vector<std::int32_t> join(TetMesh& whole);

 private:
  std::vector<std::int32_t> shared_;  // vertices on the cuts, ascending, those of the surface too
};

}  // namespace cvmesh
