// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Goes through a queue in batches of edits that do not know of each other: all that one of them
/// reads and writes meets a box, and the boxes of a batch are apart. So a batch can be worked on in
/// parallel, with the result of one after the other. Who meets one that comes earlier waits for the
/// next batch. Batches do not depend on the number of threads.
class IndependentBatches {
 public:
  /// @param outline  called with the next candidates, finds their boxes
  /// @param box_of   the box (`const Box3&`) of the candidate with that number
  /// @param handle   called with the numbers of those that make a batch, ascending
  template <typename Outline, typename BoxOf, typename Handle>
  void for_each(const std::vector<std::int32_t>& queue,
                const Outline& outline,
                const BoxOf& box_of,
                const Handle& handle) {
    std::vector<std::int32_t> candidates, waiting;
    std::vector<std::size_t> batch;
    std::size_t next = 0;
    while (next < queue.size() || !waiting.empty()) {
      candidates.swap(waiting);
      while (candidates.size() < candidate_count_ && next < queue.size())
        candidates.push_back(queue[next++]);
      outline(candidates);
      batch.clear();
      waiting.clear();
      for (std::size_t n = 0; n < candidates.size(); ++n)
        if (std::any_of(batch.begin(), batch.end(),
                        [&](std::size_t earlier) { return box_of(earlier).overlaps(box_of(n)); }))
          waiting.push_back(candidates[n]);
        else
          batch.push_back(n);
      handle(batch);
      adapt(batch.size(), candidates.size());
    }
  }

 private:
  static constexpr std::size_t kLeastCandidates = 16, kMostCandidates = 256;

  // Fewer at a time where most have to wait.
  void adapt(std::size_t taken, std::size_t outlined) {
    if (2 * taken < outlined)
      candidate_count_ = std::max(candidate_count_ / 2, kLeastCandidates);
    else if (4 * taken > 3 * outlined)
      candidate_count_ = std::min(candidate_count_ * 2, kMostCandidates);
  }

  std::size_t candidate_count_ = kMostCandidates;
};

}  // namespace cvmesh
