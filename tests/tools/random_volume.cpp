// SPDX-License-Identifier: AGPL-3.0-or-later

// Writes the random label volume of a seed; for scripts/acceptance/random_volumes.py.
#include "support/random_volumes.h"
#include "support/volume_file.h"
#include <cstdlib>
#include <iostream>

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: cvmesh-random-volume SEED FILE.nii\n";
    return 2;
  }
  const auto random = cvmesh::random_volumes::make(std::strtoull(argv[1], nullptr, 10));
  cvmesh::write_volume_file(argv[2], random.volume);
  std::cout << random.description() << "\n";
}
