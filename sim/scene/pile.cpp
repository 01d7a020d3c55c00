// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/pile.h"

#include <cstring>
#include <functional>
#include <map>
#include <numbers>
#include <utility>

#include "core/base/append_bytes.h"
#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "sim/random.h"
#include "sim/scene/cache.h"
#include "sim/scene/draw_item.h"
#include "sim/scene/solid_parts.h"

namespace fringeslam::sim {

namespace {

constexpr size_t kMostCorners = 60;  // per hull

Solid convex(Mesh mesh) {
  Solid solid;
  solid.hulls = {convex_cover(mesh.vertices, kMostCorners)};
  solid.mesh = std::move(mesh);
  return solid;
}

using Size = Eigen::Vector3d;
struct SolidKind {
  std::function<Solid(const Size&, int detail, uint32_t seed, Philox& random)> make;
  double density_kg_m3;
};

const std::map<std::string, SolidKind>& kinds() {
  static const std::map<std::string, SolidKind> all = {
      {"box", {[](const Size& s, int, uint32_t, Philox&) { return box_solid(s); }, 300}},
      {"cylinder",
       {[](const Size& s, int, uint32_t, Philox&) { return convex(cylinder_mesh(s.x() / 2, s.z(), 48)); }, 700}},
      {"sphere", {[](const Size& s, int, uint32_t, Philox&) { return convex(sphere_mesh(s.x() / 2, 4)); }, 700}},
      {"stone",
       {[](const Size& s, int detail, uint32_t seed, Philox&) { return rock_solid(s, detail, 0.25, seed); }, 2600}},
      {"brick", {[](const Size& s, int, uint32_t seed, Philox&) { return brick_solid(s, seed); }, 1800}},
      {"slab", {[](const Size& s, int, uint32_t seed, Philox&) { return slab_solid(s, seed); }, 2400}},
      {"pipe",
       {[](const Size& s, int, uint32_t, Philox&) {
          return pipe_solid(s.x() / 2, std::min(0.3 * s.x(), std::max(0.001, 0.06 * s.x())), s.z(), 48);
        },
        1000}},
      {"plank", {[](const Size& s, int, uint32_t seed, Philox&) { return plank_solid(s, seed); }, 600}},
      {"rebar",
       {[](const Size& s, int, uint32_t seed, Philox& r) {
          return rebar_solid(s.x() / 2, s.z(), r.uniform(0.1, 0.9), seed);
        },
        7800}},
      {"paper",
       {[](const Size& s, int, uint32_t seed, Philox& r) {
          return paper_solid(s.x(), s.y(), r.uniform(0.1, 1.2), seed);
        },
        700}},
      {"carton",
       {[](const Size& s, int, uint32_t seed, Philox&) { return carton_solid(s, 0.3, 0.9 * kPi, seed); }, 400}},
      {"foam", {[](const Size& s, int, uint32_t seed, Philox&) { return foam_solid(s, seed); }, 50}},
      {"arm", {[](const Size& s, int, uint32_t seed, Philox&) { return arm_solid(s.z(), seed); }, 1000}},
      {"wire",
       {[](const Size& s, int, uint32_t seed, Philox& r) {
          return wire_solid(s.x() / 2, s.z(), static_cast<int>(r.uniform(3, 7)), seed);
        },
        7800}},
      {"bag", {[](const Size& s, int, uint32_t seed, Philox&) { return bag_solid(s, seed); }, 200}},
      {"face_mask", {[](const Size& s, int, uint32_t, Philox&) { return convex(face_mask_mesh(s, 40)); }, 500}}};
  return all;
}

// A shape shared by all pieces of one variant.
struct Variant {
  Solid solid;
  std::shared_ptr<const Mesh> mesh;
};

std::shared_ptr<const Variant> make_variant(const PileItem& item, uint64_t seed, uint32_t generator, uint32_t number) {
  Philox random(seed, Stream::shape, generator, number + 1);
  const Eigen::Vector3d size = draw_size(item, random);
  auto variant = std::make_shared<Variant>();
  variant->solid = make_piece(item.kind, size, item.detail, random.seed());
  variant->mesh = std::make_shared<const Mesh>(std::move(variant->solid.mesh));
  return variant;
}

struct Piece {
  const PileItem* item = nullptr;
  std::shared_ptr<const Variant> variant;
};

std::vector<Piece> draw_pieces(const Pile& pile, uint64_t seed, uint32_t generator) {
  Philox random(seed, Stream::placement, generator);
  // Variants in the order of their first use; they are made afterwards, in parallel.
  std::vector<std::pair<const PileItem*, uint32_t>> variants;
  std::map<std::pair<size_t, int>, size_t> known;
  std::vector<std::pair<const PileItem*, size_t>> drawn;
  for (int n = 0; n < pile.count; ++n) {
    const size_t kind = draw_item(pile.items, random);
    const PileItem& item = pile.items[kind];
    const double which = random.uniform();
    const int variant = item.variants == 0 ? n : static_cast<int>(which * item.variants);
    const auto [entry, is_new] = known.try_emplace({kind, variant}, variants.size());
    if (is_new) variants.emplace_back(&item, static_cast<uint32_t>(kind * 1000003 + static_cast<size_t>(variant)));
    drawn.emplace_back(&item, entry->second);
  }
  for (size_t kind = 0; kind < pile.items.size(); ++kind) {
    constexpr size_t kFirstNumber = 500000;  // beyond the numbers of all weighted pieces
    const PileItem& item = pile.items[kind];
    const auto place = static_cast<std::ptrdiff_t>(item.after * pile.count);
    for (int n = 0; n < item.exactly.value_or(0); ++n) {
      drawn.insert(drawn.begin() + place, {&item, variants.size()});
      variants.emplace_back(&item, static_cast<uint32_t>(kind * 1000003 + kFirstNumber + static_cast<size_t>(n)));
    }
  }
  std::vector<std::shared_ptr<const Variant>> made(variants.size());
  for_each_row(static_cast<int>(variants.size()), [&](int i) {
    const auto& [item, number] = variants[static_cast<size_t>(i)];
    made[static_cast<size_t>(i)] = make_variant(*item, seed, generator, number);
  });
  std::vector<Piece> pieces;
  for (const auto& [item, variant] : drawn) pieces.push_back({item, made[variant]});
  return pieces;
}

// --- cache of settled piles, keyed by all inputs of the simulation ---

std::string description(const std::vector<Body>& bodies, const DropArea& area, uint64_t seed, uint32_t stream) {
  std::string bytes = "settled, version 3\n";
  append_bytes(bytes, seed);
  if (stream != 0) append_bytes(bytes, stream);
  for (const double value : {area.size_x, area.size_y, area.wall_height}) append_bytes(bytes, value);
  for (const Body& body : bodies) {
    append_bytes(bytes, body.density_kg_m3);
    append_bytes(bytes, body.friction);
    append_bytes(bytes, body.hulls.size());
    for (const Hull& hull : body.hulls) {
      append_bytes(bytes, hull.size());
      for (const Eigen::Vector3d& p : hull) append_bytes(bytes, std::array<double, 3>{p.x(), p.y(), p.z()});
    }
  }
  return bytes;
}

struct Baked {
  double energy_j_per_kg, penetration_m, time_s;
};

std::string baked(const Settled& settled) {
  std::string bytes;
  append_bytes(bytes, Baked{settled.energy_j_per_kg, settled.penetration_m, settled.time_s});
  for (const Pose& pose : settled.ground_from_body) {
    std::array<double, 12> numbers;
    Eigen::Map<Eigen::Matrix3d>(numbers.data()) = pose.rotation;
    Eigen::Map<Eigen::Vector3d>(numbers.data() + 9) = pose.translation;
    append_bytes(bytes, numbers);
  }
  return bytes;
}

std::optional<Settled> unbaked(const std::string& bytes, size_t bodies) {
  if (bytes.size() != sizeof(Baked) + bodies * sizeof(std::array<double, 12>)) return std::nullopt;
  Baked head;
  std::memcpy(&head, bytes.data(), sizeof head);
  Settled settled;
  settled.energy_j_per_kg = head.energy_j_per_kg;
  settled.penetration_m = head.penetration_m;
  settled.time_s = head.time_s;
  for (size_t i = 0; i < bodies; ++i) {
    std::array<double, 12> numbers;
    std::memcpy(numbers.data(), bytes.data() + sizeof head + i * sizeof numbers, sizeof numbers);
    settled.ground_from_body.push_back(
        {Eigen::Map<const Eigen::Matrix3d>(numbers.data()), Eigen::Map<const Eigen::Vector3d>(numbers.data() + 9)});
  }
  return settled;
}

}  // namespace

const std::vector<std::string>& piece_kinds() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (const auto& [name, kind] : kinds()) result.push_back(name);
    return result;
  }();
  return names;
}

Solid make_piece(const std::string& kind, const Eigen::Vector3d& size, int detail, uint32_t seed) {
  Philox random(seed, Stream::shape, 0xb0d7);
  return kinds().at(kind).make(size, detail, seed, random);
}

PileObjects pile_objects(const Pile& pile, uint64_t seed, uint32_t generator, uint32_t piles_before) {
  const std::vector<Piece> pieces = draw_pieces(pile, seed, generator);
  std::vector<Body> bodies;
  for (const Piece& piece : pieces)
    bodies.push_back({piece.variant->solid.hulls, kinds().at(piece.item->kind).density_kg_m3});

  PileObjects result;
  const std::string content = description(bodies, pile.area, seed, piles_before);
  std::optional<Settled> settled;
  if (const auto stored = cached(content)) settled = unbaked(*stored, bodies.size());
  result.from_cache = settled.has_value();
  if (!settled) {
    settled = settle(bodies, pile.area, seed, piles_before);
    store(content, baked(*settled));
  }
  result.settled = std::move(*settled);
  const Philox textures(seed, Stream::shape, generator, 0);
  for (size_t i = 0; i < pieces.size(); ++i) {
    Object object;
    object.mesh = pieces[i].variant->mesh;
    object.material = pieces[i].item->material;
    object.world_from_object = pile.world_from_area * result.settled.ground_from_body[i];
    object.texture_seed = Philox::seed_from(textures.uniforms(static_cast<uint32_t>(i))[0]);
    result.objects.push_back(std::move(object));
  }
  return result;
}

}  // namespace fringeslam::sim
