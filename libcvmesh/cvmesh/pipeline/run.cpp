// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/run.h"

#include <spdlog/fmt/fmt.h>

namespace cvmesh {

MeshNames names_in_messages(const Report& report, const Affine& mm_to_space, Space space) {
  return {[&report](MaterialId m) {
            return m == kExterior
                       ? "the exterior"
                       : fmt::format("label {} ({})", report.label_of[m], report.name_of[m]);
          },
          [mm_to_space, space](const Vec3& p) {
            const Vec3 there = mm_to_space(p);
            return fmt::format("({:.5g}, {:.5g}, {:.5g}) mm in {} space", there.x, there.y, there.z,
                               space_name(space));
          }};
}

MeshNames names_in_messages(const Run& run) {
  return names_in_messages(run.report, run.mm_to_out, run.space);
}

}  // namespace cvmesh
