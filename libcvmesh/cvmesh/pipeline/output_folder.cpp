// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/output_folder.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/pipeline/stage_names.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <system_error>

namespace cvmesh {

namespace fs = std::filesystem;

namespace {

constexpr char kStageFolder[] = "stages";
constexpr char kFailureSuffix[] = ".failed.json";
constexpr std::array kResultSuffixes = {".metrics.json", ".vtu", ".mesh", ".surface.vtp",
                                        ".report.html"};
constexpr char kDeckSuffix[] = ".inp";
constexpr std::array kStageFiles = {"dense.off",     "medial_axis.vtp", "sizing_field.vtp",
                                    "particles.vtp", "augmented.off",   "sparse.off"};

/// Tells now, rather than after the long work, that the folder is read-only or full.
void check_writable(const fs::path& folder) {
  const fs::path probe = folder / ".cvmesh-write-test";
  AtomicFile(probe).commit();
  std::error_code ignored;
  fs::remove(probe, ignored);
}

/// Decks that people write have that suffix, too: an earlier run's file says so in its first line.
bool is_our_deck(const fs::path& file) {
  std::string line;
  std::ifstream stream(file);
  return std::getline(stream, line) && line == kInpFirstLine;
}

}  // namespace

std::string input_stem(const fs::path& input) {
  fs::path name = input.filename();
  if (name.extension() == ".gz") name = name.stem();
  return name.stem().string();
}

OutputFolder::OutputFolder(fs::path folder, std::string name)
    : folder_(std::move(folder)), name_(std::move(name)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  require(!error && fs::is_directory(folder_, error), ErrorCode::Output, stage_names::kWrite,
          "the output folder '" + folder_.string() + "' cannot be made" +
              (error ? ": " + error.message() : ", a file of that name is there") +
              "; choose another one");
  check_writable(folder_);
  std::error_code ignored;
  for (const char* suffix : kResultSuffixes)
    fs::remove(folder_ / (name_ + suffix), ignored);
  const fs::path deck = folder_ / (name_ + kDeckSuffix);
  if (is_our_deck(deck)) fs::remove(deck, ignored);
  for (const char* file : kStageFiles)
    fs::remove(folder_ / kStageFolder / file, ignored);
  fs::remove(folder_ / kStageFolder, ignored);  // only if nothing else is in it
  fs::remove(failure_file(), ignored);
}

fs::path OutputFolder::add(const std::string& suffix) {
  return files_.emplace_back(folder_ / (name_ + suffix));
}

fs::path OutputFolder::add_stage(const std::string& file) {
  std::error_code error;
  fs::create_directories(folder_ / kStageFolder, error);
  require(!error, ErrorCode::Output, stage_names::kWrite,
          "the folder '" + (folder_ / kStageFolder).string() +
              "' cannot be made: " + error.message() + "; choose another output folder");
  return files_.emplace_back(folder_ / kStageFolder / file);
}

fs::path OutputFolder::failure_file() const {
  return folder_ / (name_ + kFailureSuffix);
}

void OutputFolder::discard() noexcept {
  std::error_code ignored;
  for (const fs::path& file : files_)
    fs::remove(file, ignored);
  fs::remove(folder_ / kStageFolder, ignored);
  files_.clear();
}

}  // namespace cvmesh
