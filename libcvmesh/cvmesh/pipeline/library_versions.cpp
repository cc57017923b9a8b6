// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/library_versions.h"

#include "cvmesh/io/itk_volume_io.h"

#include <CGAL/version.h>
#include <nlohmann/json.hpp>
#include <spdlog/version.h>
#include <tbb/version.h>

#include <Eigen/Core>
#include <openssl/opensslv.h>
#include <zlib.h>

namespace cvmesh {

namespace {

std::string dotted(int major, int minor, int patch) {
  return std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(patch);
}

}  // namespace

std::map<std::string, std::string> library_versions() {
  return {{"cgal", CGAL_STR(CGAL_VERSION)},
          {"eigen", dotted(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)},
          {"itk", detail::itk_version()},
          {"nlohmann_json", dotted(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR,
                                   NLOHMANN_JSON_VERSION_PATCH)},
          {"openssl", OPENSSL_VERSION_STR},
          {"spdlog", dotted(SPDLOG_VER_MAJOR, SPDLOG_VER_MINOR, SPDLOG_VER_PATCH)},
          {"tbb", TBB_runtime_version()},
          // The packaged library tells no more of its version than the name of its file does.
          {"tetgen", "1.5"},
          {"zlib", zlibVersion()}};
}

}  // namespace cvmesh
