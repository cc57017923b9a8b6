// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/output_folder.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/feb_writer.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/io/msh_writer.h"
#include "cvmesh/io/surface_parts.h"
#include "cvmesh/pipeline/stage_names.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <system_error>

namespace cvmesh {

namespace fs = std::filesystem;

namespace {

constexpr char kStageSuffix[] = ".stages";
constexpr char kFailureSuffix[] = ".failed.json";
constexpr std::array kResultSuffixes = {".metrics.json", ".vtu", ".mesh", ".surface.vtp",
                                        ".report.html"};

/// Files whose suffix people give to files of their own: those of an earlier run say so near their
/// beginning.
struct MarkedFile {
  const char* suffix;
  std::string_view mark;
};

constexpr std::array<MarkedFile, 4> kMarkedFiles = {
    {{".inp", kInpFirstLine}, {".msh", kMshMark}, {".v22.msh", kMshMark}, {".feb", kFebMark}}};
/// The marks are in the first lines.
constexpr std::size_t kMarkWithin = 200;
constexpr std::array kStageFiles = {"dense.off",     "medial_axis.vtp", "sizing_field.vtp",
                                    "particles.vtp", "augmented.off",   "sparse.off"};

/// Tells now, rather than after the long work, that the folder is read-only or full.
void check_writable(const fs::path& folder) {
  const fs::path probe = folder / ".cvmesh-write-test";
  AtomicFile(probe).commit();
  std::error_code ignored;
  fs::remove(probe, ignored);
}

bool begins_with_mark(const fs::path& file, std::string_view mark) {
  std::string head(kMarkWithin, '\0');
  std::ifstream stream(file, std::ios::binary);
  stream.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head.find(mark) != std::string::npos;
}

/// Surfaces of single labels and interfaces, in the order of their names.
std::vector<fs::path> surface_parts_of(const fs::path& stem) {
  std::error_code ignored;
  std::vector<fs::path> found;
  const std::string name = stem.filename().string();
  for (fs::directory_iterator entry(stem.parent_path(), ignored), end; entry != end;
       entry.increment(ignored))
    if (is_surface_part_file(entry->path().filename().string(), name))
      found.push_back(entry->path());
  std::sort(found.begin(), found.end());
  return found;
}

fs::path with_suffix(const fs::path& stem, const std::string& suffix) {
  return fs::path(stem) += suffix;
}

/// Results of an earlier run of that name.
std::vector<fs::path> results_of(const fs::path& stem) {
  std::vector<fs::path> results;
  std::error_code ignored;
  for (const char* suffix : kResultSuffixes)
    if (fs::exists(with_suffix(stem, suffix), ignored))
      results.push_back(with_suffix(stem, suffix));
  for (const MarkedFile& file : kMarkedFiles)
    if (begins_with_mark(with_suffix(stem, file.suffix), file.mark))
      results.push_back(with_suffix(stem, file.suffix));
  const std::vector<fs::path> parts = surface_parts_of(stem);
  results.insert(results.end(), parts.begin(), parts.end());
  for (const char* file : kStageFiles)
    if (fs::exists(with_suffix(stem, kStageSuffix) / file, ignored))
      results.push_back(with_suffix(stem, kStageSuffix) / file);
  return results;
}

/// Removes a folder with nothing in it; whatever else has its name stays.
void remove_if_empty(const fs::path& folder) {
  std::error_code ignored;
  if (fs::is_directory(fs::symlink_status(folder, ignored))) fs::remove(folder, ignored);
}

[[noreturn]] void refuse_overwrite(const fs::path& file) {
  throw Error(ErrorCode::Output, stage_names::kWrite,
              "'" + file.string() +
                  "' is there already; give --force to replace the results of an earlier run, or "
                  "choose another --out");
}

}  // namespace

std::string input_stem(const fs::path& input) {
  fs::path name = input.filename();
  if (name.extension() == ".gz") name = name.stem();
  return name.stem().string();
}

OutputFolder::OutputFolder(fs::path folder, std::string name, const OutputPlan& plan)
    : folder_(std::move(folder)), name_(std::move(name)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  require(!error && fs::is_directory(folder_, error), ErrorCode::Output, stage_names::kWrite,
          "the output folder '" + folder_.string() + "' cannot be made" +
              (error ? ": " + error.message() : ", a file of that name is there") +
              "; choose another one");
  check_writable(folder_);
  std::error_code ignored;
  const std::vector<fs::path> old_files = results_of(folder_ / name_);
  if (!plan.replace) {
    if (!old_files.empty()) refuse_overwrite(old_files.front());
    for (const std::string& suffix : plan.suffixes)
      if (fs::exists(with_suffix(folder_ / name_, suffix), ignored))
        refuse_overwrite(with_suffix(folder_ / name_, suffix));
  }
  for (const fs::path& file : old_files)
    fs::remove(file, ignored);
  remove_if_empty(stage_folder());
  fs::remove(failure_file(), ignored);
}

fs::path OutputFolder::add(const std::string& suffix) {
  const std::lock_guard lock(mutex_);
  return files_.emplace_back(folder_ / (name_ + suffix));
}

fs::path OutputFolder::add_stage(const std::string& file) {
  std::error_code error;
  fs::create_directories(stage_folder(), error);
  require(!error, ErrorCode::Output, stage_names::kWrite,
          "the folder '" + stage_folder().string() + "' cannot be made: " + error.message() +
              "; choose another output folder");
  const std::lock_guard lock(mutex_);
  return files_.emplace_back(stage_folder() / file);
}

std::vector<fs::path> OutputFolder::files() const {
  const std::lock_guard lock(mutex_);
  return files_;
}

fs::path OutputFolder::stage_folder() const {
  return folder_ / (name_ + kStageSuffix);
}

fs::path OutputFolder::failure_file() const {
  return folder_ / (name_ + kFailureSuffix);
}

void OutputFolder::discard() noexcept {
  const std::lock_guard lock(mutex_);
  std::error_code ignored;
  for (const fs::path& file : files_)
    fs::remove(file, ignored);
  remove_if_empty(stage_folder());
  files_.clear();
}

void OutputFolder::abandon() noexcept {
  remove_temporaries(stage_folder());
  remove_temporaries(folder_);
  discard();
}

}  // namespace cvmesh
