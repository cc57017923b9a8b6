// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/report/report.h"

#include <nlohmann/json_fwd.hpp>

/// The stats structs as JSON objects: one key per field, of the field's name. nlohmann-json finds
/// these by argument-dependent lookup. Per-material vectors are left out; `report_json` puts them
/// into the entry of their label.
namespace cvmesh {

void to_json(nlohmann::ordered_json& json, const LabelAccount& account);
void to_json(nlohmann::ordered_json& json, const RemovedComponent& component);
/// Without the accounts, which go into the entries of their labels.
void to_json(nlohmann::ordered_json& json, const CleanLabelsStats& stats);
void to_json(nlohmann::ordered_json& json, const ResampleLabelsStats& stats);
void to_json(nlohmann::ordered_json& json, const BuildLevelSetsStats& stats);
void to_json(nlohmann::ordered_json& json, const TightenStats& stats);
void to_json(nlohmann::ordered_json& json, const SurfaceSummary& summary);
void to_json(nlohmann::ordered_json& json, const MedialAxisStats& stats);
void to_json(nlohmann::ordered_json& json, const SizingStats& stats);
void to_json(nlohmann::ordered_json& json, const EpsilonSearch& search);
void to_json(nlohmann::ordered_json& json, const SeedParticlesStats& stats);
void to_json(nlohmann::ordered_json& json, const DistributeParticlesStats& stats);
void to_json(nlohmann::ordered_json& json, const InsertParticlesStats& stats);
void to_json(nlohmann::ordered_json& json, const DecimateStats& stats);
void to_json(nlohmann::ordered_json& json, const EdgeConformity& conformity);
/// The sums; the passes go where their labels are known.
void to_json(nlohmann::ordered_json& json, const ConformEdgesStats& stats);
void to_json(nlohmann::ordered_json& json, const FitVerticesStats& stats);
void to_json(nlohmann::ordered_json& json, const FlipEdgesStats& stats);
void to_json(nlohmann::ordered_json& json, const RemoveNeedlesStats& stats);
void to_json(nlohmann::ordered_json& json, const DelaunayTetsStats& stats);
void to_json(nlohmann::ordered_json& json, const TetrahedralizeStats& stats);
/// The counts; the places go where their labels are known.
void to_json(nlohmann::ordered_json& json, const DihedralAngles& angles);
void to_json(nlohmann::ordered_json& json, const ImproveTetsStats& stats);
void to_json(nlohmann::ordered_json& json, const SecondOrderStats& stats);

void to_json(nlohmann::ordered_json& json, const SplitContactsStats& stats);
void to_json(nlohmann::ordered_json& json, const SamplingSummary& summary);
void to_json(nlohmann::ordered_json& json, const ParticleCounts& counts);
void to_json(nlohmann::ordered_json& json, const MeshCounts& counts);
void to_json(nlohmann::ordered_json& json, const Distribution& distribution);
void to_json(nlohmann::ordered_json& json, const TetQuality& quality);
void to_json(nlohmann::ordered_json& json, const TriangleQuality& quality);
void to_json(nlohmann::ordered_json& json, const MeshQuality& quality);
void to_json(nlohmann::ordered_json& json, const VolumeError& volume);
void to_json(nlohmann::ordered_json& json, const Checks& checks);
void to_json(nlohmann::ordered_json& json, const TetFaults& faults);
void to_json(nlohmann::ordered_json& json, const JudgedMesh& judged);
void to_json(nlohmann::ordered_json& json, const GateResult& gate);

}  // namespace cvmesh
