// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

namespace cvmesh {

/// The input's file name without its suffix (".nii.gz" is one suffix): "a.nii.gz" gives "a".
std::string input_stem(const std::filesystem::path& input);

/// What a run is going to write into its folder.
struct OutputPlan {
  std::vector<std::string> suffixes;  ///< of NAME
  bool replace = false;               ///< files that are there already may go
};

/// The folder of a run's results and the files in it that belong to this run.
///
/// Either all files of a run stay, or none: `discard()` removes what was written so far. Writers
/// write through temporary names, so no file is ever half there. All but the constructor may be
/// called from several threads.
class OutputFolder {
 public:
  /// Makes the folder with its parents, tries to write in it, and removes what an earlier run of
  /// the same name left: its failure file, and where the plan replaces, its results.
  /// @throws Error Output when the folder cannot be made or written, or when there are results of
  ///         that name or other files in the plan's way, and it does not replace
  OutputFolder(std::filesystem::path folder, std::string name, const OutputPlan& plan);

  /// Path of NAME`suffix`; from now on a file of this run.
  std::filesystem::path add(const std::string& suffix);
  /// Path of NAME.stages/`file`, the folder made when needed; from now on a file of this run.
  std::filesystem::path add_stage(const std::string& file);

  /// NAME.failed.json, which `discard()` does not touch.
  [[nodiscard]] std::filesystem::path failure_file() const;

  [[nodiscard]] std::vector<std::filesystem::path> files() const;

  void discard() noexcept;

  /// What `discard()` does, and the temporary files of this process too: for a process that ends
  /// while another thread may still be writing.
  void abandon() noexcept;

 private:
  [[nodiscard]] std::filesystem::path stage_folder() const;

  std::filesystem::path folder_;
  std::string name_;
  mutable std::mutex mutex_;  ///< of `files_`
  std::vector<std::filesystem::path> files_;
};

}  // namespace cvmesh
