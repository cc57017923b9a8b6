// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/volume_file.h"

#include "io/image_files.h"

namespace cvmesh {

void write_volume_file(const std::filesystem::path& path, const InputVolume& volume) {
  constexpr int kInt32 = 8;
  const GridFrame& frame = volume.frame;
  image_files::Nifti file;
  file.dim = {3, frame.dims[0], frame.dims[1], frame.dims[2], 1, 1, 1, 1};
  file.pixdim = {1, frame.spacing_mm.x, frame.spacing_mm.y, frame.spacing_mm.z, 1, 1, 1, 1};
  file.datatype = kInt32;
  file.s_form = frame.index_to_world;
  file.voxels = image_files::bytes_of_all(volume.values);
  const bool is_gzip = path.extension() == ".gz";
  image_files::write_file(path, is_gzip ? image_files::gzip(file.bytes()) : file.bytes());
}

}  // namespace cvmesh
