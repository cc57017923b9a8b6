// SPDX-License-Identifier: AGPL-3.0-or-later
// Meshes a label volume with the library: consumer LABELS OUT
#include "cvmesh/pipeline/pipeline.h"

#include <cstdio>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  cvmesh::RunRequest request;
  request.input = argv[1];
  request.out_dir = argv[2];
  request.parameters.sizing.epsilon = 2;
  const cvmesh::RunResult result = cvmesh::run_pipeline(request, cvmesh::silent_context());
  std::printf("%zu tets\n", result.report.mesh->tets);
}
