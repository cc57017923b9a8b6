// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string_view>

/// The files that the HTML report is put together from, embedded by the build: those of
/// `report/html/`, and the libraries of the 3-D view from their packages.
namespace cvmesh::html_parts {

extern const std::string_view kPage;           ///< report.html, with a marker for every part
extern const std::string_view kStyle;          ///< report.css
extern const std::string_view kCharts;         ///< charts.js
extern const std::string_view kViewer;         ///< viewer.js
extern const std::string_view kReport;         ///< report.js
extern const std::string_view kThree;          ///< three.js, minified
extern const std::string_view kOrbitControls;  ///< its camera control

}  // namespace cvmesh::html_parts
