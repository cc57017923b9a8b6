// SPDX-License-Identifier: AGPL-3.0-or-later
#include "phantoms/absorb_crumbs.h"

#include "cvmesh/labels/lattice_components.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

namespace cvmesh::examples {

void absorb_crumbs(std::size_t least_voxels, InputVolume& volume) {
  const GridFrame& frame = volume.frame;
  Grid<MaterialId> ids(frame);
  std::copy(volume.values.begin(), volume.values.end(), ids.values.begin());
  const LatticeComponents pieces = find_lattice_components(ids);
  std::vector<std::map<Label, std::size_t>> faces(pieces.component_count());
  const auto for_each_crumb_voxel = [&](const auto& visit) {
    for (int k = 0; k < frame.dims[2]; ++k) {
      for (int j = 0; j < frame.dims[1]; ++j) {
        const std::size_t row = static_cast<std::size_t>(k) * frame.dims[1] + j;
        for (std::size_t r = pieces.first_of_row[row]; r < pieces.first_of_row[row + 1]; ++r) {
          const std::uint32_t piece = pieces.component_of[r];
          if (pieces.voxels_of[piece] >= least_voxels) continue;
          for (int i = pieces.runs[r].begin; i < pieces.runs[r].end; ++i)
            visit(piece, i, j, k);
        }
      }
    }
  };
  for_each_crumb_voxel([&](std::uint32_t piece, int i, int j, int k) {
    constexpr int kSteps[6][3] = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                  {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
    for (const auto& step : kSteps) {
      const int ni = i + step[0], nj = j + step[1], nk = k + step[2];
      if (!frame.contains(ni, nj, nk)) continue;
      const Label other = volume(ni, nj, nk);
      if (other != 0 && other != pieces.material_of[piece]) ++faces[piece][other];
    }
  });
  for_each_crumb_voxel([&](std::uint32_t piece, int i, int j, int k) {
    const auto& shared = faces[piece];
    const auto most =
        std::max_element(shared.begin(), shared.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    if (most != shared.end()) volume(i, j, k) = most->first;
  });
}

}  // namespace cvmesh::examples
