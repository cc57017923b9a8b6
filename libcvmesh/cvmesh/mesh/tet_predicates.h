// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

namespace cvmesh {

/// Exact sign of the volume of tet abcd: +1 where `volume6` is positive, 0 for a flat tet, -1.
int tet_orientation(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

}  // namespace cvmesh
