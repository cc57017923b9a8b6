// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/html_report.h"

#include "cvmesh/core/assert.h"
#include "cvmesh/metrics/histogram.h"
#include "cvmesh/metrics/tet_quality.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/report/html_mesh.h"
#include "cvmesh/report/html_parts.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include <array>
#include <string_view>
#include <utility>

namespace cvmesh {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kRatioBins = 50;
constexpr std::size_t kAngleBins = 90;

Json histogram_json(const Histogram& histogram) {
  return {{"lo", histogram.lo}, {"hi", histogram.hi}, {"weights", histogram.weights}};
}

Json triangle_histograms(const InterfaceMesh& surface) {
  Histogram ratio(0, 1, kRatioBins);
  for (const auto& [a, b, c] : surface.facets)
    ratio.add(triangle_quality(surface.points[a], surface.points[b], surface.points[c]));
  return {{"triangle_ratio", histogram_json(ratio)}};
}

Json tet_histograms(const TetMesh& mesh) {
  Histogram ratio(0, 1, kRatioBins), dihedral(0, 180, kAngleBins);
  for (const auto& [a, b, c, d] : mesh.tets) {
    const TetShape shape =
        tet_shape(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]);
    ratio.add(shape.radius_ratio);
    for (const double angle : shape.dihedral_deg)
      dihedral.add(angle);
  }
  return {{"tet_ratio", histogram_json(ratio)}, {"dihedral_deg", histogram_json(dihedral)}};
}

Json histograms_json(const TetMesh& mesh, const FacetDistances& distances) {
  Json histograms = triangle_histograms(mesh.surface);
  if (!mesh.tets.empty()) histograms.update(tet_histograms(mesh));
  histograms["distance_mm"] = histogram_json(distances.area_mm2);
  return histograms;
}

Json vector_json(const Vec3& v) {
  return {v.x, v.y, v.z};
}

Json data_json(const Report& report,
               const TetMesh& mesh,
               const FacetDistances& distances,
               const HtmlMesh& packed) {
  Json materials = Json::array();
  for (std::size_t m = 0; m < report.label_of.size(); ++m)
    materials.push_back({{"label", report.label_of[m]}, {"name", report.name_of[m]}});
  return {{"report", report_json(report)},
          {"defaults", parameters_to_json(Parameters{})},
          {"materials", materials},
          {"histograms", histograms_json(mesh, distances)},
          {"facet_distance", {{"mean_mm", distances.mean_mm}, {"max_mm", distances.max_mm}}},
          {"mesh",
           {{"lo", vector_json(packed.lo)},
            {"step", vector_json(packed.step)},
            {"tets_left_out", packed.tets_left_out},
            {"arrays", packed.arrays.directory()}}}};
}

/// JSON that may stand inside a script element: without "<" nothing can end the element or open a
/// comment, and only ASCII is left, so that no line separator is either.
std::string script_safe(const Json& json) {
  const std::string text = json.dump(-1, ' ', true, Json::error_handler_t::replace);
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) {
    if (c == '<')
      safe += "\\u003c";
    else
      safe += c;
  }
  return safe;
}

/// The page with a part in the place of each marker, as in `{{style}}`; parts are not searched.
std::string fill(std::string_view page,
                 const std::vector<std::pair<std::string_view, std::string_view>>& parts) {
  std::string filled;
  for (const auto& [marker, part] : parts) {
    const std::size_t place = page.find(marker);
    CVMESH_ASSERT(place != std::string_view::npos);
    filled += page.substr(0, place);
    filled += part;
    page.remove_prefix(place + marker.size());
  }
  filled += page;
  return filled;
}

}  // namespace

std::string html_report(const Report& report,
                        const TetMesh& mesh,
                        const FacetDistances& distances,
                        const Affine& mm_to_out,
                        std::size_t most_tets) {
  const bool with_tets = mesh.tets.size() <= most_tets;
  const HtmlMesh packed = pack_html_mesh(mesh, distances, mm_to_out, with_tets);
  const std::string data = script_safe(data_json(report, mesh, distances, packed));
  const std::string arrays = packed.arrays.base64();
  // In the order of the page.
  return fill(html_parts::kPage, {{"{{style}}", html_parts::kStyle},
                                  {"{{data}}", data},
                                  {"{{arrays}}", arrays},
                                  {"{{three}}", html_parts::kThree},
                                  {"{{orbit_controls}}", html_parts::kOrbitControls},
                                  {"{{charts}}", html_parts::kCharts},
                                  {"{{viewer}}", html_parts::kViewer},
                                  {"{{report}}", html_parts::kReport}});
}

}  // namespace cvmesh
