// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/itk_volume_io.h"

#include <itkMetaImageIO.h>
#include <itkNrrdImageIO.h>
#include <itkVersion.h>

#include <iostream>
#include <sstream>

namespace cvmesh::detail {
namespace {

// MetaIO and ITK narrate on std::cerr and std::cout, which a library must not.
class HeldStreams {
 public:
  HeldStreams() : warnings_(itk::Object::GetGlobalWarningDisplay()) {
    itk::Object::SetGlobalWarningDisplay(false);
    cerr_ = std::cerr.rdbuf(sink_.rdbuf());
    cout_ = std::cout.rdbuf(sink_.rdbuf());
  }

  ~HeldStreams() {
    std::cerr.rdbuf(cerr_);
    std::cout.rdbuf(cout_);
    itk::Object::SetGlobalWarningDisplay(warnings_);
  }

  HeldStreams(const HeldStreams&) = delete;
  HeldStreams& operator=(const HeldStreams&) = delete;

 private:
  std::ostringstream sink_;
  std::streambuf* cerr_ = nullptr;
  std::streambuf* cout_ = nullptr;
  bool warnings_;
};

bool is_type(itk::IOComponentEnum component, VoxelType type) {
  using Component = itk::IOComponentEnum;
  switch (type) {
    case VoxelType::UInt8:
      return component == Component::UCHAR;
    case VoxelType::Int8:
      return component == Component::CHAR;
    case VoxelType::UInt16:
      return component == Component::USHORT;
    case VoxelType::Int16:
      return component == Component::SHORT;
    case VoxelType::UInt32:
      return component == Component::UINT;
    case VoxelType::Int32:
      return component == Component::INT;
    case VoxelType::UInt64:
      return component == Component::ULONG || component == Component::ULONGLONG;
    case VoxelType::Int64:
      return component == Component::LONG || component == Component::LONGLONG;
    case VoxelType::Float32:
      return component == Component::FLOAT;
    case VoxelType::Float64:
      return component == Component::DOUBLE;
  }
  return false;
}

void read_into(itk::ImageIOBase& io,
               const std::filesystem::path& path,
               const VolumeHeader& header,
               std::vector<unsigned char>& voxels) {
  io.SetFileName(path.string());
  io.ReadImageInformation();
  const unsigned dimensions = io.GetNumberOfDimensions();
  itk::ImageIORegion region(dimensions);
  bool agrees = dimensions >= 3 && io.GetNumberOfComponents() == 1 &&
                is_type(io.GetComponentType(), header.type);
  for (unsigned axis = 0; axis < dimensions; ++axis) {
    const auto size = static_cast<std::uint64_t>(io.GetDimensions(axis));
    const auto expected = axis < 3 ? static_cast<std::uint64_t>(header.frame.dims[axis]) : 1;
    agrees = agrees && size == expected;
    region.SetIndex(axis, 0);
    region.SetSize(axis, size);
  }
  if (!agrees)
    refuse_file(path, "is understood differently by ITK (size or voxel type); save it again");
  io.SetIORegion(region);
  voxels.resize(header.voxel_data_bytes());
  io.Read(voxels.data());
}

}  // namespace

std::string itk_version() {
  return itk::Version::GetITKVersion();
}

std::vector<unsigned char> read_voxels_by_itk(const std::filesystem::path& path,
                                              const VolumeHeader& header,
                                              ItkFormat format) {
  const HeldStreams held;
  std::vector<unsigned char> voxels;
  try {
    if (format == ItkFormat::Meta)
      read_into(*itk::MetaImageIO::New(), path, header, voxels);
    else
      read_into(*itk::NrrdImageIO::New(), path, header, voxels);
  } catch (const itk::ExceptionObject& exception) {
    refuse_file(path, std::string("cannot be read by ITK: ") + exception.GetDescription());
  }
  return voxels;
}

}  // namespace cvmesh::detail
