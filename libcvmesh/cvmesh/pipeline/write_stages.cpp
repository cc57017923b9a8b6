// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/write_stages.h"

#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/surface_writer.h"

#include <vector>

namespace cvmesh {

void write_medial_axis(const std::filesystem::path& path,
                       const MedialAxis& medial_axis,
                       const LabelVolume& labels,
                       const Affine& mm_to_out,
                       Space space) {
  const std::vector<Label> label_of = output_labels(labels);
  std::vector<std::int32_t> label;
  label.reserve(medial_axis.material_of.size());
  for (const MaterialId m : medial_axis.material_of)
    label.push_back(label_of[m]);
  const PointArrays arrays{.doubles = {{"radius_mm", medial_axis.radius_mm}},
                           .integers = {{"label", label}}};
  write_points_vtp(path, medial_axis.points, arrays, mm_to_out, space);
}

void write_sizing_field(const std::filesystem::path& path,
                        const SizingField& sizing_field,
                        const InterfaceMesh& dense,
                        const Affine& mm_to_out,
                        Space space) {
  const PointArrays arrays{
      .doubles = {{"lfs_mm", sizing_field.lfs_mm}, {"h_mm", sizing_field.h_mm}}, .integers = {}};
  write_vertex_field_vtp(path, dense, arrays, mm_to_out, space);
}

void write_particles(const std::filesystem::path& path,
                     const ParticleSet& particles,
                     const Affine& mm_to_out,
                     Space space) {
  std::vector<Vec3> points;
  std::vector<double> h_mm;
  std::vector<std::int32_t> dimension, stratum, is_guard;
  for (const Particle& particle : particles.particles) {
    points.push_back(particle.position);
    h_mm.push_back(particle.h_mm);
    dimension.push_back(particle.dimension);
    stratum.push_back(particle.stratum);
    is_guard.push_back(particle.origin == ParticleOrigin::Optimised ? 0 : 1);
  }
  const PointArrays arrays{
      .doubles = {{"h_mm", h_mm}},
      .integers = {{"dimension", dimension}, {"stratum", stratum}, {"is_guard", is_guard}}};
  write_points_vtp(path, points, arrays, mm_to_out, space);
}

}  // namespace cvmesh
