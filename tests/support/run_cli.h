// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <sys/types.h>
#include <vector>

namespace cvmesh::run_cli {

/// How a command ended.
struct Outcome {
  int exit_code = -1;  ///< 128+n when signal n killed it
  std::string out, err;
};

/// What a process starts with besides its arguments.
struct Surroundings {
  std::map<std::string, std::string> environment{};  ///< besides the caller's own
  std::size_t largest_file_bytes = 0;                ///< RLIMIT_FSIZE; 0: as the caller's
  std::filesystem::path standard_output{};           ///< empty: kept for the outcome
};

/// A running cvmesh executable whose output goes into a folder of its own.
class Process {
 public:
  explicit Process(const std::vector<std::string>& arguments,
                   const Surroundings& surroundings = {});
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void send_signal(int signal) const;
  Outcome wait();

 private:
  std::filesystem::path folder_;
  pid_t pid_ = -1;
};

/// Runs `cvmesh arguments...` to its end.
Outcome cvmesh(const std::vector<std::string>& arguments, const Surroundings& surroundings = {});

}  // namespace cvmesh::run_cli
