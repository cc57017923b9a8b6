// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cvmesh {

/// The input's file name without its suffix (".nii.gz" is one suffix): "a.nii.gz" gives "a".
std::string input_stem(const std::filesystem::path& input);

/// The folder of a run's results and the files in it that belong to this run.
///
/// Either all files of a run stay, or none: `discard()` removes what was written so far. Writers
/// write through temporary names, so no file is ever half there.
class OutputFolder {
 public:
  /// Makes the folder with its parents, tries to write in it, and removes what an earlier run of
  /// the same name left.
  /// @throws Error Output when the folder cannot be made or written
  OutputFolder(std::filesystem::path folder, std::string name);

  /// Path of NAME`suffix`; from now on a file of this run.
  std::filesystem::path add(const std::string& suffix);
  /// Path of stages/`file`, the folder made when needed; from now on a file of this run.
  std::filesystem::path add_stage(const std::string& file);

  /// NAME.failed.json, which `discard()` does not touch.
  [[nodiscard]] std::filesystem::path failure_file() const;

  [[nodiscard]] const std::vector<std::filesystem::path>& files() const { return files_; }

  void discard() noexcept;

 private:
  std::filesystem::path folder_;
  std::string name_;
  std::vector<std::filesystem::path> files_;
};

}  // namespace cvmesh
