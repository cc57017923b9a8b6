// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <cstddef>
#include <functional>

namespace cvmesh {

/// Calls `body(i)` for every i in [begin, end), in any order, `grain` neighbouring indices at a
/// time. The body may write only what belongs to index i.
template <typename Body>
void parallel_for_each_index(std::size_t begin,
                             std::size_t end,
                             const Body& body,
                             std::size_t grain = 1024) {
  if (begin >= end) return;
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(begin, end, grain),
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i != range.end(); ++i)
          body(i);
      },
      tbb::simple_partitioner());
}

/// The sum (or other fold) of `map(i)` over [begin, end), the same to the last bit at any number
/// of threads: fixed grain, fixed tree.
template <typename Value, typename Map, typename Join>
Value deterministic_reduce(std::size_t begin,
                           std::size_t end,
                           const Value& identity,
                           const Map& map,
                           const Join& join,
                           std::size_t grain = 4096) {
  if (begin >= end) return identity;
  return tbb::parallel_deterministic_reduce(
      tbb::blocked_range<std::size_t>(begin, end, grain), identity,
      [&](const tbb::blocked_range<std::size_t>& range, Value value) {
        for (std::size_t i = range.begin(); i != range.end(); ++i)
          value = join(value, map(i));
        return value;
      },
      join, tbb::simple_partitioner());
}

/// Sorts by a strict total order (ties would make the result depend on the threads).
template <typename Iterator, typename Less = std::less<>>
void parallel_sort(Iterator begin, Iterator end, const Less& less = {}) {
  tbb::parallel_sort(begin, end, less);
}

}  // namespace cvmesh
