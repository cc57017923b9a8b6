// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/run.h"

#include <spdlog/fmt/fmt.h>

namespace cvmesh {

MeshNames names_in_messages(const Run& run) {
  return {[&run](MaterialId m) {
            return m == kExterior ? "the exterior"
                                  : fmt::format("label {} ({})", run.report.label_of[m],
                                                run.report.name_of[m]);
          },
          [&run](const Vec3& p) {
            const Vec3 out = run.mm_to_out(p);
            return fmt::format("({:.5g}, {:.5g}, {:.5g}) mm in {} space", out.x, out.y, out.z,
                               space_name(run.space));
          }};
}

}  // namespace cvmesh
