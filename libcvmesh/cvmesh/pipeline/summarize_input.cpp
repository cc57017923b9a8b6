// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/summarize_input.h"

#include "cvmesh/io/sha256.h"

#include <set>
#include <span>

namespace cvmesh {

InputSummary summarize_input(const InputVolume& volume, const std::filesystem::path& file) {
  std::set<Label> labels;
  Label last = 0;
  for (const Label label : volume.values) {
    // Neighbours are mostly equal: one look into the set per run of voxels.
    if (labels.empty() || label != last) labels.insert(label);
    last = label;
  }
  return {.file = file.filename().string(),
          .dims = volume.frame.dims,
          .spacing_mm = volume.frame.spacing_mm,
          .space = volume.frame.space,
          .output_space = volume.frame.space,
          .labels = {labels.begin(), labels.end()},
          .file_sha256 = sha256_of_file(file),
          .labels_sha256 = sha256_of_values(std::span<const Label>(volume.values))};
}

}  // namespace cvmesh
