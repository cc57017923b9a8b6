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

constexpr char kStageFolder[] = "stages";
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

void remove_surface_parts(const fs::path& folder, const std::string& name) {
  std::error_code ignored;
  std::vector<fs::path> found;
  for (fs::directory_iterator entry(folder, ignored), end; entry != end; entry.increment(ignored))
    if (is_surface_part_file(entry->path().filename().string(), name))
      found.push_back(entry->path());
  for (const fs::path& file : found)
    fs::remove(file, ignored);
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
  for (const MarkedFile& file : kMarkedFiles) {
    const fs::path path = folder_ / (name_ + file.suffix);
    if (begins_with_mark(path, file.mark)) fs::remove(path, ignored);
  }
  remove_surface_parts(folder_, name_);
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
