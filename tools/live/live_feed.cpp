// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_feed.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"
#include "tools/live/access.h"
#include "tools/live/keyframe_points.h"

namespace fringeslam::tools {

namespace {

using nlohmann::ordered_json;

constexpr size_t kRateViews = 8;      // averaging window of the rate
constexpr size_t kReportedViews = 8;  // views whose pictures a viewer can still request
constexpr size_t kOutlineCorners = 48;

// Rounds to six decimals (micrometres): digits make up most of what is sent.
double rounded(double value) { return std::round(value * 1e6) / 1e6; }

ordered_json json_of(const Eigen::Vector3d& position_m) {
  return {rounded(position_m.x()), rounded(position_m.y()), rounded(position_m.z())};
}

ordered_json json_of(const Pose& pose) {
  ordered_json list = json_of(pose.translation);
  for (const double value : quaternion_xyzw(pose.rotation)) list.push_back(rounded(value));
  return list;
}

ordered_json json_of(const WarmObjectMark& mark) {
  return {{"position_m", json_of(mark.position_m)},
          {"radius_m", mark.radius_m},
          {"state", mark.state},
          {"reason", mark.reason},
          {"victim", mark.victim}};
}

// The outline goes from pixel to pixel; a subset of its corners is enough to draw its shape.
ordered_json json_of(const LandmarkOutline& outline) {
  ordered_json corners = ordered_json::array();
  const size_t step = outline.corners_px.size() / kOutlineCorners + 1;
  for (size_t i = 0; i < outline.corners_px.size(); i += step)
    corners.push_back({outline.corners_px[i].x, outline.corners_px[i].y});
  return {{"outline_px", corners}, {"recognised", outline.recognised}};
}

ordered_json json_of(const LiveView& view) {
  const PreviewFigures& figures = view.figures();
  std::vector<std::string> sentences = warnings(figures);
  sentences.insert(sentences.end(), view.warnings.begin(), view.warnings.end());
  ordered_json landmarks = ordered_json::array();
  for (const LandmarkOutline& outline : view.landmarks) landmarks.push_back(json_of(outline));
  return {{"number", view.number()},
          {"index", view.index()},
          {"valid", figures.valid},
          {"saturated", figures.saturated},
          {"mean_modulation_dn", figures.mean_modulation_dn},
          {"brightness", figures.brightness},
          {"full_scale_dn", figures.full_scale_dn},
          {"depth_possible", figures.depth_possible},
          {"warnings", sentences},
          {"landmarks", landmarks}};
}

ordered_json about(const LiveSetup& setup) {
  const Pinhole& camera = setup.rig.camera;
  ordered_json corners = ordered_json::array();
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(camera.width - 1, 0),
        Eigen::Vector2d(camera.width - 1, camera.height - 1), Eigen::Vector2d(0, camera.height - 1)}) {
    const Eigen::Vector2d ray = camera.undistort(pixel);
    corners.push_back({ray.x(), ray.y()});
  }
  return {{"verb", setup.verb},
          {"name", setup.name},
          {"stacks", setup.stacks},
          {"maps", setup.maps},
          {"rig",
           {{"name", setup.rig.name},
            {"width_px", camera.width},
            {"height_px", camera.height},
            {"near_m", setup.rig.near_m},
            {"far_m", setup.rig.far_m},
            {"corners", corners},
            {"robot_from_camera", json_of(setup.rig.robot_from_camera)}}}};
}

std::vector<Eigen::Vector3d> centres_of(const Landmarks& found) {
  std::vector<Eigen::Vector3d> centres;
  for (const Landmark& landmark : found.landmarks) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int k : landmark.keypoints) sum += found.keypoints.keypoints[static_cast<size_t>(k)].point_m;
    if (!landmark.keypoints.empty()) centres.push_back(sum / static_cast<double>(landmark.keypoints.size()));
  }
  return centres;
}

std::vector<LandmarkOutline> outlines_of(const FrameResult& result) {
  std::vector<LandmarkOutline> outlines;
  for (const Landmark& landmark : result.landmarks.landmarks) outlines.push_back({landmark.outline, false});
  for (const Recognition& recognition : result.recognitions)
    outlines[static_cast<size_t>(recognition.landmark)].recognised = true;
  return outlines;
}

// Previews what the pipeline decoded. The images are cloned because the pipeline may reuse its own.
std::function<Preview()> decoded(const FringeStack& stack, const FrameResult& result, const LiveSetup& setup) {
  return
      [stack, &setup, texture = result.frame.texture.clone(), modulation = result.decoded.modulation.clone(),
       depth = result.frame.depth_image.clone()] { return preview_of(stack, setup.rig, texture, modulation, depth); };
}

}  // namespace

// A copy of everything newer, so that it can be serialized without holding the lock.
struct LiveFeed::Changes {
  uint64_t sequence = 0;
  bool finished = false;
  int dropped = 0;
  double views_per_s = 0;
  size_t views_from = 0, keyframes_from = 0;
  std::vector<SeenView> views;
  std::vector<SeenKeyframe> keyframes;
  std::optional<std::vector<WarmObjectMark>> candidates;
  std::shared_ptr<const LiveView> newest;
};

LiveFeed::LiveFeed(LiveSetup setup) : setup_(std::move(setup)), run_(random_token()) {
  rays_ = pixel_rays(setup_.rig.camera);
}

void LiveFeed::show(const FringeStack& stack) {
  const std::lock_guard lock(mutex_);
  auto view = std::make_shared<LiveView>(static_cast<int>(views_.size()) + 1, stack.index, [this, stack] {
    std::call_once(triangulated_, [&] { triangulation_ = preview_triangulation(setup_.sequence, setup_.rig); });
    return preview_of(stack, setup_.sequence, setup_.rig, triangulation_);
  });
  SeenView seen;
  seen.index = stack.index;
  seen.timestamp_s = stack.timestamp_s;
  add(seen, std::move(view));
}

bool LiveFeed::show(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map,
                    const std::function<Trajectory()>& trajectory, int dropped) {
  SeenView seen{0,
                stack.index,
                stack.timestamp_s,
                result.tracking,
                result.relocalized,
                result.loops,
                result.corrected,
                {},
                result.images,
                {}};
  if (result.motion && result.motion->converged) seen.motion = result.motion->motion;
  if (has_pose(result.tracking)) seen.world_from_robot = result.world_from_robot;
  std::function<Preview()> prepare = decoded(stack, result, setup_);
  std::vector<LandmarkOutline> outlines = outlines_of(result);
  std::vector<std::string> sentences = motion_warnings(result);
  const std::lock_guard lock(mutex_);
  auto view = std::make_shared<LiveView>(static_cast<int>(views_.size()) + 1, stack.index, std::move(prepare));
  view->landmarks = std::move(outlines);
  view->warnings = std::move(sentences);
  dropped_ = dropped;
  add(seen, std::move(view));
  const bool moved = take_keyframes(map) || result.corrected;
  if (moved) take_corrections(map, trajectory());
  return moved;
}

void LiveFeed::show_candidates(std::vector<WarmObjectMark> candidates) {
  const std::lock_guard lock(mutex_);
  candidates_ = std::move(candidates);
  candidates_at_ = ++sequence_;
  changed_.notify_all();
}

void LiveFeed::finish() {
  const std::lock_guard lock(mutex_);
  finished_ = true;
  ++sequence_;
  changed_.notify_all();
}

void LiveFeed::add(SeenView seen, std::shared_ptr<const LiveView> view) {
  seen.sequence = ++sequence_;
  views_.push_back(std::move(seen));
  newest_ = std::move(view);
  times_.push_back(Clock::now());
  if (times_.size() > kRateViews) times_.pop_front();
  changed_.notify_all();
}

// Returns true if the frame of a known keyframe was replaced, which moves the rest of the map.
bool LiveFeed::take_keyframes(const KeyframeMap& map) {
  bool replaced = false;
  for (size_t i = 0; i < keyframes_.size(); ++i) {
    const Keyframe& keyframe = map.keyframes()[i];
    if (keyframes_[i].frame.depth_m.data == keyframe.frame.depth_m.data) continue;
    keyframes_[i].landmarks_m = centres_of(*keyframe.landmarks.get());
    keyframes_[i].frame = keyframe.frame;
    ++keyframes_[i].version;
    std::erase_if(points_, [&](const auto& each) { return each.first == static_cast<int>(i); });
    replaced = true;
  }
  for (size_t i = keyframes_.size(); i < map.keyframes().size(); ++i) {
    const Keyframe& keyframe = map.keyframes()[i];
    keyframes_.push_back({sequence_, keyframe.world_from_camera, centres_of(*keyframe.landmarks.get()), keyframe.frame});
  }
  return replaced;
}

void LiveFeed::take_corrections(const KeyframeMap& map, const Trajectory& trajectory) {
  for (size_t i = 0; i < keyframes_.size(); ++i) {
    keyframes_[i].world_from_camera = map.keyframes()[i].world_from_camera;
    keyframes_[i].sequence = sequence_;
  }
  // Views that were recovered later are in the trajectory, too.
  auto tracked = trajectory.begin();
  for (SeenView& view : views_) {
    view.sequence = sequence_;
    if (!view.world_from_robot) continue;
    const auto same = [&](const TimedPose& pose) { return pose.timestamp_s == view.timestamp_s; };
    const auto found = std::find_if(tracked, trajectory.end(), same);
    if (found == trajectory.end()) continue;
    view.world_from_robot = found->world_from_robot;
    tracked = found;
  }
}

std::vector<std::string> LiveFeed::motion_warnings(const FrameResult& result) {
  if (result.motion && !result.motion->converged)
    return {"Moving too fast: the motion during this stack cannot be estimated, so the view is not used. Slow down."};
  if (result.tracking == Tracking::ambiguous)
    return {
        "Several poses explain this view equally well, so it is not in the map. Look at something that does not "
        "repeat."};
  if (!has_pose(result.tracking))
    return {"Tracking is lost: this view is not in the map. Move back to the mapped area, more slowly."};
  return {};
}

LiveFeed::Changes LiveFeed::changed_since(uint64_t since) const {
  // Sequence numbers never decrease along the lists: a correction sets all of them to the same value.
  const auto newer = [since](const auto& list) {
    const auto first =
        std::partition_point(list.begin(), list.end(), [&](const auto& e) { return e.sequence <= since; });
    return static_cast<size_t>(first - list.begin());
  };
  const std::lock_guard lock(mutex_);
  Changes changes;
  changes.sequence = sequence_;
  changes.finished = finished_;
  changes.dropped = dropped_;
  if (times_.size() > 1)
    changes.views_per_s =
        static_cast<double>(times_.size() - 1) / std::chrono::duration<double>(times_.back() - times_.front()).count();
  changes.views_from = newer(views_);
  changes.views.assign(views_.begin() + static_cast<std::ptrdiff_t>(changes.views_from), views_.end());
  changes.keyframes_from = newer(keyframes_);
  changes.keyframes.assign(keyframes_.begin() + static_cast<std::ptrdiff_t>(changes.keyframes_from), keyframes_.end());
  if (since == 0 || candidates_at_ > since) changes.candidates = candidates_;
  if (!changes.views.empty()) changes.newest = newest_;
  if (changes.newest && (reported_.empty() || reported_.back() != newest_)) reported_.push_back(newest_);
  if (reported_.size() > kReportedViews) reported_.pop_front();
  return changes;
}

std::string LiveFeed::changes(const std::string& run, uint64_t since) const {
  if (run != run_) since = 0;
  const Changes changes = changed_since(since);
  ordered_json document{{"run", run_},
                        {"sequence", changes.sequence},
                        {"finished", changes.finished},
                        {"dropped", changes.dropped},
                        {"views_per_s", changes.views_per_s}};
  if (since == 0) document["about"] = about(setup_);
  ordered_json views = ordered_json::array(), keyframes = ordered_json::array();
  for (const SeenView& view : changes.views) {
    ordered_json& entry = views.emplace_back(ordered_json{{"index", view.index}, {"timestamp_s", view.timestamp_s}});
    if (view.tracking) entry["tracking"] = to_string(*view.tracking);
    if (view.relocalized) entry["relocalized"] = true;
    if (view.loops > 0) entry["loops"] = view.loops;
    if (view.corrected) entry["corrected"] = true;
    if (view.images > 0) entry["images"] = view.images;
    if (view.motion) {
      entry["speed_m_s"] = view.motion->velocity_m_s.norm();
      entry["turn_rad_s"] = view.motion->angular_rad_s.norm();
    }
    if (view.world_from_robot) entry["pose"] = json_of(*view.world_from_robot);
  }
  for (const SeenKeyframe& keyframe : changes.keyframes) {
    ordered_json landmarks = ordered_json::array();
    for (const Eigen::Vector3d& centre_m : keyframe.landmarks_m) landmarks.push_back(json_of(centre_m));
    keyframes.push_back({{"pose", json_of(keyframe.world_from_camera)}, {"landmarks", landmarks}});
    if (keyframe.version > 0) keyframes.back()["version"] = keyframe.version;
  }
  document["views"] = {{"from", changes.views_from}, {"list", views}};
  document["keyframes"] = {{"from", changes.keyframes_from}, {"list", keyframes}};
  if (changes.newest) document["newest"] = json_of(*changes.newest);
  if (changes.candidates) {
    document["candidates"] = ordered_json::array();
    for (const WarmObjectMark& candidate : *changes.candidates) document["candidates"].push_back(json_of(candidate));
  }
  return json_text(document);
}

void LiveFeed::await_change(const std::string& run, uint64_t since, std::chrono::milliseconds longest,
                            const std::function<bool()>& give_up) const {
  constexpr auto kAsk = std::chrono::milliseconds(200);
  const auto until = Clock::now() + longest;
  std::unique_lock lock(mutex_);
  while (run == run_ && sequence_ <= since && Clock::now() < until) {
    changed_.wait_for(lock, kAsk);
    lock.unlock();
    if (give_up()) return;
    lock.lock();
  }
}

std::shared_ptr<const LiveView> LiveFeed::view(int number) const {
  const std::lock_guard lock(mutex_);
  for (const auto& view : reported_) {
    if (view->number() == number) return view;
  }
  return nullptr;
}

bool LiveFeed::had_view(int number) const {
  const std::lock_guard lock(mutex_);
  return number > 0 && static_cast<size_t>(number) <= views_.size();
}

std::optional<std::string> LiveFeed::points_of(int keyframe) const {
  constexpr size_t kKept = 16;
  const auto kept = [&] {
    return std::find_if(points_.begin(), points_.end(), [&](const auto& each) { return each.first == keyframe; });
  };
  StoredFrame frame;
  {
    const std::lock_guard lock(mutex_);
    if (keyframe < 0 || static_cast<size_t>(keyframe) >= keyframes_.size()) return std::nullopt;
    if (const auto found = kept(); found != points_.end()) return found->second;
    frame = keyframes_[static_cast<size_t>(keyframe)].frame;
  }
  std::string points = keyframe_points(frame, rays_);
  const std::lock_guard lock(mutex_);
  const bool current = keyframes_[static_cast<size_t>(keyframe)].frame.depth_m.data == frame.depth_m.data;
  if (current && kept() == points_.end()) points_.emplace_back(keyframe, points);
  if (points_.size() > kKept) points_.pop_front();
  return points;
}

size_t LiveFeed::views_kept() const {
  const std::lock_guard lock(mutex_);
  const bool apart = newest_ && (reported_.empty() || reported_.back() != newest_);
  return reported_.size() + (apart ? 1 : 0);
}

}  // namespace fringeslam::tools
