// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/open_tets.h"

#include "cvmesh/core/id_bits.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/tet_faces.h"

#include <algorithm>
#include <compare>
#include <cstddef>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

namespace cvmesh {
namespace {

using Face = OpenTets::Face;
using Tet = OpenTets::Tet;

constexpr TetScore kGone{std::numeric_limits<double>::infinity(), 1};

Face sorted_face(const Tet& tet, std::size_t k) {
  return sorted(tet_face(tet, k));
}

/// As `==`, which calls a function of the C library for it.
bool are_same(const Face& a, const Face& b) {
  return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

}  // namespace

OpenTets::OpenTets(TetMesh& mesh)
    : mesh_(mesh), tets_(std::move(mesh.tets)), materials_(std::move(mesh.material_of)) {
  connect();
  scores_.resize(tets_.size());
  parallel_for_each_index(0, tets_.size(), [&](std::size_t t) { scores_[t] = score_of(tets_[t]); });
  changed_at_.assign(mesh_.points.size(), clock_);
  stamps_.assign(tets_.size(), 0);
}

/// Faces are sorted by their least vertex at first: the lists of a few dozen then fit into the
/// cache, where one sort of all would go through the memory a score of times.
void OpenTets::connect() {
  struct Record {
    std::int32_t second, third;  // vertices, after the least one
    std::int32_t owner;          // 4 tet + face; kNone for a facet, which so comes first

    auto operator<=>(const Record&) const = default;

    [[nodiscard]] bool is_same_face(const Record& other) const {
      return second == other.second && third == other.third;
    }
  };

  const auto for_each_face = [&](const auto& visit) {
    for (const Face& facet : mesh_.surface.facets)
      visit(sorted(facet), kNone);
    for (std::size_t t = 0; t < tets_.size(); ++t)
      for (std::size_t k = 0; k < 4; ++k)
        visit(sorted_face(tets_[t], k), static_cast<std::int32_t>(4 * t + k));
  };
  const std::size_t points = mesh_.points.size();
  std::vector<std::size_t> end(points + 1, 0);  // of the list of the vertex before
  for_each_face(
      [&](const Face& face, std::int32_t) { ++end[static_cast<std::size_t>(face[0]) + 1]; });
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<Record> records(end.back());
  for_each_face([&](const Face& face, std::int32_t owner) {
    records[end[face[0]]++] = {face[1], face[2], owner};
  });
  neighbours_.assign(tets_.size(), {kNone, kNone, kNone, kNone});
  parallel_for_each_index(0, points, [&](std::size_t v) {
    const std::span<Record> list(
        records.begin() + static_cast<std::ptrdiff_t>(v > 0 ? end[v - 1] : 0),
        records.begin() + static_cast<std::ptrdiff_t>(end[v]));
    std::sort(list.begin(), list.end());
    for (std::size_t i = 0; i + 1 < list.size(); ++i) {
      const std::int32_t s = list[i].owner, t = list[i + 1].owner;
      if (s == kNone || !list[i].is_same_face(list[i + 1])) continue;
      if (i > 0 && list[i - 1].is_same_face(list[i])) continue;  // a facet
      neighbours_[s / 4][s % 4] = t / 4;
      neighbours_[t / 4][t % 4] = s / 4;
    }
  });
  tet_of_.assign(mesh_.points.size(), kNone);
  for (std::size_t t = 0; t < tets_.size(); ++t)
    for (const std::int32_t v : tets_[t])
      tet_of_[v] = static_cast<std::int32_t>(t);
}

void OpenTets::close() {
  std::size_t kept = 0;
  for (std::size_t t = 0; t < tets_.size(); ++t) {
    if (is_removed(static_cast<std::int32_t>(t))) continue;
    tets_[kept] = tets_[t];
    materials_[kept++] = materials_[t];
  }
  tets_.resize(kept);
  materials_.resize(kept);
  mesh_.tets = std::move(tets_);
  mesh_.material_of = std::move(materials_);
  compact_points();
}

void OpenTets::compact_points() {
  std::vector<std::int32_t> new_index(mesh_.points.size(), kNone);
  for (const Tet& tet : mesh_.tets)
    for (const std::int32_t v : tet)
      new_index[v] = 0;
  std::size_t kept = 0;
  for (std::size_t v = 0; v < mesh_.points.size(); ++v) {
    if (!is_on_surface(static_cast<std::int32_t>(v)) && new_index[v] == kNone) continue;
    new_index[v] = static_cast<std::int32_t>(kept);
    mesh_.points[kept++] = mesh_.points[v];
  }
  mesh_.points.resize(kept);
  for (Tet& tet : mesh_.tets)
    for (std::int32_t& v : tet)
      v = new_index[v];
}

void OpenTets::find_star(std::int32_t v, std::vector<std::int32_t>& star) const {
  star.clear();
  if (tet_of_[v] == kNone) return;
  star.push_back(tet_of_[v]);
  // A star holds about 25 tets: looking through them costs less than marks that threads share.
  IdBits bits(star);
  for (std::size_t i = 0; i < star.size(); ++i)
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t n = neighbour(star[i], k);
      if (n == kNone || tet(star[i])[k] == v) continue;
      if (bits.may_hold(n) && std::find(star.begin(), star.end(), n) != star.end()) continue;
      star.push_back(n);
      bits.add(n);
    }
}

void OpenTets::replace(const std::vector<std::int32_t>& removed, const std::vector<Tet>& added) {
  struct Open {
    Face face;
    std::int32_t tet;  // beyond the face, kNone at the surface
    std::size_t place;
  };

  std::vector<Open> open;
  ++stamp_;
  for (const std::int32_t t : removed)
    stamps_[t] = stamp_;
  for (const std::int32_t t : removed)
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t n = neighbour(t, k);
      if (n != kNone && stamps_[n] == stamp_) continue;
      const Face face = sorted_face(tet(t), k);
      std::size_t place = 0;
      if (n != kNone) {
        while (neighbour(n, place) != t || !are_same(sorted_face(tet(n), place), face))
          ++place;
        remember_slot(n);
      }
      open.push_back({face, n, place});
    }
  for (const std::int32_t t : removed) {
    remember_slot(t);
    for (const std::int32_t v : tet(t))
      if (tet_of_[v] != kNone && stamps_[tet_of_[v]] == stamp_) set_hint(v, kNone);
  }
  const MaterialId material = materials_[removed[0]];
  std::vector<std::int32_t> slots = removed;
  while (slots.size() < added.size())
    slots.push_back(new_slot(material));
  for (std::size_t i = added.size(); i < slots.size(); ++i) {
    tets_[slots[i]] = {kNone, kNone, kNone, kNone};
    scores_[slots[i]] = kGone;
    (is_trial_ ? freed_in_trial_ : free_).push_back(slots[i]);
  }
  ++clock_;
  for (std::size_t i = 0; i < added.size(); ++i) {
    const std::int32_t t = slots[i];
    tets_[t] = added[i];
    scores_[t] = score_of(added[i]);
    for (std::size_t k = 0; k < 4; ++k) {
      set_hint(added[i][k], t);
      mark_changed(added[i][k]);
      const Face face = sorted_face(added[i], k);
      const auto match = std::find_if(open.begin(), open.end(),
                                      [&](const Open& o) { return are_same(o.face, face); });
      if (match == open.end()) {
        open.push_back({face, t, k});
        neighbours_[t][k] = kNone;
      } else {
        neighbours_[t][k] = match->tet;
        if (match->tet != kNone) neighbours_[match->tet][match->place] = t;
        *match = open.back();
        open.pop_back();
      }
    }
  }
}

std::int32_t OpenTets::find_facet(const Face& face) const {
  if (!is_on_surface(face[0]) || !is_on_surface(face[1]) || !is_on_surface(face[2])) return kNone;
  const Face wanted = sorted(face);
  for (const std::int32_t f : facets_of_[face[0]])
    if (sorted(mesh_.surface.facets[f]) == wanted) return f;
  return kNone;
}

int OpenTets::count_facets_at(std::int32_t v, std::int32_t w) const {
  const auto& facets = facets_of_[v];
  return static_cast<int>(std::count_if(facets.begin(), facets.end(), [&](std::int32_t f) {
    const Face& corners = mesh_.surface.facets[f];
    return std::find(corners.begin(), corners.end(), w) != corners.end();
  }));
}

void OpenTets::set_facet(std::int32_t facet, const Face& corners) {
  Face& now = mesh_.surface.facets[facet];
  if (is_trial_) facets_before_.push_back({facet, now});
  for (const std::int32_t v : now)
    std::erase(facets_of_[v], facet);
  now = corners;
  for (const std::int32_t v : now)
    facets_of_[v].push_back(facet);
}

void OpenTets::find_facets_at_points() {
  if (!facets_of_.empty()) return;
  facets_of_.resize(mesh_.surface.points.size());
  for (std::size_t f = 0; f < mesh_.surface.facets.size(); ++f)
    for (const std::int32_t v : mesh_.surface.facets[f])
      facets_of_[v].push_back(static_cast<std::int32_t>(f));
}

void OpenTets::find_tets_at_facets() {
  find_facets_at_points();
  faces_at_facets_.clear();
  for (std::size_t t = 0; t < tets_.size(); ++t)
    for (std::size_t k = 0; k < 4; ++k)
      if (tets_[t][0] != kNone && neighbours_[t][k] == kNone)
        faces_at_facets_.push_back({sorted_face(tets_[t], k), static_cast<std::int32_t>(t), k});
  parallel_sort(faces_at_facets_.begin(), faces_at_facets_.end(),
                [](const FaceOfTet& a, const FaceOfTet& b) {
                  return are_same(a.face, b.face) ? a.tet < b.tet : a.face < b.face;
                });
}

const OpenTets::FaceOfTet* OpenTets::find_beyond(const Face& face, std::int32_t t) const {
  const Face wanted = sorted(face);
  for (auto found = std::lower_bound(faces_at_facets_.begin(), faces_at_facets_.end(), wanted,
                                     [](const FaceOfTet&a, const Face&f) { return a.face < f; });
       found != faces_at_facets_.end() && found->face == wanted; ++found)
    if (found->tet != t && !is_removed(found->tet) &&
        sorted_face(tet(found->tet), found->place) == wanted &&
        neighbour(found->tet, found->place) == kNone)
      return &*found;
  return nullptr;
}

bool OpenTets::hand_over(std::int32_t t, std::size_t e) {
  const auto [i, j, place_c, place_d] = kEdges[e];
  const Tet corners = tet(t);
  const std::int32_t a = corners[i], b = corners[j], c = corners[place_c], d = corners[place_d];
  if (!is_on_surface(c) || !is_on_surface(d)) return false;
  const std::int32_t beside_a = neighbour(t, j), beside_b = neighbour(t, i);  // the faces acd, bcd
  if (neighbour(t, place_c) != kNone || neighbour(t, place_d) != kNone || beside_a == kNone ||
      beside_b == kNone || beside_a == beside_b)
    return false;
  const std::int32_t f = find_facet({a, b, c}), g = find_facet({a, b, d});
  if (f == kNone || g == kNone) return false;
  const PatchKey patch = mesh_.surface.patch_of[f];
  if (!(patch == mesh_.surface.patch_of[g]) || patch.wall != 0 || count_facets_at(a, b) != 2 ||
      count_facets_at(c, d) != 0)
    return false;
  const MaterialId from = materials_[t];
  const MaterialId to = patch.sides.inside == from ? patch.sides.outside : patch.sides.inside;
  const FaceOfTet* beyond_f = find_beyond({a, b, c}, t);
  const FaceOfTet* beyond_g = find_beyond({a, b, d}, t);
  if ((to != kExterior) != (beyond_f != nullptr) || (to != kExterior) != (beyond_g != nullptr))
    return false;

  // The facets run b -> c -> a and a -> d -> b around the quad, or the other way.
  const Face& old = mesh_.surface.facets[f];
  const bool is_forward =
      (old[0] == a && old[1] == b) || (old[1] == a && old[2] == b) || (old[2] == a && old[0] == b);
  set_facet(f, is_forward ? Face{a, d, c} : Face{a, c, d});
  set_facet(g, is_forward ? Face{b, c, d} : Face{b, d, c});

  ++clock_;
  remember_slot(t);
  for (const auto& [n, opposite] : {std::pair(beside_a, j), std::pair(beside_b, i)}) {
    remember_slot(n);
    const Face face = sorted_face(corners, opposite);
    for (std::size_t k = 0; k < 4; ++k)
      if (neighbour(n, k) == t && sorted_face(tet(n), k) == face) neighbours_[n][k] = kNone;
    neighbours_[t][opposite] = kNone;
  }
  for (const std::int32_t v : corners)
    mark_changed(v);
  if (to == kExterior) {
    set_hint(a, beside_a);
    set_hint(b, beside_b);
    set_hint(c, beside_a);
    set_hint(d, beside_a);
    tets_[t] = {kNone, kNone, kNone, kNone};
    scores_[t] = kGone;
    (is_trial_ ? freed_in_trial_ : free_).push_back(t);
    return true;
  }
  materials_[t] = to;
  for (const auto& [beyond, opposite] :
       {std::pair(beyond_f, place_d), std::pair(beyond_g, place_c)}) {
    remember_slot(beyond->tet);
    neighbours_[beyond->tet][beyond->place] = t;
    neighbours_[t][opposite] = beyond->tet;
  }
  return true;
}

std::int32_t OpenTets::add_point(const Vec3& position) {
  mesh_.points.push_back(position);
  tet_of_.push_back(kNone);
  changed_at_.push_back(clock_);
  return static_cast<std::int32_t>(mesh_.points.size() - 1);
}

void OpenTets::move_point(std::int32_t v,
                          const Vec3& position,
                          const std::vector<std::int32_t>& star) {
  if (is_trial_) points_before_.push_back({v, point(v)});
  set_position(v, position);
  ++clock_;
  for (const std::int32_t t : star) {
    remember_slot(t);
    scores_[t] = score_of(tet(t));
    for (const std::int32_t u : tet(t))
      mark_changed(u);
  }
}

void OpenTets::set_position(std::int32_t v, const Vec3& position) {
  mesh_.points[v] = position;
  if (is_on_surface(v)) mesh_.surface.points[v] = position;
}

void OpenTets::begin_trial() {
  is_trial_ = true;
  points_at_trial_ = mesh_.points.size();
}

void OpenTets::keep_trial() {
  free_.insert(free_.end(), freed_in_trial_.begin(), freed_in_trial_.end());
  is_trial_ = false;
  slots_before_.clear();
  points_before_.clear();
  facets_before_.clear();
  hints_before_.clear();
  changes_before_.clear();
  freed_in_trial_.clear();
  taken_in_trial_.clear();
}

void OpenTets::undo_trial() {
  is_trial_ = false;  // what follows is not to be remembered
  for (auto slot = slots_before_.rbegin(); slot != slots_before_.rend(); ++slot) {
    tets_[slot->t] = slot->tet;
    materials_[slot->t] = slot->material;
    neighbours_[slot->t] = slot->neighbours;
    scores_[slot->t] = slot->score;
  }
  for (auto facet = facets_before_.rbegin(); facet != facets_before_.rend(); ++facet)
    set_facet(facet->facet, facet->corners);
  for (auto p = points_before_.rbegin(); p != points_before_.rend(); ++p)
    set_position(p->v, p->position);
  for (auto hint = hints_before_.rbegin(); hint != hints_before_.rend(); ++hint)
    tet_of_[hint->v] = hint->t;
  for (auto change = changes_before_.rbegin(); change != changes_before_.rend(); ++change)
    changed_at_[change->v] = change->time;
  mesh_.points.resize(points_at_trial_);
  tet_of_.resize(points_at_trial_);
  changed_at_.resize(points_at_trial_);
  free_.insert(free_.end(), taken_in_trial_.rbegin(), taken_in_trial_.rend());
  freed_in_trial_.clear();
  keep_trial();
}

std::pair<OpenTets::Poorness, OpenTets::Poorness> OpenTets::compare_trial(double enough) {
  Poorness before{std::numeric_limits<double>::infinity(), 0}, after = before;
  const auto add = [&](double sine, Poorness& poorness) {
    poorness.worst = std::min(poorness.worst, sine);
    const double lack = std::max(0.0, enough - sine);
    poorness.sum += lack * lack;
  };
  ++stamp_;
  for (const SlotBefore& slot : slots_before_) {
    if (stamps_[slot.t] == stamp_) continue;  // the first record is what was before the trial
    stamps_[slot.t] = stamp_;
    add(slot.score.min_sine, before);
    add(scores_[slot.t].min_sine, after);
  }
  return {before, after};
}

void OpenTets::remember_slot(std::int32_t t) {
  if (is_trial_) slots_before_.push_back({t, tets_[t], materials_[t], neighbours_[t], scores_[t]});
}

void OpenTets::set_hint(std::int32_t v, std::int32_t t) {
  if (is_trial_) hints_before_.push_back({v, tet_of_[v]});
  tet_of_[v] = t;
}

void OpenTets::mark_changed(std::int32_t v) {
  if (is_trial_) changes_before_.push_back({v, changed_at_[v]});
  changed_at_[v] = clock_;
}

std::int32_t OpenTets::new_slot(MaterialId material) {
  std::int32_t t = kNone;
  if (free_.empty()) {
    t = static_cast<std::int32_t>(tets_.size());
    tets_.push_back({kNone, kNone, kNone, kNone});
    materials_.push_back(material);
    neighbours_.push_back({kNone, kNone, kNone, kNone});
    scores_.push_back(kGone);
    stamps_.push_back(0);
  } else {
    t = free_.back();
    free_.pop_back();
    materials_[t] = material;
  }
  if (is_trial_) taken_in_trial_.push_back(t);
  remember_slot(t);
  return t;
}

}  // namespace cvmesh
