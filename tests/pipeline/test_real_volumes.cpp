// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/pipeline.h"

#include "support/catch.h"
#include "support/test_data.h"
#include <string>

using namespace cvmesh;

namespace {

/// A run passes its own checks or throws: every label and component there, topology that of the
/// voxels, surface and tets valid.
void check_run(const std::string& name, double epsilon) {
  const auto input = test_data::file(name);
  if (!input) {
    WARN("skipped: " << name << " is not there; set CVMESH_TEST_DATA");
    return;
  }
  INFO(name << " at epsilon " << epsilon);
  const test_data::TemporaryFolder folder;
  RunRequest request;
  request.input = *input;
  request.out_dir = folder.path();
  request.parameters.sizing.epsilon = epsilon;
  const Report report = run_pipeline(request, silent_context()).report;
  REQUIRE(report.checks);
  CHECK(report.checks->topology_as_lattice14);
  CHECK(report.checks->surface_intersections == 0);
  CHECK(report.checks->tets_are_valid == true);
  for (std::size_t m = 1; m < report.label_of.size(); ++m) {
    INFO("label " << report.label_of[m]);
    CHECK(report.mesh->tets_of[m] > 0);
  }
}

}  // namespace

TEST_CASE("run_pipeline: small real volumes are meshed validly", "[pipeline][property]") {
  check_run("cgal_tiny_420.nii.gz", 1);
  check_run("cgal_tiny_12323.nii.gz", 1);
  check_run("cleaver_spheres.nii.gz", 2);
}

TEST_CASE("run_pipeline: a volume without label 0 fills its box exactly", "[pipeline][property]") {
  const auto input = test_data::file("cleaver_spheres.nii.gz");
  if (!input) {
    WARN("skipped: cleaver_spheres.nii.gz is not there; set CVMESH_TEST_DATA");
    return;
  }
  const test_data::TemporaryFolder folder;
  RunRequest request;
  request.input = *input;
  request.out_dir = folder.path();
  request.parameters.sizing.epsilon = 2;
  const Report report = run_pipeline(request, silent_context()).report;
  double box_mm3 = 1, mesh_mm3 = 0;
  for (int axis = 0; axis < 3; ++axis)
    box_mm3 *= report.input.dims[static_cast<std::size_t>(axis)] * report.input.spacing_mm[axis];
  for (const VolumeError& volume : report.volumes)
    mesh_mm3 += volume.mesh_mm3;
  // Rounding only: the box faces are planes of the mesh.
  CHECK(mesh_mm3 == Approx(box_mm3).epsilon(1e-9));
}

TEST_CASE("run_pipeline: real volumes are meshed validly", "[pipeline][property][slow]") {
  check_run("bunny.nii.gz", 1);
  check_run("bunny.nii.gz", 5);
  check_run("tooth.nii.gz", 3);
  check_run("cleaver_mickey.nii.gz", 2);
  check_run("spine_verse004.nii.gz", 2);
  check_run("torso_niivue.nii.gz", 2);
}
