// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/run_cli.h"

#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <sys/resource.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>

#ifndef CVMESH_EXECUTABLE
#error "CVMESH_EXECUTABLE must name the cvmesh executable"
#endif

namespace cvmesh::run_cli {

namespace fs = std::filesystem;

namespace {

std::string text_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void redirect(const fs::path& path, int descriptor) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (file < 0 || dup2(file, descriptor) < 0) _exit(126);
  close(file);
}

}  // namespace

Process::Process(const std::vector<std::string>& arguments, const Surroundings& surroundings) {
  std::string name = (fs::temp_directory_path() / "cvmesh-cli-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make " + name);
  folder_ = name;
  std::vector<std::string> words = {CVMESH_EXECUTABLE};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  for (std::string& word : words)
    pointers.push_back(word.data());
  pointers.push_back(nullptr);

  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("cannot fork");
  if (pid_ == 0) {
    const fs::path& output = surroundings.standard_output;
    redirect(output.empty() ? folder_ / "out" : output, STDOUT_FILENO);
    redirect(folder_ / "err", STDERR_FILENO);
    for (const auto& [key, value] : surroundings.environment)
      setenv(key.c_str(), value.c_str(), 1);
    if (const rlim_t bytes = surroundings.largest_file_bytes; bytes > 0) {
      const rlimit limit{bytes, bytes};
      if (setrlimit(RLIMIT_FSIZE, &limit) != 0) _exit(125);
    }
    execv(pointers[0], pointers.data());
    _exit(127);
  }
}

Process::~Process() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

void Process::send_signal(int signal) const {
  kill(pid_, signal);
}

Outcome Process::wait() {
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  Outcome outcome;
  outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  outcome.out = text_of(folder_ / "out");
  outcome.err = text_of(folder_ / "err");
  return outcome;
}

Outcome cvmesh(const std::vector<std::string>& arguments, const Surroundings& surroundings) {
  return Process(arguments, surroundings).wait();
}

}  // namespace cvmesh::run_cli
