// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/building.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include "sim/random.h"
#include "sim/scene/furniture.h"
#include "sim/scene/routes.h"

namespace fringeslam::sim {

namespace {

constexpr double kStairSlope = 0.625;  // rise over run, 32 degrees
constexpr double kSlab = 0.2;          // thickness of the upper floors
constexpr double kDoorHeight = 2;
constexpr double kParapet = 0.9;        // height of the wall between gallery and flight
constexpr double kRoomJitter = 0.15;    // of a partition's place, relative to the size of a room
constexpr double kToWall = 0.8;         // the tour's distance from the walls of a room
constexpr double kRubbleMargin = 0.25;  // area along the walls without centres of rubble

struct Area {
  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;
  double square_m() const { return (x1 - x0) * (y1 - y0); }
};

struct Room {
  Area area;
  double corridor_door = 0;  // x
  double next_door = 0;      // y of the door to the next room of the row
};

struct Storey {
  std::vector<Room> left, right;  // at +y and at -y, in the order of x
};

// The building's measures in its frame, whose origin is the end of the lowest corridor.
struct Layout {
  BuildingPlan plan;
  double half = 0;    // of the corridor's width
  double length = 0;  // of the corridor
  double run = 0;     // of a flight
  std::vector<Storey> storeys;

  double floor_z(int storey) const { return storey * plan.storey; }
  double landing() const { return plan.corridor; }  // depth of the landing at the top of a flight
};

std::vector<Room> draw_row(const BuildingPlan& plan, const Area& row, double corridor_y, Philox& random) {
  std::vector<Room> rooms;
  const double size = (row.x1 - row.x0) / plan.rooms;
  double x = row.x0;
  for (int i = 0; i < plan.rooms; ++i) {
    Room room;
    const double shift = i + 1 < plan.rooms ? kRoomJitter * size * random.uniform(-1, 1) : 0;
    room.area = {x, row.x0 + (i + 1) * size + shift, row.y0, row.y1};
    x = room.area.x1;
    // A door keeps half of its width from the nearest corner.
    const auto place = [&](double low, double high) {
      const double margin = std::min(plan.door, 0.5 * (high - low));
      return random.uniform(low + margin, high - margin);
    };
    room.corridor_door = place(room.area.x0, room.area.x1);
    // Doors between rooms stay away from the corridor's wall, so that the tour crosses the room.
    const bool above = row.y0 >= corridor_y;
    const double far = above ? row.y1 : row.y0, near = above ? row.y0 : row.y1;
    room.next_door = near + (far - near) * random.uniform(0.4, 0.65);
    rooms.push_back(room);
  }
  return rooms;
}

Layout draw_layout(const BuildingPlan& plan, uint64_t seed) {
  Layout layout;
  layout.plan = plan;
  layout.half = plan.corridor / 2;
  layout.length = plan.rooms * plan.room_x + 2 * plan.corridor;
  layout.run = plan.storey / kStairSlope;
  const double inner = layout.half, outer = inner + plan.room_y;
  for (int s = 0; s < plan.storeys; ++s) {
    Philox random(seed, Stream::building, static_cast<uint32_t>(s));
    Storey& storey = layout.storeys.emplace_back();
    storey.left = draw_row(plan, {plan.corridor, layout.length - plan.corridor, inner, outer}, 0, random);
    storey.right = draw_row(plan, {0, layout.length, -outer, -inner}, 0, random);
  }
  return layout;
}

// --- objects ---

class Builder {
 public:
  Builder(const Building& building, uint64_t seed)
      : building_(building), seed_(seed), layout_(draw_layout(building.plan, seed)), plan_(building.plan) {}

  std::vector<Object> build() {
    for (int s = 0; s < plan_.storeys; ++s) {
      add_floors(s);
      add_walls(s);
      add_rubble(s);
      if (s + 1 < plan_.storeys) {
        for (const bool at_start : {true, false}) add_stairs(s, at_start);
      }
    }
    return std::move(objects_);
  }

 private:
  void add(Mesh mesh, const Pose& pose, const Material& material) {
    Object object;
    object.mesh = std::make_shared<const Mesh>(std::move(mesh));
    object.world_from_object = pose;
    object.material = material;
    object.texture_seed = Philox(seed_, Stream::shape, kGenerator, static_cast<uint32_t>(objects_.size())).seed();
    objects_.push_back(std::move(object));
  }

  void add_block(const Area& area, double low, double high, const Material& material) {
    const Eigen::Vector3d size(area.x1 - area.x0, area.y1 - area.y0, high - low);
    add(box_mesh(size),
        {Eigen::Matrix3d::Identity(), {(area.x0 + area.x1) / 2, (area.y0 + area.y1) / 2, (low + high) / 2}}, material);
  }

  // The stairwells' outer end.
  double well_end() const { return layout_.run + layout_.landing(); }
  // Mirrors an area at the start of the corridor to its other end.
  Area at_end(const Area& area, bool at_start) const {
    return at_start ? area : Area{layout_.length - area.x1, layout_.length - area.x0, area.y0, area.y1};
  }

  void add_floors(int s) {
    const double z = layout_.floor_z(s), below = z - kSlab;
    const double outer = layout_.half + plan_.room_y, lanes = 3 * layout_.half;
    if (s == 0) {
      add_block({-well_end(), layout_.length + well_end(), -outer, outer}, below, z, building_.floor);
      return;
    }
    add_block({0, layout_.length, -outer, outer}, below, z, building_.floor);
    for (const bool at_start : {true, false}) {
      add_block(at_end({-layout_.run, 0, layout_.half, lanes}, at_start), below, z, building_.floor);
      add_block(at_end({-well_end(), -layout_.run, -layout_.half, lanes}, at_start), below, z, building_.floor);
    }
  }

  // A wall along one axis with openings at the centres of doors; its thickness lies about `across`.
  void add_wall(bool along_x, double from, double to, double across, std::vector<double> doors, double low,
                double high) {
    std::sort(doors.begin(), doors.end());
    const auto part = [&](double a, double b, double bottom) {
      if (b - a < 1e-6 || high - bottom < 1e-6) return;
      const double c0 = across - plan_.wall / 2, c1 = across + plan_.wall / 2;
      add_block(along_x ? Area{a, b, c0, c1} : Area{c0, c1, a, b}, bottom, high, building_.wall);
    };
    double at = from;
    for (const double door : doors) {
      part(at, door - plan_.door / 2, low);
      part(door - plan_.door / 2, door + plan_.door / 2, low + kDoorHeight);
      at = door + plan_.door / 2;
    }
    part(at, to, low);
  }

  void add_walls(int s) {
    const Storey& storey = layout_.storeys[static_cast<size_t>(s)];
    const double low = layout_.floor_z(s), high = low + plan_.storey - kSlab;
    const double inner = layout_.half, outer = inner + plan_.room_y, lanes = 3 * layout_.half;
    for (const std::vector<Room>* row : {&storey.left, &storey.right}) {
      const bool left = row == &storey.left;
      const double side = left ? 1 : -1, x0 = row->front().area.x0, x1 = row->back().area.x1;
      std::vector<double> doors;
      for (const Room& room : *row) doors.push_back(room.corridor_door);
      add_wall(true, x0, x1, side * inner, doors, low, high);
      add_wall(true, x0, x1, side * outer, {}, low, high);
      for (size_t i = 0; i + 1 < row->size(); ++i)
        add_wall(false, (*row)[i].area.y0, (*row)[i].area.y1, (*row)[i].area.x1,
                 left ? std::vector<double>{(*row)[i].next_door} : std::vector<double>{}, low, high);
      for (const double x : {x0, x1}) add_wall(false, row->front().area.y0, row->front().area.y1, x, {}, low, high);
    }
    for (const bool at_start : {true, false}) {
      const auto along = [&](double x0, double x1, double y, double top) {
        const Area area = at_end({x0, x1, 0, 0}, at_start);
        add_wall(true, area.x0, area.x1, y, {}, low, top);
      };
      along(-well_end(), 0, -inner, high);
      along(-well_end(), plan_.corridor, lanes, high);
      const double x = at_start ? -well_end() : layout_.length + well_end();
      add_wall(false, -inner, lanes, x, {}, low, high);
      if (s > 0) along(-layout_.run, 0, inner, low + kParapet);
    }
  }

  int steps() const { return static_cast<int>(std::ceil(plan_.storey / 0.18)); }

  void add_stairs(int s, bool at_start) {
    const double z = layout_.floor_z(s);
    const double centre = at_start ? -layout_.run / 2 : layout_.length + layout_.run / 2;
    // Stairs rise towards +x of their frame.
    const Eigen::Matrix3d turn = rotation_exp({0, 0, at_start ? std::numbers::pi : 0});
    add(stairs_mesh({layout_.run, plan_.corridor, plan_.storey}, steps()), {turn, {centre, 0, z}}, building_.floor);
    // Small rubble that fits onto the treads.
    const double tread = layout_.run / steps(), riser = plan_.storey / steps();
    Scatter scatter = scattered(Area{-0.2 * tread, 0.2 * tread, -0.8 * layout_.half, 0.8 * layout_.half});
    scatter.count = static_cast<int>(std::ceil(building_.rubble_per_m2 * tread * plan_.corridor));
    for (ScatterItem& item : scatter.items) {
      const double shrink = std::min(1.0, 0.55 * tread / item.size_max.head<2>().maxCoeff());
      item.size_min *= shrink;
      item.size_max *= shrink;
    }
    for (int k = 0; k < steps(); ++k) {
      const double out = (k + 0.5) * tread;
      scatter.world_from_area.translation = {at_start ? -out : layout_.length + out, 0, z + (k + 1) * riser};
      add_scatter(scatter, tread_shapes_);
    }
  }

  // A scatter about the centre of an area.
  Scatter scattered(const Area& area) const {
    Scatter scatter;
    scatter.area_x = area.x1 - area.x0;
    scatter.area_y = area.y1 - area.y0;
    scatter.max_height = building_.max_height;
    scatter.items = building_.items;
    scatter.world_from_area.translation = {(area.x0 + area.x1) / 2, (area.y0 + area.y1) / 2, 0};
    return scatter;
  }

  void add_scatter(const Scatter& scatter, ScatterShapes& shapes) {
    if (scatter.count < 1 || scatter.items.empty()) return;
    for (Object& object : scatter_objects(scatter, seed_, kGenerator + 2 + scatters_++, &shapes))
      objects_.push_back(std::move(object));
  }

  void add_rubble(int s) {
    const auto add_to = [&](const Area& area) {
      const Area inside = {area.x0 + kRubbleMargin, area.x1 - kRubbleMargin, area.y0 + kRubbleMargin,
                           area.y1 - kRubbleMargin};
      if (inside.x1 <= inside.x0 || inside.y1 <= inside.y0) return;
      Scatter scatter = scattered(inside);
      scatter.count = static_cast<int>(std::round(building_.rubble_per_m2 * area.square_m()));
      scatter.world_from_area.translation.z() = layout_.floor_z(s);
      add_scatter(scatter, shapes_);
    };
    const Storey& storey = layout_.storeys[static_cast<size_t>(s)];
    for (const std::vector<Room>* row : {&storey.left, &storey.right}) {
      for (const Room& room : *row) add_to(room.area);
    }
    const double lanes = 3 * layout_.half;
    add_to({plan_.corridor, layout_.length - plan_.corridor, -layout_.half, layout_.half});
    for (const bool at_start : {true, false}) {
      add_to(at_end({0, plan_.corridor, -layout_.half, lanes}, at_start));
      if (s == 0) continue;
      add_to(at_end({-layout_.run, 0, layout_.half, lanes}, at_start));
      add_to(at_end({-well_end(), -layout_.run, -layout_.half, lanes}, at_start));
    }
  }

  static constexpr uint32_t kGenerator = 0x40000000;  // beyond the numbers of the scene's objects

  const Building& building_;
  uint64_t seed_;
  Layout layout_;
  const BuildingPlan& plan_;
  ScatterShapes shapes_{seed_, kGenerator}, tread_shapes_{seed_, kGenerator + 1};
  uint32_t scatters_ = 0;
  std::vector<Object> objects_;
};

// --- tour ---

using Path = std::vector<Eigen::Vector3d>;  // corners on the floor

// Appends the way around a room, from a point at its entrance to one at its exit: along a rectangle inside its walls,
// once around and on to the place nearest to the exit.
void go_around(const Area& room, const Eigen::Vector2d& entrance, const Eigen::Vector2d& exit, double z, Path& path) {
  const double inset_x = std::min(kToWall, 0.35 * (room.x1 - room.x0)),
               inset_y = std::min(kToWall, 0.35 * (room.y1 - room.y0));
  const Area loop = {room.x0 + inset_x, room.x1 - inset_x, room.y0 + inset_y, room.y1 - inset_y};
  const std::array<Eigen::Vector2d, 4> corners = {
      Eigen::Vector2d(loop.x0, loop.y0), {loop.x1, loop.y0}, {loop.x1, loop.y1}, {loop.x0, loop.y1}};
  // Returns the side of the rectangle, from corner i to i + 1, nearest to a point, and the place on it.
  const auto nearest = [&](const Eigen::Vector2d& point) {
    std::pair<size_t, Eigen::Vector2d> best;
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d a = corners[i], b = corners[(i + 1) % 4], along = b - a;
      const Eigen::Vector2d foot = a + along * std::clamp((point - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
      if ((foot - point).norm() < least) least = (foot - point).norm(), best = {i, foot};
    }
    return best;
  };
  const auto [first, from] = nearest(entrance);
  const auto [last, to] = nearest(exit);
  const auto add = [&](const Eigen::Vector2d& p) { path.emplace_back(p.x(), p.y(), z); };
  add(from);
  for (size_t i = 1; i <= 4; ++i) add(corners[(first + i) % 4]);
  add(from);
  const bool behind = first == last && (to - corners[first]).norm() < (from - corners[first]).norm() - 1e-9;
  for (size_t side = first, passed = 0; side != last || (behind && passed == 0); side = (side + 1) % 4, ++passed)
    add(corners[(side + 1) % 4]);
  add(to);
}

class TourPath {
 public:
  explicit TourPath(const Layout& layout) : layout_(layout) {}

  Path walk(int laps) {
    const int top = layout_.plan.storeys - 1;
    corridor(kStart, 0);
    for (int lap = 0; lap < laps; ++lap) {
      if (lap > 0) turn_back(true);
      for (int s = 0; s <= top; ++s) {
        visit_left(s);
        visit_right(s);
        if (s < top) take_stairs(s, true);
      }
      for (int s = top; s > 0; --s) take_stairs(s - 1, false);
      if (top == 0) turn_back(false);
      return_through_left();
    }
    return std::move(path_);
  }

 private:
  static constexpr double kStart = 0.7;

  void add(double x, double y, int s) { path_.emplace_back(x, y, layout_.floor_z(s)); }
  void corridor(double x, int s) { add(x, 0, s); }
  const Storey& storey(int s) const { return layout_.storeys[static_cast<size_t>(s)]; }

  // From the corridor into the first room, from room to room, back to the corridor from the last.
  void visit_left(int s) {
    const std::vector<Room>& rooms = storey(s).left;
    corridor(rooms.front().corridor_door, s);
    Eigen::Vector2d entrance(rooms.front().corridor_door, layout_.half);
    add(entrance.x(), entrance.y(), s);
    for (const Room& room : rooms) {
      const Eigen::Vector2d exit = &room == &rooms.back() ? Eigen::Vector2d(room.corridor_door, layout_.half)
                                                          : Eigen::Vector2d(room.area.x1, room.next_door);
      go_around(room.area, entrance, exit, layout_.floor_z(s), path_);
      add(exit.x(), exit.y(), s);
      entrance = exit;
    }
    corridor(rooms.back().corridor_door, s);
  }

  // The way of visit_left() on the lowest storey in the other direction, straight from door to door.
  void return_through_left() {
    const std::vector<Room>& rooms = storey(0).left;
    const Room& last = rooms.back();
    corridor(last.corridor_door, 0);
    add(last.corridor_door, rooms[rooms.size() - 2].next_door, 0);
    for (size_t i = rooms.size() - 1; i-- > 0;) add(rooms[i].area.x1, rooms[i].next_door, 0);
    add(rooms.front().corridor_door, rooms.front().next_door, 0);
    corridor(rooms.front().corridor_door, 0);
    corridor(kStart, 0);
  }

  // A small loop at an end of the lowest corridor, which reverses the direction without turning on the spot.
  void turn_back(bool at_start) {
    const auto x = [&](double halves) {
      return at_start ? halves * layout_.half : layout_.length - halves * layout_.half;
    };
    corridor(x(0.5), 0);
    add(x(0.5), 2 * layout_.half, 0);
    add(x(1.5), 2 * layout_.half, 0);
    corridor(x(1.5), 0);
  }

  void visit_right(int s) {
    const std::vector<Room>& rooms = storey(s).right;
    for (size_t i = rooms.size(); i-- > 0;) {
      const Eigen::Vector2d door(rooms[i].corridor_door, -layout_.half);
      corridor(door.x(), s);
      add(door.x(), door.y(), s);
      go_around(rooms[i].area, door, door, layout_.floor_z(s), path_);
      add(door.x(), door.y(), s);
      corridor(door.x(), s);
    }
  }

  // Between storeys s and s + 1: the flight and the gallery beside it.
  void take_stairs(int s, bool up) {
    const double gallery = 2 * layout_.half, landing = layout_.run + layout_.landing() / 2;
    // Climbed at the start of the corridor, descended at its end.
    const auto x = [&](double out) { return up ? -out : layout_.length + out; };
    Path way;
    const auto at = [&](double out, double y, int storey) { way.emplace_back(x(out), y, layout_.floor_z(storey)); };
    at(-kStart, 0, s);
    at(0, 0, s);
    at(layout_.run, 0, s + 1);
    at(landing, 0, s + 1);
    at(landing, gallery, s + 1);
    at(-layout_.half, gallery, s + 1);
    at(-layout_.half, 0, s + 1);
    if (!up) std::reverse(way.begin(), way.end());
    path_.insert(path_.end(), way.begin(), way.end());
  }

  const Layout& layout_;
  Path path_;
};

// Camera above `floor`, looking along `along` and down.
Pose camera_at(const Eigen::Vector3d& floor, const Eigen::Vector3d& along, const Tour& tour) {
  const Eigen::Vector3d side = along.cross(Eigen::Vector3d::UnitZ()).normalized(), up = side.cross(along);
  return looking_at(floor + tour.height * up, floor + tour.ahead * along, up);
}

}  // namespace

std::vector<Object> building_objects(const Building& building, uint64_t seed) {
  return Builder(building, seed).build();
}

std::vector<Pose> tour_waypoints(const BuildingPlan& plan, const Tour& tour, uint64_t seed) {
  constexpr double kRounding = 0.4;  // a corner begins and ends at this distance from its vertex
  constexpr double kLongest = 1;     // between waypoints
  const Layout layout = draw_layout(plan, seed);
  Path corners;
  for (const Eigen::Vector3d& corner : TourPath(layout).walk(tour.laps)) {
    if (corners.empty() || (corner - corners.back()).norm() > 1e-6) corners.push_back(corner);
  }
  std::vector<Pose> waypoints;
  for (size_t i = 0; i + 1 < corners.size(); ++i) {
    const Eigen::Vector3d from = corners[i], step = corners[i + 1] - from, along = step.normalized();
    const double length = step.norm(), margin = std::min(kRounding, 0.35 * length);
    const double begin = i > 0 ? margin : 0, end = i + 2 < corners.size() ? length - margin : length;
    const int parts = std::max(1, static_cast<int>(std::ceil((end - begin) / kLongest)));
    for (int k = 0; k <= parts; ++k)
      waypoints.push_back(camera_at(from + (begin + (end - begin) * k / parts) * along, along, tour));
  }
  return waypoints;
}

}  // namespace fringeslam::sim
