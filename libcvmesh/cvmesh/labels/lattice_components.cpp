// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/lattice_components.h"

#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

namespace cvmesh {
namespace {

using Run = LatticeComponents::Run;

// Calls found(begin, end, material) for each run of non-exterior voxels of a row.
template <typename Found>
void for_each_run(const MaterialId* row, std::int32_t length, const Found& found) {
  for (std::int32_t x = 0; x < length;) {
    const MaterialId material = row[x];
    const std::int32_t begin = x;
    while (x < length && row[x] == material)
      ++x;
    if (material != kExterior) found(begin, x, material);
  }
}

void collect_runs(const Grid<MaterialId>& ids, LatticeComponents& result) {
  const std::int32_t nx = ids.frame.dims[0];
  const std::size_t rows = static_cast<std::size_t>(ids.frame.dims[1]) * ids.frame.dims[2];
  result.first_of_row.assign(rows + 1, 0);
  parallel_for_each_index(
      0, rows,
      [&](std::size_t row) {
        std::size_t count = 0;
        for_each_run(&ids.values[row * nx], nx, [&](auto, auto, auto) { ++count; });
        result.first_of_row[row + 1] = count;
      },
      256);
  std::partial_sum(result.first_of_row.begin(), result.first_of_row.end(),
                   result.first_of_row.begin());
  require(
      result.first_of_row.back() < std::numeric_limits<std::uint32_t>::max(), ErrorCode::BadInput,
      "labels",
      "the volume has " + std::to_string(result.first_of_row.back()) +
          " runs of equal voxels, more than 4,294,967,294; crop the volume or remove its noise");
  result.runs.resize(result.first_of_row.back());
  parallel_for_each_index(
      0, rows,
      [&](std::size_t row) {
        Run* next = result.runs.data() + result.first_of_row[row];
        for_each_run(&ids.values[row * nx], nx,
                     [&](std::int32_t begin, std::int32_t end, MaterialId material) {
                       *next++ = {begin, end, material};
                     });
      },
      256);
}

// Joins the runs of one row with those of an earlier row. The lattice's edges lead from x to x and
// to x - 1 of each of the three earlier rows, so runs touch when [begin - 1, end) overlaps.
void join_rows(const LatticeComponents& c,
               std::size_t row,
               std::size_t earlier,
               DisjointSets& sets) {
  std::size_t a = c.first_of_row[row];
  std::size_t b = c.first_of_row[earlier];
  while (a < c.first_of_row[row + 1] && b < c.first_of_row[earlier + 1]) {
    const Run& run = c.runs[a];
    const Run& other = c.runs[b];
    if (run.material == other.material && other.end > run.begin - 1 && other.begin < run.end) {
      sets.join(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
    }
    // The run that ends first cannot meet a later one, except that a run of this row reaches one
    // voxel back: the next one of this row may begin at run.end and meet `other` up to there.
    if (other.end < run.end) {
      ++b;
    } else {
      ++a;
    }
  }
}

}  // namespace

std::int64_t LatticeComponents::run_at(std::size_t row, std::int32_t x) const {
  const auto first = runs.begin() + static_cast<std::ptrdiff_t>(first_of_row[row]);
  const auto last = runs.begin() + static_cast<std::ptrdiff_t>(first_of_row[row + 1]);
  const auto after = std::upper_bound(first, last, x,
                                      [](std::int32_t v, const Run& run) { return v < run.begin; });
  if (after == first || (after - 1)->end <= x) return -1;
  return after - 1 - runs.begin();
}

LatticeComponents find_lattice_components(const Grid<MaterialId>& ids) {
  LatticeComponents result;
  collect_runs(ids, result);
  const auto [nx, ny, nz] = ids.frame.dims;
  static_cast<void>(nx);
  DisjointSets sets(result.runs.size());
  for (int k = 0; k < nz; ++k) {
    for (int j = 0; j < ny; ++j) {
      const std::size_t row = static_cast<std::size_t>(k) * ny + j;
      if (j > 0) join_rows(result, row, row - 1, sets);
      if (k > 0) join_rows(result, row, row - ny, sets);
      if (j > 0 && k > 0) join_rows(result, row, row - ny - 1, sets);
    }
  }
  result.component_of.resize(result.runs.size());
  for (std::size_t i = 0; i < result.runs.size(); ++i) {
    const std::uint32_t root = sets.find(static_cast<std::uint32_t>(i));
    if (root == i) {
      result.component_of[i] = static_cast<std::uint32_t>(result.component_count());
      result.material_of.push_back(result.runs[i].material);
      result.voxels_of.push_back(0);
    } else {
      result.component_of[i] = result.component_of[root];
    }
    result.voxels_of[result.component_of[i]] +=
        static_cast<std::size_t>(result.runs[i].end - result.runs[i].begin);
  }
  return result;
}

}  // namespace cvmesh
