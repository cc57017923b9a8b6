// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"

#include "phantoms/phantoms.h"
#include "phantoms/write_nifti.h"
#include <array>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <map>
#include <string>
#include <vector>

namespace {

using namespace cvmesh;

constexpr char kUsage[] =
    "usage: cvmesh-phantom SHAPE --out FILE.nii.gz [--size SIZE]\n"
    "  SHAPE  femur, body, spheres, torus or plate\n"
    "  SIZE   small, medium, full or a number; voxels per axis grow with it.\n"
    "         femur: 0.24 to 2, small is 60 x 60 x 120 voxels, full 250 x 250 x 500 (default "
    "small)\n"
    "         body: 0.25 to 1, 128 x 128 x 150 to 512 x 512 x 600 voxels (default small, 0.25)\n"
    "         others: 0.5 to 8 (default 1)\n";

struct CommandLine {
  std::string shape, out, size;
};

CommandLine parse(const std::vector<std::string>& words) {
  CommandLine line;
  for (std::size_t n = 0; n < words.size(); ++n) {
    std::string* const value = words[n] == "--out"                        ? &line.out
                               : words[n] == "--size"                     ? &line.size
                               : line.shape.empty() && words[n][0] != '-' ? &line.shape
                                                                          : nullptr;
    require(value != nullptr, ErrorCode::BadParameter, "cvmesh-phantom",
            "unknown argument '" + words[n] + "'; see --help");
    if (value != &line.shape) {
      require(n + 1 < words.size(), ErrorCode::BadParameter, "cvmesh-phantom",
              words[n] + " needs a value; see --help");
      ++n;
    }
    *value = words[n];
  }
  require(!line.shape.empty() && !line.out.empty(), ErrorCode::BadParameter, "cvmesh-phantom",
          "a shape and --out FILE are needed; see --help");
  return line;
}

double parse_size(const CommandLine& line) {
  using Sizes = std::array<double, 3>;  // small, medium, full
  const Sizes sizes = line.shape == "femur"
                          ? Sizes{examples::kSmall, examples::kMedium, examples::kFull}
                      : line.shape == "body" ? Sizes{examples::kMinBodySize, 0.5, 1}
                                             : Sizes{1, 2, 4};
  if (line.size.empty() || line.size == "small") return sizes[0];
  if (line.size == "medium") return sizes[1];
  if (line.size == "full") return sizes[2];
  char* end = nullptr;
  const double size = std::strtod(line.size.c_str(), &end);
  require(end != nullptr && *end == '\0', ErrorCode::BadParameter, "cvmesh-phantom",
          "--size '" + line.size + "' is neither a number nor small, medium or full");
  return size;
}

InputVolume make(const std::string& shape, double size) {
  if (shape == "femur") return examples::femur(size);
  if (shape == "body") return examples::body(size);
  if (shape == "spheres") return examples::spheres(size);
  if (shape == "torus") return examples::torus(size);
  if (shape == "plate") return examples::plate(size);
  throw Error(ErrorCode::BadParameter, "cvmesh-phantom",
              "unknown shape '" + shape + "'; use femur, body, spheres, torus or plate");
}

void print_summary(const InputVolume& volume, const std::string& path) {
  std::map<Label, std::size_t> voxels;
  for (const Label label : volume.values)
    ++voxels[label];
  const auto& dims = volume.frame.dims;
  std::printf("%s: %d x %d x %d voxels\n", path.c_str(), dims[0], dims[1], dims[2]);
  for (const auto& [label, count] : voxels)
    std::printf("  label %d: %zu voxels\n", label, count);
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.empty() || words[0] == "--help" || words[0] == "-h") {
    std::fputs(kUsage, words.empty() ? stderr : stdout);
    return words.empty() ? static_cast<int>(ErrorCode::BadParameter) : 0;
  }
  try {
    const CommandLine line = parse(words);
    const InputVolume volume = make(line.shape, parse_size(line));
    examples::write_nifti(volume, line.out);
    print_summary(volume, line.out);
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return static_cast<int>(error.code());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cvmesh-phantom: %s\n", error.what());
    return static_cast<int>(ErrorCode::Internal);
  }
}
