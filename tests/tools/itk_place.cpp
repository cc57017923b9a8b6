// SPDX-License-Identifier: AGPL-3.0-or-later
//
// Where ITK has the voxels of an image: reads continuous indices "i j k" from the standard input
// and prints the physical point "x y z" of each, in ITK's world (LPS, mm).
//
//   cvmesh-itk-place IMAGE < INDICES
#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <limits>

namespace {

using Image = itk::Image<unsigned char, 3>;

itk::ImageIOBase::Pointer io_for(const std::filesystem::path& path) {
  const std::string suffix = path.extension().string();
  if (suffix == ".mha") return itk::MetaImageIO::New().GetPointer();
  if (suffix == ".nrrd") return itk::NrrdImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: cvmesh-itk-place IMAGE < INDICES\n";
    return 2;
  }
  try {
    const auto reader = itk::ImageFileReader<Image>::New();
    reader->SetImageIO(io_for(argv[1]));
    reader->SetFileName(argv[1]);
    reader->Update();
    const Image* image = reader->GetOutput();
    std::cout.precision(std::numeric_limits<double>::max_digits10);
    itk::ContinuousIndex<double, 3> index;
    while (std::cin >> index[0] >> index[1] >> index[2]) {
      Image::PointType point;
      image->TransformContinuousIndexToPhysicalPoint(index, point);
      std::cout << point[0] << ' ' << point[1] << ' ' << point[2] << '\n';
    }
  } catch (const itk::ExceptionObject& exception) {
    std::cerr << exception << '\n';
    return 1;
  }
  return EXIT_SUCCESS;
}
