// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

/// The stages of Algorithm 7.3.1 as logs, reports and progress bars call them, in order.
namespace cvmesh::stage_names {

inline constexpr char kRead[] = "read";
inline constexpr char kLabels[] = "labels";

inline constexpr char kResampling[] = "resampling";
inline constexpr char kLevelSets[] = "level sets";
inline constexpr char kTightening[] = "tightening";
inline constexpr char kDenseSurfaces[] = "dense surfaces";
inline constexpr char kMedialAxis[] = "medial axis";
inline constexpr char kSizingField[] = "sizing field";
inline constexpr char kSeedParticles[] = "seed particles";
inline constexpr char kParticles[] = "particle optimisation";
inline constexpr char kInsertion[] = "insertion";
inline constexpr char kDecimation[] = "decimation";
inline constexpr char kEdgeConformity[] = "edge conformity";  // sequential schedule only
inline constexpr char kVertexFit[] = "vertex fit";
inline constexpr char kEdgeFlipping[] = "edge flipping";
inline constexpr char kDelaunay[] = "Delaunay tetrahedra";  // surface "delaunay" only
inline constexpr char kTetrahedra[] = "tetrahedra";
inline constexpr char kSecondOrder[] = "second-order nodes";  // element_order 2 only
inline constexpr char kMetrics[] = "metrics";
inline constexpr char kContacts[] = "contacts";  // only with contact
inline constexpr char kSampling[] = "sampling";  // only with --sample
inline constexpr char kWrite[] = "write";
inline constexpr char kHtmlReport[] = "HTML report";  // on request only

}  // namespace cvmesh::stage_names
