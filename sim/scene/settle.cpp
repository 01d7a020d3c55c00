// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/settle.h"

#include <btBulletDynamicsCommon.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "core/types/error.h"
#include "sim/random.h"
#include "sim/scene/mass_properties.h"

namespace fringeslam::sim {

namespace {

// Length of one Bullet unit, m; body sizes should be about one unit.
constexpr double kUnit = 0.1;
// Collision margin around each hull, which absorbs the solver's residual penetration of resting contacts.
constexpr double kMargin = 0.0002 / kUnit;

btVector3 to_bullet(const Eigen::Vector3d& m) {
  const Eigen::Vector3d p = m / kUnit;
  return {static_cast<btScalar>(p.x()), static_cast<btScalar>(p.y()), static_cast<btScalar>(p.z())};
}

Eigen::Vector3d from_bullet(const btVector3& v) {
  return kUnit * Eigen::Vector3d(static_cast<double>(v.x()), static_cast<double>(v.y()), static_cast<double>(v.z()));
}

// A body in Bullet's world, where its origin is the centre of mass.
struct RigidBody {
  std::vector<std::unique_ptr<btConvexHullShape>> hulls;
  btCompoundShape compound;  // used if there are several hulls
  std::unique_ptr<btRigidBody> body;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // centre of mass in the body frame, m
  double radius = 0;                                 // bounding radius about the centre of mass, m

  explicit RigidBody(const Body& from) {
    double volume = 0;
    for (const Hull& hull : from.hulls) {
      const MassProperties bulk = mass_properties_of(hull);
      volume += bulk.volume;
      centre += bulk.volume * bulk.centre;
    }
    if (!(volume > 0)) throw Error("a body without volume cannot be dropped");
    centre /= volume;
    for (const Hull& hull : from.hulls) {
      auto part = std::make_unique<btConvexHullShape>();
      for (const Eigen::Vector3d& p : hull) {
        part->addPoint(to_bullet(p - centre), false);
        radius = std::max(radius, (p - centre).norm());
      }
      part->recalcLocalAabb();
      part->setMargin(static_cast<btScalar>(kMargin));
      btTransform here;
      here.setIdentity();
      compound.addChildShape(here, part.get());
      hulls.push_back(std::move(part));
    }
    compound.setMargin(static_cast<btScalar>(kMargin));
    btCollisionShape& shape = hulls.size() == 1 ? static_cast<btCollisionShape&>(*hulls[0]) : compound;
    const auto mass = static_cast<btScalar>(std::max(1e-3, volume * from.density_kg_m3));
    btVector3 inertia(0, 0, 0);
    shape.calculateLocalInertia(mass, inertia);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, &shape, inertia);
    info.m_friction = static_cast<btScalar>(from.friction);
    info.m_rollingFriction = info.m_spinningFriction = 0.01f;
    info.m_restitution = 0;
    body = std::make_unique<btRigidBody>(info);
    body->setActivationState(DISABLE_DEACTIVATION);
  }

  Pose pose() const {
    const btTransform& at = body->getWorldTransform();
    Pose pose;
    for (int row = 0; row < 3; ++row) {
      for (int col = 0; col < 3; ++col) pose.rotation(row, col) = static_cast<double>(at.getBasis()[row][col]);
    }
    pose.translation = from_bullet(at.getOrigin());
    pose = orthonormalised(pose);
    pose.translation -= pose.rotation * centre;
    return pose;
  }

  // Kinetic energy per unit mass, v^2/2 + w I w/2m, J/kg.
  double energy() const {
    const btVector3 v = body->getLinearVelocity(), w = body->getAngularVelocity();
    const btVector3 spin = body->getWorldTransform().getBasis().transpose() * w;
    const btVector3 inertia = body->getLocalInertia();
    const btScalar turning = (spin * spin * inertia).dot(btVector3(1, 1, 1)) * body->getInvMass();
    return 0.5 * kUnit * kUnit * static_cast<double>(v.length2() + turning);
  }
};

constexpr double kGravity = 9.81 / kUnit;
constexpr double kStep_s = 1.0 / 120;
constexpr int steps_in(double seconds) { return static_cast<int>(seconds / kStep_s + 0.5); }

class PileSimulation {
 public:
  PileSimulation(const std::vector<Body>& bodies, const DropArea& area, uint64_t seed, uint32_t stream = 0)
      : dispatcher_(&configuration_),
        world_(&dispatcher_, &broadphase_, &solver_, &configuration_),
        area_(area),
        random_(seed, Stream::settling, stream) {
    world_.setGravity(btVector3(0, 0, static_cast<btScalar>(-kGravity)));
    dispatcher_.setDispatcherFlags(0);
    world_.getDispatchInfo().m_deterministicOverlappingPairs = true;
    btContactSolverInfo& info = world_.getSolverInfo();
    info.m_numIterations = 30;
    info.m_splitImpulse = 1;
    info.m_splitImpulsePenetrationThreshold = 0;
    info.m_erp2 = 0.3f;
    // With a single friction direction, the default, piles creep and never come to rest.
    info.m_solverMode |= SOLVER_USE_2_FRICTION_DIRECTIONS;
    solver_.setConstraintRowSolverGeneric(solver_.getScalarConstraintRowSolverGeneric());
    solver_.setConstraintRowSolverLowerLimit(solver_.getScalarConstraintRowSolverLowerLimit());
    add_fixed(plane(btVector3(0, 0, 1), 0), btVector3(0, 0, 0));
    if (area.wall_height > 0) {
      const auto x = static_cast<btScalar>(area.size_x / 2 / kUnit), y = static_cast<btScalar>(area.size_y / 2 / kUnit);
      add_wall(btVector3(1, 0, 0), x, y);
      add_wall(btVector3(-1, 0, 0), x, y);
      add_wall(btVector3(0, 1, 0), x, y);
      add_wall(btVector3(0, -1, 0), x, y);
    }
    for (const Body& body : bodies) loose_.push_back(std::make_unique<RigidBody>(body));
  }
  ~PileSimulation() {
    for (const auto& loose : loose_) world_.removeRigidBody(loose->body.get());
    for (const auto& fixed : fixed_) {
      if (fixed->isInWorld()) world_.removeRigidBody(fixed.get());
    }
  }
  PileSimulation(const PileSimulation&) = delete;
  PileSimulation& operator=(const PileSimulation&) = delete;

  Settled run() {
    std::vector<size_t> waiting(loose_.size());
    for (size_t i = 0; i < waiting.size(); ++i) waiting[i] = i;
    Settled settled;
    constexpr int kRounds = 8;
    for (int round = 0; round < kRounds; ++round) {
      raise_drop_walls();
      drop(waiting);
      remove_drop_walls();
      waiting = bodies_not_at_rest();
      if (waiting.empty()) waiting = penetrating_bodies();
      if (waiting.empty()) {
        settled.ground_from_body = poses();
        for (const auto& loose : loose_) settled.energy_j_per_kg = std::max(settled.energy_j_per_kg, loose->energy());
        settled.penetration_m = deepest();
        settled.time_s = time_s_;
        return settled;
      }
      settled.redrop_count += static_cast<int>(waiting.size());
      for (const size_t i : waiting) world_.removeRigidBody(loose_[i]->body.get());
    }
    throw Error(std::to_string(waiting.size()) + " of " + std::to_string(loose_.size()) +
                " bodies do not come to rest without penetration; use fewer or smaller bodies or a larger area");
  }

  // Simulates from the given poses for `seconds` and returns how far each body moves, m.
  std::vector<double> drift(const std::vector<Pose>& ground_from_body, double seconds) {
    for (size_t i = 0; i < loose_.size(); ++i) {
      const Pose& pose = ground_from_body[i];
      btMatrix3x3 turned;
      for (int row = 0; row < 3; ++row) {
        for (int col = 0; col < 3; ++col) turned[row][col] = static_cast<btScalar>(pose.rotation(row, col));
      }
      put(*loose_[i], btTransform(turned, to_bullet(pose * loose_[i]->centre)));
    }
    step_on(seconds);
    return distances_from(ground_from_body);
  }

 private:
  static constexpr double kAllowed = 0.0008;  // penetration, m; below the guaranteed 1 mm
  // Groups of bodies, as bits: those that Bullet knows, and bodies that fall.
  static constexpr int kLoose = btBroadphaseProxy::DefaultFilter, kFixed = btBroadphaseProxy::StaticFilter,
                       kAllButFixed = btBroadphaseProxy::AllFilter ^ kFixed, kFalling = 1 << 6;

  btCollisionShape* plane(const btVector3& normal, btScalar offset) {
    shapes_.push_back(std::make_unique<btStaticPlaneShape>(normal, offset));
    shapes_.back()->setMargin(static_cast<btScalar>(kMargin));
    return shapes_.back().get();
  }
  // Adds a thick box outside the area with its inner side facing `normal`, and an unbounded plane in that side, which
  // exists only while bodies fall.
  void add_wall(const btVector3& normal, btScalar x, btScalar y) {
    constexpr btScalar kThick = 2;
    const auto half_height = static_cast<btScalar>(0.5 * area_.wall_height / kUnit);
    const bool across = normal.x() != 0;
    shapes_.push_back(std::make_unique<btBoxShape>(across ? btVector3(kThick, y + 2 * kThick, half_height)
                                                          : btVector3(x + 2 * kThick, kThick, half_height)));
    shapes_.back()->setMargin(static_cast<btScalar>(kMargin));
    btVector3 centre = -normal * (across ? x + kThick : y + kThick);
    centre.setZ(half_height);
    add_fixed(shapes_.back().get(), centre);
    chute_.push_back(add_fixed(plane(normal, across ? -x : -y), btVector3(0, 0, 0), kFalling));
  }
  btRigidBody* add_fixed(btCollisionShape* shape, const btVector3& centre, int touches = kAllButFixed) {
    btRigidBody::btRigidBodyConstructionInfo info(0, nullptr, shape);
    info.m_startWorldTransform.setOrigin(centre);
    info.m_friction = 0.8f;
    info.m_restitution = 0;
    fixed_.push_back(std::make_unique<btRigidBody>(info));
    world_.addRigidBody(fixed_.back().get(), kFixed, touches);
    return fixed_.back().get();
  }
  void raise_drop_walls() {
    for (btRigidBody* wall : chute_) {
      if (!wall->isInWorld()) world_.addRigidBody(wall, kFixed, kFalling);
    }
  }
  // From now on, what was dropped may lie outside the area: the walls hold only what falls while they stand again.
  void remove_drop_walls() {
    for (btRigidBody* wall : chute_) world_.removeRigidBody(wall);
    for (const auto& loose : loose_) {
      btBroadphaseProxy* proxy = loose->body->getBroadphaseProxy();
      proxy->m_collisionFilterGroup &= ~kFalling;
    }
  }

  void step_on(double seconds) {
    for (int i = 0; i < steps_in(seconds); ++i) step();
  }
  void step() {
    world_.stepSimulation(static_cast<btScalar>(kStep_s), 0);
    time_s_ += kStep_s;
  }

  std::vector<Pose> poses() const {
    std::vector<Pose> result;
    for (const auto& loose : loose_) result.push_back(loose->pose());
    return result;
  }
  // Returns the displacement of each body's centre of mass, m.
  std::vector<double> distances_from(const std::vector<Pose>& ground_from_body) const {
    std::vector<double> distances;
    for (size_t i = 0; i < loose_.size(); ++i) {
      const RigidBody& loose = *loose_[i];
      distances.push_back((loose.pose() * loose.centre - ground_from_body[i] * loose.centre).norm());
    }
    return distances;
  }

  double top() const {
    double highest = 0;
    for (const auto& loose : loose_) {
      if (!loose->body->isInWorld()) continue;
      btVector3 low, high;
      loose->body->getAabb(low, high);
      highest = std::max(highest, kUnit * static_cast<double>(high.z()));
    }
    return highest;
  }

  // Drops the bodies layer by layer: each layer holds as many as fit side by side and starts just above the pile.
  void drop(const std::vector<size_t>& bodies) {
    constexpr int kTries = 20;
    set_gravity(1);
    size_t next = 0;
    while (next < bodies.size()) {
      std::vector<std::pair<Eigen::Vector2d, double>> taken;
      const double above = top();
      for (int attempt = 0; attempt < kTries && next < bodies.size();) {
        RigidBody& loose = *loose_[bodies[next]];
        const auto room = [&](double size) { return std::max(0.0, size / 2 - loose.radius); };
        const Eigen::Vector2d at(random_.uniform(-1, 1) * room(area_.size_x),
                                 random_.uniform(-1, 1) * room(area_.size_y));
        const bool free = std::none_of(taken.begin(), taken.end(), [&](const auto& other) {
          return (other.first - at).norm() < other.second + loose.radius;
        });
        if (!free) {
          ++attempt;
          continue;
        }
        attempt = 0;
        taken.emplace_back(at, loose.radius);
        release(loose, {at.x(), at.y(), above + loose.radius + 0.01});
        ++next;
      }
      step_on(0.2);
    }
  }

  void release(RigidBody& loose, const Eigen::Vector3d& at) {
    // Uniformly distributed random rotation (Shoemake 1992).
    const double u = random_.uniform(), a = 2 * std::numbers::pi * random_.uniform(),
                 b = 2 * std::numbers::pi * random_.uniform();
    const double r1 = std::sqrt(1 - u), r2 = std::sqrt(u);
    const btQuaternion turned(static_cast<btScalar>(r1 * std::sin(a)), static_cast<btScalar>(r1 * std::cos(a)),
                              static_cast<btScalar>(r2 * std::sin(b)), static_cast<btScalar>(r2 * std::cos(b)));
    put(loose, btTransform(turned, to_bullet(at)));
  }

  void put(RigidBody& loose, const btTransform& at) {
    btRigidBody& body = *loose.body;
    body.setWorldTransform(at);
    body.setInterpolationWorldTransform(body.getWorldTransform());
    body.setLinearVelocity(btVector3(0, 0, 0));
    body.setAngularVelocity(btVector3(0, 0, 0));
    body.clearForces();
    body.setDamping(0.2f, 0.5f);
    world_.addRigidBody(&body, kLoose | kFalling, btBroadphaseProxy::AllFilter);
  }

  // Returns the bodies that do not come to rest within a time limit. Bodies creep and rock for long, so they are damped
  // periodically; a body is at rest if it then stays in place under full gravity.
  std::vector<size_t> bodies_not_at_rest() {
    constexpr double kStays = 0.003;  // m per second; resting bodies creep by about 1 mm/s in the solver
    constexpr int kSeconds = 30;
    bool calm = false;
    std::vector<size_t> moving;
    for (int second = 0; second < kSeconds; ++second) {
      const std::vector<Pose> before = poses();
      set_gravity(1);
      step_on(1);
      const std::vector<double> moved = distances_from(before);
      moving = those([&](size_t i) { return moved[i] >= kStays; });
      const bool stayed = moving.empty();
      if (stayed || second % 4 == 3) {
        const std::vector<size_t> stirred = damp_motion();
        if (stayed && stirred.empty() && calm) return {};
        if (stayed) moving = stirred;
      }
      calm = stayed;
    }
    return moving;
  }

  // Increases damping and reduces gravity, of which the solver leaves a residual in each step. Returns the bodies that
  // are still moving afterwards.
  std::vector<size_t> damp_motion() {
    constexpr double kStill = 2e-6;  // J/kg: 2 mm/s
    constexpr int kStillSteps = steps_in(0.25), kMostSteps = steps_in(2);
    std::vector<size_t> stirred;
    int still = 0;
    for (int i = 0; i < kMostSteps && still < kStillSteps; ++i) {
      const double thickness = std::min(1.0, 2 * i * kStep_s);
      slow_down(1 - 0.3 * thickness);
      set_gravity(1 - 0.95 * thickness);
      step();
      const auto stirs = those([&](size_t k) { return loose_[k]->energy() >= kStill; });
      still = stirs.empty() ? still + 1 : 0;
      if (!stirs.empty()) stirred = stirs;
    }
    if (still == kStillSteps) stirred.clear();
    return stirred;
  }

  template <class Is>
  std::vector<size_t> those(const Is& is) const {
    std::vector<size_t> found;
    for (size_t i = 0; i < loose_.size(); ++i) {
      if (is(i)) found.push_back(i);
    }
    return found;
  }

  void set_gravity(double share) {
    for (const auto& loose : loose_) {
      if (loose->body->isInWorld()) loose->body->setGravity(btVector3(0, 0, static_cast<btScalar>(-share * kGravity)));
    }
  }

  void slow_down(double kept) {
    for (const auto& loose : loose_) {
      btRigidBody& body = *loose->body;
      body.setLinearVelocity(static_cast<btScalar>(kept) * body.getLinearVelocity());
      body.setAngularVelocity(static_cast<btScalar>(kept) * body.getAngularVelocity());
    }
  }

  // Calls `visit` with each contact and its penetration depth without the margins, m.
  template <class Visit>
  void visit_contacts(const Visit& visit) {
    for (int i = 0; i < dispatcher_.getNumManifolds(); ++i) {
      const btPersistentManifold* manifold = dispatcher_.getManifoldByIndexInternal(i);
      for (int k = 0; k < manifold->getNumContacts(); ++k) {
        const double gap = static_cast<double>(manifold->getContactPoint(k).getDistance()) + 2 * kMargin;
        visit(*manifold, -kUnit * gap);
      }
    }
  }
  double deepest() {
    double depth = -1;
    visit_contacts([&](const btPersistentManifold&, double d) { depth = std::max(depth, d); });
    return depth;
  }

  // Returns, for each pair of penetrating bodies, the one with the higher index.
  std::vector<size_t> penetrating_bodies() {
    std::vector<size_t> found;
    visit_contacts([&](const btPersistentManifold& manifold, double depth) {
      if (depth < kAllowed) return;
      for (size_t i = loose_.size(); i-- > 0;) {
        const btRigidBody* body = loose_[i]->body.get();
        if (manifold.getBody0() != body && manifold.getBody1() != body) continue;
        if (std::find(found.begin(), found.end(), i) == found.end()) found.push_back(i);
        return;
      }
    });
    std::sort(found.begin(), found.end());
    return found;
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDbvtBroadphase broadphase_;
  btSequentialImpulseConstraintSolver solver_;
  btDiscreteDynamicsWorld world_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::vector<std::unique_ptr<btRigidBody>> fixed_;
  std::vector<btRigidBody*> chute_;  // subset of fixed_ that is in the world only while bodies are dropped
  std::vector<std::unique_ptr<RigidBody>> loose_;
  DropArea area_;
  Philox random_;
  double time_s_ = 0;
};

}  // namespace

Settled settle(const std::vector<Body>& bodies, const DropArea& area, uint64_t seed, uint32_t stream) {
  if (bodies.empty()) return {};
  return PileSimulation(bodies, area, seed, stream).run();
}

std::vector<double> drifts_m(const std::vector<Body>& bodies, const DropArea& area,
                             const std::vector<Pose>& ground_from_body, double seconds) {
  return PileSimulation(bodies, area, 0).drift(ground_from_body, seconds);
}

}  // namespace fringeslam::sim
