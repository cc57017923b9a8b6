// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/pipeline/decimate_and_conform.h"

#include "support/catch.h"
#include <array>
#include <string>
#include <utility>
#include <vector>

using namespace cvmesh;

namespace {

/// A tet of a material in the exterior, as a valid result.
ConformEdgesResult tet(const Vec3& corner, MaterialId material = 1) {
  ConformEdgesResult result;
  result.mesh.points = {corner, corner + Vec3{4, 0, 0}, corner + Vec3{0, 4, 0},
                        corner + Vec3{0, 0, 4}};
  result.mesh.facets = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  result.mesh.patch_of.assign(4, {{material, 0}});
  result.samples.resize(4);
  result.stats.passes = {{{material, 0}, {.edges = 6, .vertices_differing = {}, .obstacle = {}}}};
  return result;
}

/// Both in one result.
ConformEdgesResult joined(ConformEdgesResult a, const ConformEdgesResult& b) {
  const auto offset = static_cast<std::int32_t>(a.mesh.points.size());
  a.mesh.points.insert(a.mesh.points.end(), b.mesh.points.begin(), b.mesh.points.end());
  for (auto facet : b.mesh.facets) {
    for (auto& v : facet)
      v += offset;
    a.mesh.facets.push_back(facet);
  }
  a.mesh.patch_of.insert(a.mesh.patch_of.end(), b.mesh.patch_of.begin(), b.mesh.patch_of.end());
  a.stats.passes.insert(a.stats.passes.end(), b.stats.passes.begin(), b.stats.passes.end());
  return a;
}

/// The message of the error that a result gives; empty when there is none.
std::string refusal(const ConformEdgesResult& result) {
  try {
    const std::array<int, 3> label_of{0, 7, 9};
    const MeshNames names{[&](MaterialId m) {
                            return m == kExterior ? "the exterior"
                                                  : "label " + std::to_string(label_of.at(m));
                          },
                          {}};
    require_conformal(result, names, label_of.size());
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::StageFailed);
    return error.what();
  }
  return {};
}

constexpr char kWayOut[] = "; set schedule to \"lock-step\", or lower epsilon";

}  // namespace

TEST_CASE("require_conformal: a valid surface passes", "[pipeline][unit]") {
  CHECK(refusal(tet({0, 0, 0})).empty());
  CHECK(refusal(joined(tet({0, 0, 0}), tet({9, 0, 0}, 2))).empty());
}

TEST_CASE("require_conformal: messages name count, labels, place and way out", "[pipeline][unit]") {
  ConformEdgesResult edges = joined(tet({0, 0, 0}), tet({9, 0, 0}, 2));
  edges.stats.passes[1].result.edges_not_flippable = 3;
  edges.stats.passes[1].result.obstacle = Vec3{1, 2, 3.5};
  CHECK(refusal(edges) ==
        std::string("edge conformity: 3 edges cannot be flipped to those of the master and 0 "
                    "vertices stayed in one boundary only, on the interfaces of 1 pairs of labels, "
                    "the first between the exterior and label 9 at (1, 2, 3.5) mm") +
            kWayOut);

  CHECK(
      refusal(joined(tet({0, 0, 0}), tet({1, 1, 1}, 2)))
          .find(
              "pairs of facets intersect, which come from boundaries that were thinned out apart: "
              "the first between the exterior and label 7 and between the exterior and label 9 at "
              "(") != std::string::npos);

  // A second interface gets the edges of a facet, and another facet of the same vertices.
  ConformEdgesResult shared = tet({0, 0, 0});
  shared.mesh.facets.push_back({0, 1, 2});
  shared.mesh.patch_of.push_back({{2, 1}});
  CHECK(refusal(shared).find("6 edges have other than two facets of a material, because two "
                             "interfaces got the same edge, the first between ") !=
        std::string::npos);

  ConformEdgesResult flat = tet({0, 0, 0});
  flat.mesh.points[3] = {2, 2, 0};
  const std::string message = refusal(flat);
  CHECK(message.find("the joined surfaces are not valid") != std::string::npos);
  CHECK(message.find(kWayOut) != std::string::npos);
}
