// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/core/vec3_pair.h"
#include "cvmesh/mesh/shape_tree.h"
#include "cvmesh/metrics/distance_samples.h"
#include "cvmesh/metrics/measured_surfaces.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace cvmesh {

/// Distances from one surface to another: all together, per material and per pair of materials.
struct DirectedDistances {
  DistanceStats overall;
  std::vector<DistanceStats> of_material;  ///< by material id
  std::map<Sides, DistanceStats> of_pair;  ///< pairs on both surfaces
};

/// How a direction is measured. Lengths are in the space of the two surfaces.
struct DirectionOptions {
  double samples_per_square_voxel = 20;
  double max_error = 0.05;   ///< of each maximum
  Vec3 unit_mm{1, 1, 1};     ///< lengths of the space's units along the axes
  Vec3 spacing_mm{1, 1, 1};  ///< of the voxels
};

/// Measures one surface against another, both of flat convex shapes (`measured_surfaces.h`).
///
/// The surface is cut into pieces of about a voxel, and each is sampled. The distance to a convex
/// shape is convex, so that the largest distance of a corner to any one shape bounds the distance
/// of the whole piece from above [Guthe 2005]; the shapes nearest to its centre and corners are
/// tried. Pieces whose bound exceeds the largest distance found by more than the wanted error are
/// halved until none is left.
///
/// A piece counts for all shapes together, for both of its materials and for its pair of them; each
/// of these classes is measured against the target's shapes of the same class. To more shapes no
/// distance is larger: the largest distance to a pair bounds that to its materials, and this that
/// to all shapes.
template <typename From, typename To>
class Direction {
 public:
  /// @param tree  of `to`
  Direction(const From& from,
            const To& to,
            ShapeTree<To> tree,
            std::size_t materials,
            const DirectionOptions& options)
      : from_(from),
        to_(to),
        tree_(std::move(tree)),
        options_(options),
        random_(0, "metrics"),
        kinds_of_material_(materials, 0) {
    for (std::size_t f = 0; f < to.size(); ++f) {
      // Neighbours are mostly of the same pair: one look into the map per run of them.
      if (f == 0 || !(to.sides(f) == to.sides(f - 1))) kinds_of_pair_[to.sides(f)] = 0;
    }
    mark_kinds();
    to_voxels_ = divided_by(options.unit_mm, options.spacing_mm);
    block_ = divided_by({kBlockVox, kBlockVox, kBlockVox}, to_voxels_);
  }

  DirectedDistances measure() {
    DirectedDistances result;
    result.of_material.resize(kinds_of_material_.size());
    if (from_.size() == 0 || to_.size() == 0) return result;
    measure_pieces();
    std::map<Sides, std::vector<PieceId>> pieces_of;
    std::vector<PieceId>* run = nullptr;  // neighbours are mostly of the same pair
    Sides of_run;
    for (std::uint32_t c = 0; c < chunks_.size(); ++c)
      for (std::uint32_t p = 0; p < chunks_[c].pieces.size(); ++p) {
        const Sides sides = sides_of({c, p});
        if (run == nullptr || !(sides == of_run)) {
          of_run = sides;
          run = &pieces_of[sides];
        }
        run->push_back({c, p});
      }

    const auto all = all_of(pieces_of, [](Sides) { return true; });
    if (pieces_of.size() == 1 && kinds_of_pair_.size() == 1 &&
        is_target(pieces_of.begin()->first)) {
      const Sides pair = pieces_of.begin()->first;
      result.overall = result.of_pair[pair] = summarise(all, kAll);
      for (const MaterialId m : {pair.inside, pair.outside})
        if (m != kExterior) result.of_material[m] = result.overall;
      return result;
    }
    // The smaller classes first: what is known of them is a bound for those that hold them.
    for (const auto& [pair, pieces] : pieces_of)
      if (is_target(pair)) result.of_pair[pair] = summarise(pieces, kPair);
    for (std::size_t m = 1; m < result.of_material.size(); ++m) {
      if (kinds_of_material_[m] == 0) continue;
      const auto id = static_cast<MaterialId>(m);
      const auto pieces =
          all_of(pieces_of, [id](Sides s) { return s.inside == id || s.outside == id; });
      if (!pieces.empty()) result.of_material[m] = summarise(pieces, id);
    }
    result.overall = summarise(all, kAll);
    return result;
  }

 private:
  static constexpr std::size_t kChunk = 256;  // shapes that are measured one after the other
  // Longest side of a piece, in voxels: longer ones are bounded worse, shorter ones hold less than
  // a sample.
  static constexpr double kPieceVox = 1.0;
  // Side of the boxes whose pieces share a part of the tree, and of the parts of a large shape that
  // do.
  static constexpr double kBlockVox = 4.0;
  // What a distance is measured to: all shapes, those of the same pair, or those of a material.
  static constexpr std::int32_t kAll = -1, kPair = -2;
  using Hit = typename ShapeTree<To>::Hit;
  using Kinds = typename ShapeTree<To>::Kinds;
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  // The distances of a piece to one class of shapes: attained by a point, and not exceeded by any.
  struct Bounds {
    double attained = 0, upper = 0;
  };

  // A piece keeps one set of samples and bounds where all classes agree, else one for each of:
  // all, inside material, outside material, pair.
  struct Piece {
    std::uint32_t shape = 0;    // of `from_`
    std::uint32_t ordinal = 0;  // among the pieces of the shape
    // Which half of which half: a bit for each cut, the first cut's the highest, under a leading 1.
    std::uint64_t path = 1;
    std::uint32_t first_sample = 0, samples = 0, first_bounds = 0;
    float weight = 0;  // area of one sample
    bool is_split = false;
  };

  struct Chunk {
    std::vector<Piece> pieces;
    std::vector<float> distances;
    std::vector<Bounds> bounds;
  };

  // Where a class has its largest distance, on a piece of these sides.
  struct Worst {
    Vec3 at;
    Sides sides;
  };

  struct PieceId {
    std::uint32_t chunk, piece;
  };

  // A part of a piece that the search for the maximum looks at.
  struct Part {
    FlatPiece outline;
    Sides sides;
    Bounds bounds;
    Vec3 at;                  // where `attained` is
    std::int64_t shape = -1;  // of its class, near
  };

  // The part of the tree that holds what is nearest to the points of a box that are not farther
  // than `reach` from the nearest.
  struct Around {
    Box3 box;
    double reach = 0;
    typename ShapeTree<To>::Region region;
  };

  // Shapes made ready for many distances: those asked for last, at the places of their numbers.
  class ReadyShapes {
   public:
    explicit ReadyShapes(const To& shapes) : shapes_(shapes), ready_(kPlaces), of_(kPlaces, -1) {}

    const typename To::Ready& operator()(std::int64_t shape) {
      const auto place = static_cast<std::size_t>(shape) % kPlaces;
      if (of_[place] != shape) {
        ready_[place] = shapes_.ready(static_cast<std::size_t>(shape));
        of_[place] = shape;
      }
      return ready_[place];
    }

   private:
    static constexpr std::size_t kPlaces = 512;  // a neighbourhood's, and they fit into the cache

    const To& shapes_;
    std::vector<typename To::Ready> ready_;
    std::vector<std::int64_t> of_;
  };

  // Two samples and the shapes nearest to them so far.
  struct SamplePair {
    Vec3Pair point;
    DoublePair squared_distance;
    MaskPair shape;
  };

  // What one thread needs while it measures: where the samples of a piece are and which shapes are
  // nearest to them, of all and of one class; and the last answer for each class.
  struct Scratch {
    explicit Scratch(const To& shapes) : ready(shapes) {}

    Box3 block;  // of the part of the shape around the piece
    std::vector<Vec3> points;
    double span = 0;  // of the first point to the farthest corner
    std::vector<SamplePair> pairs;
    std::vector<Hit> nearest, nearest_of_class;
    Around around;
    ReadyShapes ready;
    std::array<std::int64_t, 4> guess{-1, -1, -1, -1};
    Sides guess_sides;
  };

  // A bit for each pair; where there are more pairs than bits, some share one.
  void mark_kinds() {
    int bit = 0;
    for (auto& [pair, kinds] : kinds_of_pair_) {
      kinds = Kinds{1} << bit++ % std::numeric_limits<Kinds>::digits;
      kinds_of_material_[pair.inside] |= kinds;
      kinds_of_material_[pair.outside] |= kinds;
    }
    if (kinds_of_pair_.size() > 1)
      tree_.mark_kinds([&](std::size_t f) { return kinds_of_pair_.at(to_.sides(f)); });
  }

  [[nodiscard]] Kinds kinds_of(std::int32_t wanted, Sides piece) const {
    if (wanted == kAll) return ShapeTree<To>::kEveryKind;
    return wanted == kPair ? kinds_of_pair_.at(piece) : kinds_of_material_[wanted];
  }

  [[nodiscard]] bool is_target(Sides pair) const { return kinds_of_pair_.count(pair) > 0; }

  // The class with number 0..3 (all, inside, outside, pair) of a piece, in the words of `matches`.
  static std::int32_t class_of(int number, Sides sides) {
    const std::array<std::int32_t, 4> classes{kAll, sides.inside, sides.outside, kPair};
    return classes[number];
  }

  static bool matches(Sides shape, std::int32_t wanted, Sides piece) {
    if (wanted == kAll) return true;
    if (wanted == kPair) return shape == piece;
    return shape.inside == wanted || shape.outside == wanted;
  }

  [[nodiscard]] bool has_target(std::int32_t wanted, Sides piece) const {
    if (wanted == kAll) return true;
    return wanted == kPair ? is_target(piece)
                           : wanted != kExterior && kinds_of_material_[wanted] != 0;
  }

  [[nodiscard]] Sides sides_of(PieceId id) const {
    return from_.sides(chunks_[id.chunk].pieces[id.piece].shape);
  }

  template <typename Wanted>
  static std::vector<PieceId> all_of(const std::map<Sides, std::vector<PieceId>>& pieces_of,
                                     const Wanted& wanted) {
    std::vector<PieceId> result;
    for (const auto& [pair, pieces] : pieces_of)
      if (wanted(pair)) result.insert(result.end(), pieces.begin(), pieces.end());
    return result;
  }

  // --- pieces ------------------------------------------------------------------------------------

  [[nodiscard]] FlatPiece in_voxels(const FlatPiece& piece) const {
    FlatPiece result = piece;
    for (Vec3& corner : result.corner)
      corner = scaled_by(corner, to_voxels_);
    return result;
  }

  // Cuts a part of a shape in halves until they are no longer than a length, and calls
  // visit(outline, path) for them, always in the same order.
  template <typename Visit>
  void cut(const FlatPiece& outline,
           std::uint64_t path,
           double longest_vox,
           const Visit& visit) const {
    if (longest_side_vox(outline) <= longest_vox * (1 + 1e-9)) {
      visit(outline, path);
      return;
    }
    const auto [first, second] = halves(outline);
    cut(first, path << 1, longest_vox, visit);
    cut(second, path << 1 | 1, longest_vox, visit);
  }

  [[nodiscard]] double longest_side_vox(const FlatPiece& piece) const {
    double squared = 0;
    for (int k = 0; k < piece.corners; ++k)
      squared = std::max(
          squared, squared_norm(scaled_by(piece.corner[(k + 1) % piece.corners] - piece.corner[k],
                                          to_voxels_)));
    return std::sqrt(squared);
  }

  [[nodiscard]] FlatPiece outline_of(const Piece& piece) const {
    FlatPiece result = from_.piece(piece.shape);
    for (int bit = std::bit_width(piece.path) - 2; bit >= 0; --bit)
      result = halves(result)[piece.path >> bit & 1];
    return result;
  }

  void measure_pieces() {
    chunks_.resize((from_.size() + kChunk - 1) / kChunk);
    parallel_for_each_index(
        0, chunks_.size(),
        [&](std::size_t c) {
          Scratch scratch(to_);
          const std::size_t end = std::min(from_.size(), (c + 1) * kChunk);
          for (std::size_t shape = c * kChunk; shape < end; ++shape) {
            Piece piece;
            piece.shape = static_cast<std::uint32_t>(shape);
            cut(from_.piece(shape), 1, kBlockVox, [&](const FlatPiece& block, std::uint64_t at) {
              scratch.block = box_of(block);
              cut(block, at, kPieceVox, [&](const FlatPiece& outline, std::uint64_t path) {
                piece.path = path;
                measure_piece(outline, piece, chunks_[c], scratch);
                ++piece.ordinal;
              });
            });
          }
        },
        1);
  }

  void measure_piece(const FlatPiece& outline, Piece piece, Chunk& chunk, Scratch& scratch) const {
    const double wanted = options_.samples_per_square_voxel * in_voxels(outline).area();
    piece.samples = static_cast<std::uint32_t>(std::max(1.0, std::ceil(wanted)));
    piece.weight = static_cast<float>(outline.area() / piece.samples);
    piece.first_sample = static_cast<std::uint32_t>(chunk.distances.size());
    piece.first_bounds = static_cast<std::uint32_t>(chunk.bounds.size());
    place_samples(outline, piece, scratch.points);
    scratch.span = farthest_corner(outline, scratch.points.front());

    const Sides sides = from_.sides(piece.shape);
    if (!(scratch.guess_sides == sides)) scratch.guess = {scratch.guess[0], -1, -1, -1};
    scratch.guess_sides = sides;
    find_nearest(scratch.guess[0], scratch);
    store(outline, scratch.nearest, scratch, chunk);
    piece.is_split = std::any_of(scratch.nearest.begin(), scratch.nearest.end(),
                                 [&](const Hit& hit) { return !(to_.sides(hit.shape) == sides); });
    for (int number = 1; piece.is_split && number < 4; ++number) {
      const std::int32_t wanted_class = class_of(number, sides);
      if (!has_target(wanted_class, sides)) {
        chunk.bounds.emplace_back();
        chunk.distances.resize(chunk.distances.size() + piece.samples, 0);
        continue;
      }
      find_nearest_of_class(wanted_class, sides, scratch.guess[number], scratch);
      store(outline, scratch.nearest_of_class, scratch, chunk);
    }
    chunk.pieces.push_back(piece);
  }

  // Low-discrepancy points that fill the piece: the R2 sequence [Roberts 2018], started at a random
  // place for each piece, so that every point of the surface is as likely as any other.
  void place_samples(const FlatPiece& outline,
                     const Piece& piece,
                     std::vector<Vec3>& points) const {
    constexpr double kPlastic = 1.32471795724474602596;
    constexpr double kStepU = 1 / kPlastic, kStepV = 1 / (kPlastic * kPlastic);
    const auto fraction = [](double x) { return x - std::floor(x); };
    const double u = random_.uniform(piece.shape, 2ULL * piece.ordinal);
    const double v = random_.uniform(piece.shape, 2ULL * piece.ordinal + 1);
    points.clear();
    for (std::uint32_t s = 0; s < piece.samples; ++s)
      points.push_back(outline.point(fraction(u + s * kStepU), fraction(v + s * kStepV)));
  }

  [[nodiscard]] Hit nearest(const Vec3& p,
                            std::int32_t wanted,
                            Sides sides,
                            std::int64_t guess) const {
    if (wanted == kAll) return tree_.nearest(p, guess, is_any);
    return tree_.nearest(
        p, guess, [&](std::size_t shape) { return matches(to_.sides(shape), wanted, sides); },
        kinds_of(wanted, sides));
  }

  // The shapes nearest to the samples of a piece. All samples are measured to one shape after the
  // other: to the one that was nearest to the last piece, then to those of the tree that may be
  // nearer to any of them. The part of the tree where they are serves the pieces around too.
  void find_nearest(std::int64_t& guess, Scratch& scratch) const {
    pair_samples(scratch);
    Box3 box;  // a good deal smaller than the piece's own
    for (const Vec3& p : scratch.points)
      box.add(p);
    Around& around = scratch.around;
    double farthest2 = guess < 0 ? kInfinity : measure_to(guess, scratch);
    const auto search_around = [&] {
      tree_.for_each_near(around.region, box, farthest2, [&](std::uint32_t shape) {
        return farthest2 = measure_to(shape, scratch);
      });
    };
    const bool is_around = around.box.contains(box.lo) && around.box.contains(box.hi);
    if (is_around) search_around();
    if (!is_around || !(std::sqrt(farthest2) <= around.reach)) {
      const Hit hit = tree_.nearest(scratch.points.front(), guess, is_any);
      farthest2 = measure_to(hit.shape, scratch);
      around.box = widened(scratch.block);
      around.reach = std::sqrt(farthest2) + std::min({block_.x, block_.y, block_.z}) / 4;
      tree_.find_region(around.box, around.reach, around.region);
      search_around();
    }
    scratch.nearest.clear();
    for (std::size_t s = 0; s < scratch.points.size(); ++s) {
      const SamplePair& pair = scratch.pairs[s / 2];
      scratch.nearest.push_back({pair.squared_distance[s % 2], pair.shape[s % 2]});
    }
    guess = scratch.nearest.back().shape;
  }

  // Two and two; the last is its own neighbour where their number is odd.
  static void pair_samples(Scratch& scratch) {
    const std::vector<Vec3>& points = scratch.points;
    scratch.pairs.resize((points.size() + 1) / 2);
    for (std::size_t i = 0; i < scratch.pairs.size(); ++i) {
      SamplePair& pair = scratch.pairs[i];
      pair.point = {points[2 * i], points[std::min(2 * i + 1, points.size() - 1)]};
      pair.squared_distance = both(kInfinity);
      pair.shape = MaskPair{-1, -1};
    }
  }

  // Measures all samples to one more shape; the largest of the squared distances to the nearest.
  static double measure_to(std::int64_t shape, Scratch& scratch) {
    const typename To::Ready& ready = scratch.ready(shape);
    DoublePair farthest2{};
    for (SamplePair& pair : scratch.pairs) {
      const DoublePair d2 = ready.squared_distance(pair.point);
      const MaskPair is_nearer = d2 < pair.squared_distance;
      pair.squared_distance = is_nearer ? d2 : pair.squared_distance;
      pair.shape = is_nearer ? MaskPair{shape, shape} : pair.shape;
      farthest2 = larger_of(farthest2, pair.squared_distance);
    }
    return std::max(farthest2[0], farthest2[1]);
  }

  // A box that reaches into what comes next where the shape is small.
  [[nodiscard]] Box3 widened(Box3 box) const {
    const Vec3 extent = box.extent();
    for (int axis = 0; axis < 3; ++axis) {
      const double more = std::max(0.0, block_[axis] - extent[axis]) / 2;
      box.lo[axis] -= more;
      box.hi[axis] += more;
    }
    return box;
  }

  static Box3 box_of(const FlatPiece& outline) {
    Box3 box;
    for (int k = 0; k < outline.corners; ++k)
      box.add(outline.corner[k]);
    return box;
  }

  static bool is_any(std::size_t) { return true; }

  // The shapes of a class nearest to the samples: those of all shapes where they are of the class.
  void find_nearest_of_class(std::int32_t wanted,
                             Sides sides,
                             std::int64_t& guess,
                             Scratch& scratch) const {
    scratch.nearest_of_class.clear();
    for (std::size_t s = 0; s < scratch.points.size(); ++s) {
      Hit hit = scratch.nearest[s];
      if (!matches(to_.sides(hit.shape), wanted, sides))
        hit = nearest(scratch.points[s], wanted, sides, guess);
      guess = hit.shape;
      scratch.nearest_of_class.push_back(hit);
    }
  }

  // Keeps the distances of a piece's samples. No point of the piece is farther than the first
  // sample by more than its distance from it, nor farther than a corner from any one shape.
  static void store(const FlatPiece& outline,
                    const std::vector<Hit>& hits,
                    Scratch& scratch,
                    Chunk& chunk) {
    Bounds bounds{0, std::min(std::sqrt(hits.front().squared_distance) + scratch.span,
                              farthest(outline, scratch.ready(hits.front().shape)))};
    for (const Hit& hit : hits) {
      const double d = std::sqrt(hit.squared_distance);
      chunk.distances.push_back(static_cast<float>(d));
      bounds.attained = std::max(bounds.attained, d);
    }
    chunk.bounds.push_back(bounds);
  }

  static double farthest_corner(const FlatPiece& outline, const Vec3& p) {
    double squared = 0;
    for (int k = 0; k < outline.corners; ++k)
      squared = std::max(squared, squared_norm(outline.corner[k] - p));
    return std::sqrt(squared);
  }

  // The largest distance of a point of a piece to one shape: a corner's, as both are convex.
  static double farthest(const FlatPiece& outline, const typename To::Ready& shape) {
    const auto& [a, b, c, d] = outline.corner;
    const DoublePair squared =
        larger_of(shape.squared_distance({a, b}), shape.squared_distance({c, d}));
    return std::sqrt(std::max(squared[0], squared[1]));
  }

  // --- statistics --------------------------------------------------------------------------------

  // Which of a piece's sets of samples and bounds holds a class.
  [[nodiscard]] std::uint32_t set_of(const Piece& piece, std::int32_t wanted) const {
    if (!piece.is_split || wanted == kAll) return 0;
    if (wanted == kPair) return 3;
    return from_.sides(piece.shape).inside == wanted ? 1 : 2;
  }

  DistanceStats summarise(const std::vector<PieceId>& pieces, std::int32_t wanted) {
    std::vector<SampleRun> runs(pieces.size());
    parallel_for_each_index(0, pieces.size(), [&](std::size_t i) {
      const Chunk& chunk = chunks_[pieces[i].chunk];
      const Piece& piece = chunk.pieces[pieces[i].piece];
      const std::size_t first = piece.first_sample + set_of(piece, wanted) * piece.samples;
      runs[i] = {{chunk.distances.data() + first, piece.samples}, piece.weight};
    });
    DistanceStats stats = sample_stats(runs);
    find_maximum(pieces, wanted, stats);
    pass_on(pieces, wanted, stats);
    stats.worst_mm = scaled_by(stats.worst_mm, options_.unit_mm);
    return stats;
  }

  // Bounds the distances of the classes that hold this one, and keeps the place for them to try.
  void pass_on(const std::vector<PieceId>& pieces,
               std::int32_t wanted,
               const DistanceStats& stats) {
    if (wanted == kAll) return;
    worst_of_classes_.push_back({stats.worst_mm, stats.worst_sides});
    const double upper = stats.max + stats.max_error;
    for (const PieceId id : pieces) {
      Chunk& chunk = chunks_[id.chunk];
      const Piece& piece = chunk.pieces[id.piece];
      const std::uint32_t sets = piece.is_split && wanted == kPair ? 3 : 1;
      for (std::uint32_t set = 0; set < sets; ++set) {
        Bounds& bounds = chunk.bounds[piece.first_bounds + set];
        bounds.upper = std::min(bounds.upper, upper);
      }
    }
  }

  [[nodiscard]] const Bounds& bounds_of(PieceId id, std::int32_t wanted) const {
    const Chunk& chunk = chunks_[id.chunk];
    const Piece& piece = chunk.pieces[id.piece];
    return chunk.bounds[piece.first_bounds + set_of(piece, wanted)];
  }

  // The point of a measured piece where its largest distance to a class was found.
  [[nodiscard]] Part worst_part(PieceId id, std::int32_t wanted) const {
    const Piece& piece = chunks_[id.chunk].pieces[id.piece];
    Part part = whole(id, wanted);
    std::vector<Vec3> points;
    place_samples(part.outline, piece, points);
    for (const Vec3& p : points)
      look_at(p, wanted, part);
    return part;
  }

  [[nodiscard]] Part whole(PieceId id, std::int32_t wanted) const {
    const Piece& piece = chunks_[id.chunk].pieces[id.piece];
    return {outline_of(piece), from_.sides(piece.shape), {0, bounds_of(id, wanted).upper}, {}, -1};
  }

  // Takes into account what the distance at one point of a part says about all of it.
  void look_at(const Vec3& p, std::int32_t wanted, Part& part) const {
    const Hit hit = nearest(p, wanted, part.sides, part.shape);
    part.shape = hit.shape;
    part.bounds.upper = std::min(part.bounds.upper, farthest(part.outline, to_.ready(hit.shape)));
    const double d = std::sqrt(hit.squared_distance);
    if (d <= part.bounds.attained) return;
    part.bounds.attained = d;
    part.at = p;
  }

  static void take_if_farther(const Part& part, DistanceStats& stats) {
    if (part.bounds.attained <= stats.max) return;
    take(part, stats);
  }

  static void take(const Part& part, DistanceStats& stats) {
    stats.max = part.bounds.attained;
    stats.worst_mm = part.at;
    stats.worst_sides = part.sides;
  }

  // Branch and bound: parts whose bound is too high are halved until none is left. In blocks of
  // pieces, since two surfaces that are nearly the same must be cut finely everywhere.
  void find_maximum(const std::vector<PieceId>& pieces,
                    std::int32_t wanted,
                    DistanceStats& stats) const {
    constexpr std::size_t kBlock = 8192;
    PieceId worst = pieces.front();
    for (const PieceId id : pieces)
      if (bounds_of(id, wanted).attained > bounds_of(worst, wanted).attained) worst = id;
    take(worst_part(worst, wanted), stats);
    try_worst_of_classes(wanted, stats);
    double upper = stats.max;  // of all that is settled
    for (std::size_t begin = 0; begin < pieces.size(); begin += kBlock) {
      std::vector<Part> open;
      for (std::size_t i = begin; i < std::min(pieces.size(), begin + kBlock); ++i) {
        const Bounds& bounds = bounds_of(pieces[i], wanted);
        if (bounds.upper <= stats.max) continue;
        open.push_back(whole(pieces[i], wanted));
      }
      look_at_centres(open, wanted, stats);
      while (true) {
        open = settle(open, stats, upper);
        if (open.empty()) break;
        open = halves_of(open);
        look_at_centres(open, wanted, stats);
      }
    }
    stats.max_error = std::max(0.0, upper - stats.max);
  }

  // The classes that this one holds have mostly found its largest distance already.
  void try_worst_of_classes(std::int32_t wanted, DistanceStats& stats) const {
    if (wanted == kPair) return;
    for (const Worst& worst : worst_of_classes_) {
      if (!matches(worst.sides, wanted, worst.sides)) continue;
      const double d = std::sqrt(nearest(worst.at, wanted, worst.sides, -1).squared_distance);
      if (d <= stats.max) continue;
      stats.max = d;
      stats.worst_mm = worst.at;
      stats.worst_sides = worst.sides;
    }
  }

  static std::vector<Part> halves_of(const std::vector<Part>& open) {
    std::vector<Part> parts;
    parts.reserve(2 * open.size());
    for (const Part& part : open)
      for (const FlatPiece& half : halves(part.outline))
        parts.push_back({half, part.sides, {0, part.bounds.upper}, {}, part.shape});
    return parts;
  }

  void look_at_centres(std::vector<Part>& parts, std::int32_t wanted, DistanceStats& stats) const {
    // Surfaces that coincide are within the error everywhere: no maximum below it is looked for.
    const double found = std::max(stats.max, options_.max_error);
    parallel_for_each_index(
        0, parts.size(),
        [&](std::size_t i) {
          Part& part = parts[i];
          look_at(part.outline.centre(), wanted, part);
          // A part that may hold the maximum: it is at a corner more often than not.
          for (int k = 0; k < part.outline.corners && part.bounds.upper > found; ++k)
            look_at(part.outline.corner[k], wanted, part);
        },
        64);
    for (const Part& part : parts)
      take_if_farther(part, stats);
  }

  // The parts that may exceed what is found by more than the error.
  [[nodiscard]] std::vector<Part> settle(const std::vector<Part>& parts,
                                         const DistanceStats& stats,
                                         double& upper) const {
    std::vector<Part> rest;
    for (const Part& part : parts) {
      if (part.bounds.upper > stats.max + options_.max_error)
        rest.push_back(part);
      else
        upper = std::max(upper, part.bounds.upper);
    }
    return rest;
  }

  const From& from_;
  const To& to_;
  ShapeTree<To> tree_;
  DirectionOptions options_;
  CounterRandom random_;
  Vec3 to_voxels_, block_;
  std::map<Sides, Kinds> kinds_of_pair_;  // in the target
  std::vector<Kinds> kinds_of_material_;  // in the target; 0: not there
  std::vector<Chunk> chunks_;
  std::vector<Worst> worst_of_classes_;  // of those that are done
};

}  // namespace cvmesh
