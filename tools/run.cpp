// SPDX-License-Identifier: Apache-2.0
// fringeslam run SCENE|DATASET
#include <algorithm>
#include <atomic>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/check/conventions.h"
#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/json_text.h"
#include "core/io/yaml.h"
#include "core/mapper/driver.h"
#include "core/mapper/image_trajectory.h"
#include "core/mapper/thermal_observer.h"
#include "core/rig/background_rig.h"
#include "core/rig/rig_file.h"
#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
#include "tools/interrupt.h"
#include "tools/live/live_mapper.h"
#include "tools/live/live_option.h"
#include "tools/mappable.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/report/animation.h"
#include "tools/report/html_report.h"
#include "tools/run_folder.h"
#include "tools/run_phases.h"
#include "tools/saved_map.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kConfigFile = "config.yaml";
constexpr size_t kWaitingStacks = 2;  // with --real-time: stacks that may wait before the oldest is dropped
constexpr int kViewsAhead = 2;        // with --real-time: views that may be in preparation
constexpr int kAnimationFrames = 20;
constexpr bool kHasReport = FRINGESLAM_REPORT;

struct RunArguments {
  std::string source, out;
  std::vector<std::string> sets;
  SceneVariant variant;
  std::string map, rig;
  bool mesh = false, vdb = false, save_map = false, no_report = false, image_poses = false;
  LiveOption live;
  int views = 0;  // 0: all
  double live_rate_hz = 0;
  bool live_wait = false, real_time = false;
  bool animation = false;
};

// Converts a scene's name to a folder name.
std::string file_name(std::string name) {
  for (char& c : name) {
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_') c = '_';
  }
  return name;
}

// Limits the rate of wait() to `rate_hz`; 0: unlimited.
class RateLimiter {
 public:
  explicit RateLimiter(double rate_hz) : period_s_(rate_hz > 0 ? 1 / rate_hz : 0) {}
  void wait() {
    if (period_s_ == 0) return;
    const auto now = Clock::now();
    if (turn_ > 0) wait_s(turn_ * period_s_ - std::chrono::duration<double>(now - start_).count());
    if (turn_++ == 0) start_ = now;
  }

 private:
  using Clock = std::chrono::steady_clock;
  double period_s_;
  Clock::time_point start_;
  int turn_ = 0;
};

// Explains runs that reconstruct nearly nothing, or track no view.
class Emptiness {
 public:
  // `map`: the saved map that the run continues; empty if it starts one.
  explicit Emptiness(const fs::path& map) : map_(map) {}
  void add(const FringeStack& stack, const FrameResult& result) {
    if (!first_) first_ = stack;
    const auto valid = std::count_if(result.frame.points_m.begin(), result.frame.points_m.end(),
                                     [](const cv::Vec3f& p) { return p[2] == p[2]; });
    pixels_ += static_cast<int64_t>(result.frame.points_m.total());
    valid_ += valid;
    ++views_;
    tracked_ += has_pose(result.tracking);
    if (!has_pose(result.tracking)) lost_[stack.index] = {valid, result.frame.points_m.total()};
    motion_unknown_ += result.motion_unknown();
    motion_untested_ += result.motion_untested && result.tracking != Tracking::first;
    for (const std::shared_ptr<const FrameResult>& recovered : result.recovered)
      tracked_ += static_cast<int>(lost_.erase(recovered->frame.index));
  }
  // Returns one line about the views without a pose, or nothing if there are none.
  std::string lost() const {
    if (lost_.empty() || tracked_ == 0) return "";
    const auto& [first, view] = *lost_.begin();
    const double share = static_cast<double>(view.valid) / static_cast<double>(view.pixels);
    return std::to_string(views_ - tracked_) + " of " + std::to_string(views_) +
           " views have no pose; the first is view " + std::to_string(first) +
           (share < 0.01 ? ", where " + std::to_string(view.valid) + " of " + std::to_string(view.pixels) +
                               " pixels have a depth: check its images"
                         : ", whose surface was not found in the map") +
           " (see frames.json)";
  }
  // Returns one line about views of which nothing shows whether the robot stopped for them, or nothing if there are none.
  std::string untested() const {
    if (motion_untested_ == 0) return "";
    return std::to_string(motion_untested_) + " of " + std::to_string(views_) +
           " views cannot show whether the robot stopped for them, as with one fringe period: their covariances "
           "allow for a motion as between views; if it did stop, add --set tracking.at_rest=true";
  }
  // Returns one line, or nothing if the result is not nearly empty.
  std::string reason(RigModel rig, const DepthOptions& depth) const {
    constexpr double kNearlyNothing = 1e-4;
    if (!first_) return "";
    if (static_cast<double>(valid_) > kNearlyNothing * static_cast<double>(pixels_)) return reason_for_no_pose();
    rig.near_m = depth.near_m;
    rig.far_m = depth.far_m;
    return std::to_string(valid_) + " of " + std::to_string(pixels_) +
           " pixels have a depth: " + reason_for_no_depth(*first_, rig);
  }

 private:
  std::string reason_for_no_pose() const {
    if (tracked_ > 0) return "";
    const std::string none = "no view of " + std::to_string(views_) + " has a pose: ";
    if (motion_unknown_ == views_)
      return none +
             "the images of each stack disagree as if the camera had moved, but no motion explains them; if it stood "
             "still, add --set tracking.at_rest=true; if the projector's response is not linear, measure it with "
             "`fringeslam calibrate response` and pass its rig.yaml with --rig";
    if (!map_.empty())
      return none + "none was found in " + map_.string() +
             "; check that the map shows the same place from nearby viewpoints, and the images with overview.png";
    return none + "too little surface is visible to start a map; check exposure, working range and overview.png";
  }

  struct LostView {
    int64_t valid = 0;
    size_t pixels = 0;
  };
  fs::path map_;
  std::optional<FringeStack> first_;
  std::map<int, LostView> lost_;  // by the index of the stack
  int64_t pixels_ = 0, valid_ = 0;
  int views_ = 0, tracked_ = 0, motion_unknown_ = 0, motion_untested_ = 0;
};

// Names the images that do not show their pattern: the camera or the projector dropped or repeated one.
void report_unexpected(const std::vector<ImageOfRun>& images) {
  const auto unexpected = [](const ImageOfRun& image) { return !image.as_expected; };
  const auto first = std::find_if(images.begin(), images.end(), unexpected);
  if (first == images.end()) return;
  std::fprintf(stderr,
               "%d of %d images do not show their pattern, the first is image %d of stack %d (see images.json)\n",
               static_cast<int>(std::count_if(first, images.end(), unexpected)), static_cast<int>(images.size()),
               first->image, first->stack);
}

// Saves the map while the run maps. If the run fails, what was saved remains for `map recover`.
class SavedWhileMapping {
 public:
  SavedWhileMapping(const fs::path& target, const RigModel& rig)
      : journal_(target, [](const std::string& message) { std::fprintf(stderr, "warning: %s\n", message.c_str()); }) {
    StagedFile file(journal_.folder() / "rig.yaml");
    write_text(file.path(), to_yaml(rig));
    file.commit();
  }
  void update(const KeyframeMap& map) { journal_.update(map); }
  void finish(const KeyframeMap& map, const fs::path& file) { journal_.finish(map, file); }
  void remove() { journal_.remove(); }

 private:
  MapJournal journal_;
};

std::string without_text(const std::vector<std::string>& left_out) {
  std::string text;
  for (const std::string& file : left_out) text += (&file == &left_out.front() ? ", without " : ", ") + file;
  return text;
}

std::string kept_text(int views, int all, const std::vector<std::string>& left_out) {
  return "interrupted: " + std::to_string(views) + " of " + std::to_string(all) + " views are kept" +
         without_text(left_out);
}

// Sets a flag when it is destroyed, by an exception, too.
struct SetAtEnd {
  std::atomic<bool>& flag;
  ~SetAtEnd() { flag = true; }
};

// Returns a name beside `folder` under which nothing exists.
fs::path name_for_incomplete(const fs::path& folder) {
  std::error_code unknown;
  fs::path name = folder.string() + ".incomplete";
  for (int i = 2; fs::symlink_status(name, unknown).type() != fs::file_type::not_found; ++i)
    name = folder.string() + ".incomplete-" + std::to_string(i);
  return name;
}

// Lets an incomplete result appear beside an older one, which may be complete. Returns false if there is none.
bool keep_older_result(StagedFolder& folder) {
  std::error_code unknown;
  if (fs::is_empty(folder.target(), unknown) || unknown) return false;
  folder.redirect(name_for_incomplete(folder.target()));
  return true;
}

// Returns one line about the phases that failed. Files of the result are named in `out` instead of `staged`.
std::string failure_text(const RunPhases& phases, const fs::path& staged, const std::string& out) {
  std::string text;
  for (std::string failure : phases.failures()) {
    for (size_t at; (at = failure.find(staged.string())) != std::string::npos;)
      failure.replace(at, staged.string().size(), out);
    text += failure + "; ";
  }
  return text + "the other results are written to " + out + without_text(phases.left_out());
}

void wait_for_interrupt() {
  std::fflush(stdout);  // delivers the score to a reader at the other end of a pipe
  while (!interrupted()) wait_s(60);
}

int run(const RunArguments& arguments, const Common& common) {
  Settings settings = parse_settings(arguments.sets);
  if (sets_any_of(arguments.sets, "mesh") && !arguments.mesh)
    throw Error("mesh.* settings have no effect without --mesh; add it");
  if (sets_any_of(arguments.sets, "image_poses") && !arguments.image_poses)
    throw Error("image_poses.* settings have no effect without --image-poses; add it");
  const auto source = open_source(arguments.source, arguments.variant, settings, sets_any_of(arguments.sets, "render"));
  if (!arguments.rig.empty()) source->recalibrate(read_rig(arguments.rig));
  if (source->imported()) {
    const auto is_set = [&](const std::string& key) {
      return std::any_of(arguments.sets.begin(), arguments.sets.end(),
                         [&](const std::string& set) { return set.starts_with(key + "="); });
    };
    DepthOptions& depth = settings.pipeline.depth;
    if (!is_set("depth.near_m")) depth.near_m = source->model().near_m;
    if (!is_set("depth.far_m")) depth.far_m = source->model().far_m;
    if (!is_set("tracking.at_rest") && !source->has_image_times()) settings.pipeline.tracking.at_rest = true;
  }
  try {
    check_mappable(source->model(), source->sequence(), settings.pipeline.decode);
  } catch (const Error& e) {
    throw Error(arguments.source + ": " + e.what());
  }
  std::string out = arguments.out.empty() ? "runs/" + file_name(source->name()) + "-" + std::to_string(source->seed())
                                          : arguments.out;
  const std::vector<std::string> preserved = {kMapFile};
  const fs::path map = arguments.map.empty() ? fs::path() : map_file(arguments.map);
  std::vector<fs::path> inputs = source->inputs();
  inputs.insert(inputs.end(), {map, arguments.rig});
  require_not_an_input(out, inputs, preserved);
  StagedFolder folder(out, "run", preserved);
  report_left_maps(folder.target());
  const auto rig = source->open(folder.path());
  // The world frame of a new map is the robot's frame at the first stack.
  auto pipeline = arguments.map.empty()
                      ? std::make_unique<Pipeline>(rig->model(), source->sequence(), settings.pipeline, Pose{})
                      : std::make_unique<Pipeline>(open_map(map, rig->model(), settings.pipeline.mapping),
                                                   source->sequence(), settings.pipeline);
  ThermalObserver thermal(rig->model(), settings.pipeline.thermal);
  std::optional<ImageTrajectory> images;
  if (arguments.image_poses) images.emplace(rig->model(), source->sequence(), settings.image_poses);
  // Only an estimate in continuous motion, where the number of stacks depends on the patterns that the pipeline requests.
  const int planned = arguments.views > 0 ? std::min(arguments.views, source->stacks()) : source->stacks();
  Animation animation(rig->model(), std::max(1, planned / kAnimationFrames));
  RunFolder record(folder.path(), rig->model(), source->sequence());
  std::optional<SavedWhileMapping> saving;
  if (arguments.save_map) saving.emplace(folder.target(), rig->model());
  const std::unique_ptr<LivePage> live = open_live_page(arguments.live, {.verb = "run",
                                                                         .name = source->name(),
                                                                         .rig = rig->model(),
                                                                         .sequence = source->sequence(),
                                                                         .stacks = planned,
                                                                         .maps = true});
  std::atomic<bool> mapping_ended = false;
  std::optional<BackgroundRig> camera;
  if (arguments.real_time)
    camera.emplace(*rig, source->sequence(), kWaitingStacks, Pace::timestamps,
                   [&] { return mapping_ended || interrupted(); });
  const auto dropped = [&] { return camera ? camera->dropped() : 0; };
  RateLimiter rate(arguments.live_rate_hz);
  Emptiness emptiness(map);
  RunPhases phases(folder.path(), common.quiet || common.json);
  int mapped = 0;
  bool all_mapped = false;
  double last_time_s = 0;
  catch_interrupts();
  {
    Progress progress("mapping", planned, common.quiet || common.json);
    Rig& stacks = camera ? static_cast<Rig&>(*camera) : *rig;
    Driver driver(stacks, *pipeline, camera ? kViewsAhead : Driver::kAhead);
    const SetAtEnd ends{mapping_ended};  // before the driver, which waits for a stack that it has requested
    while (!interrupted() && (arguments.views == 0 || mapped < arguments.views)) {
      const std::optional<MappedView> view = driver.next();
      if (!view) {
        all_mapped = !interrupted();
        break;
      }
      const auto& [stack, result] = *view;
      if (mapped > 0 && !(stack.timestamp_s > last_time_s))
        throw Error(arguments.source + ": stack " + std::to_string(stack.index) + ": its timestamp_s, " +
                    to_text(stack.timestamp_s) + ", is not later than that of the stack before it, " +
                    to_text(last_time_s) + "; put the stacks in the order of time");
      last_time_s = stack.timestamp_s;
      if (mapped == 0) {
        if (const std::string turned = reason_for_turned_images(stack, rig->model()); !turned.empty())
          throw Error(arguments.source + ": " + turned);
      }
      const ThermalView warmth = thermal.observe(stack, result);
      if (saving) saving->update(pipeline->map());
      record.add(stack, result, warmth, pipeline->map());
      emptiness.add(stack, result);
      if (images) images->add(stack, result, pipeline->mapper());
      if (arguments.animation) animation.add(stack, result, pipeline->map());
      if (live) show_mapped(live->feed(), stack, result, pipeline->mapper(), warmth, thermal, dropped());
      if (arguments.mesh) record.add_mesh(frame_mesh(result.frame, settings.mesh), stack.index);
      for (const std::shared_ptr<const FrameResult>& recovered : result.recovered) {
        record.replace(*recovered);
        if (arguments.mesh) record.replace_mesh(frame_mesh(recovered->frame, settings.mesh), recovered->frame.index);
      }
      progress.step();
      rate.wait();
      ++mapped;
    }
    all_mapped = all_mapped || mapped == arguments.views;
  }
  // The camera would go on capturing into the run folder.
  const int dropped_stacks = dropped();
  camera.reset();
  if (mapped == 0 && interrupted()) throw Error("interrupted before the first view; nothing is written");
  phases.note("mapping");
  const int stacks = mapped + dropped_stacks;
  write_text(folder.path() / kConfigFile,
             "name: " + yaml_quoted(source->name()) + "\nseed: " + std::to_string(source->seed()) + "\nstacks: " +
                 std::to_string(stacks) + "\n" + pipeline_yaml(settings) + (arguments.mesh ? mesh_yaml(settings) : "") +
                 (arguments.image_poses ? image_poses_yaml(settings) : ""));
  if (dropped_stacks > 0 && !common.json)
    std::fprintf(stderr, "dropped: %d of %d stacks, because mapping fell behind\n", dropped_stacks, planned);
  if (live) live->feed().finish();
  record.finish(pipeline->trajectory());
  if (rig->model().thermal) record.add_warm_objects(thermal.warm_objects(pipeline->mapper()));
  if (images) record.add_image_poses(*images, pipeline->mapper());
  phases.note("trajectory");
  bool map_is_saved = false;
  if (saving)
    map_is_saved =
        phases.run_always("map", {kMapFile}, [&] { saving->finish(pipeline->map(), folder.path() / kMapFile); });
  phases.run("cloud", {"map.ply"}, [&] {
    record.write_cloud(pipeline->map(), settings.pipeline.cloud, phases.progress("merging the cloud"));
  });
  phases.run("surface", {"mesh.ply", "mesh.glb"}, [&] {
    if (!record.write_surface(pipeline->map(), settings.pipeline.surface, phases.progress("fusing the surface")))
      std::fprintf(stderr, "mesh.glb: left out, because the mesh exceeds the 4 GiB of a GLB file; see mesh.ply\n");
  });
  if (arguments.vdb)
    phases.run("vdb", {"surface.vdb"},
               [&] { write_text(folder.path() / "surface.vdb", pipeline->surface().to_vdb()); });
  if (arguments.animation)
    phases.run("animation", {"animation.gif"},
               [&] { animation.write(folder.path() / "animation.gif", pipeline->mapper(), settings.pipeline.cloud); });

  const bool tracked = !pipeline->trajectory().empty();
  pipeline.reset();  // the rest needs memory, but not the map
  std::optional<RunScore> score;
  if (source->has_truth() && tracked) {
    phases.run("scoring", {"truth.tum", "score.json"}, [&] {
      copy_input(folder.path() / "truth" / "truth.tum", folder.path() / "truth.tum");
      score = score_run(folder.path(), {},
                        {.view = [&](int index, const DepthEstimate& estimate,
                                     const TruthFrame& truth) { record.draw_error(index, estimate, truth); },
                         .progress = phases.progress("scoring")},
                        source->truth(folder.path()));
      write_text(folder.path() / "score.json", json_text(to_json(*score), 2) + "\n");
    });
  }
  phases.run("overview", {"overview.png"}, [&] { record.draw_overview(score ? &*score : nullptr); });
#if FRINGESLAM_REPORT
  if (!arguments.no_report)
    phases.run("report", {"report.html"}, [&] { write_report(folder.path(), folder.path() / "report.html"); });
#endif
  const fs::path staged = folder.path();
  std::string unchanged;
  if (!phases.left_out().empty() || !phases.failures().empty() || !all_mapped) {
    if (keep_older_result(folder)) unchanged = "; the older result in " + out + " is unchanged";
    out = folder.target().string();
  }
  folder.commit();
  if (map_is_saved) saving->remove();

  if (common.json) {
    nlohmann::ordered_json json = {{"run", out}};
    if (arguments.real_time) json["dropped"] = dropped_stacks;
    for (const RunPhases::Phase& phase : phases.all())
      json["phases"].push_back({{"name", phase.name}, {"seconds", phase.seconds}, {"peak_mib", phase.peak_mib}});
    if (!phases.left_out().empty()) json["left_out"] = phases.left_out();
    json["score"] = score ? to_json(*score) : nlohmann::ordered_json();
    std::printf("%s\n", json_text(json, 2).c_str());
  } else {
    if (score) print_text(to_table(*score));
    const char* look = kHasReport && !arguments.no_report ? "report.html" : "overview.png";
    if (phases.left_out().empty())
      std::printf("written: %s  (see %s/%s)\n", out.c_str(), out.c_str(), look);
    else if (phases.failures().empty())
      std::printf("written: %s\n", out.c_str());
  }
  if (images) report_unexpected(images->images());
  const std::string failure = phases.failures().empty() ? "" : failure_text(phases, staged, out);
  if (interrupted()) {
    std::fprintf(stderr, "%s\n",
                 (failure.empty() ? kept_text(mapped, planned, phases.left_out()) + unchanged
                                  : "interrupted after " + std::to_string(mapped) + " of " + std::to_string(planned) +
                                        " views; " + failure)
                     .c_str());
    return kInterrupted;
  }
  if (const std::string lost = emptiness.lost(); !lost.empty() && !common.json)
    std::fprintf(stderr, "%s: %s\n", arguments.source.c_str(), lost.c_str());
  if (const std::string untested = emptiness.untested(); !untested.empty() && !common.json)
    std::fprintf(stderr, "%s: %s\n", arguments.source.c_str(), untested.c_str());
  const std::string reason = emptiness.reason(rig->model(), settings.pipeline.depth);
  if (!reason.empty()) std::fprintf(stderr, "fringeslam: %s: %s\n", arguments.source.c_str(), reason.c_str());
  if (live && arguments.live_wait) {
    if (!failure.empty()) std::fprintf(stderr, "fringeslam: %s\n", failure.c_str());
    wait_for_interrupt();
    if (!failure.empty()) return 2;
  }
  if (!failure.empty()) throw Error(failure);
  return reason.empty() ? 0 : 1;
}

}  // namespace

Verb add_run(Command app, const Common& common) {
  auto arguments = std::make_shared<RunArguments>();
  const Command verb =
      app.add_subcommand("run", "Map a scene or a recorded dataset, and score the map if ground truth is available");
  verb.add_option("source", arguments->source, "Scene file, folder with scene.yaml, or dataset folder").required();
  verb.add_option("--out", arguments->out, "Run folder to write (default: runs/NAME-SEED)");
  arguments->variant.add_to(verb);
  verb.add_option("--views", arguments->views, "Map only the first views (default: all)").check_range(1, 1'000'000);
  verb.add_flag("--mesh", arguments->mesh, "Also write each view's surface mesh as frames/NNNNNN/mesh.ply");
  verb.add_option("--rig", arguments->rig,
                  "Calibration to use instead of the dataset's, a rig.yaml such as that of calibrate rig; the "
                  "dataset's camera noise remains")
      .check_existing_file();
  verb.add_option("--map", arguments->map, "Continue in a map saved by an earlier run");
  verb.add_flag("--save-map", arguments->save_map,
                "Also write saved.map, in which a later run can continue; it is saved while mapping (see map recover)");
  verb.add_flag("--animation", arguments->animation, "Also write animation.gif: the growing map, fringes and depth");
  verb.add_flag(
      "--image-poses", arguments->image_poses,
      "Also write images.tum and images.json: the pose at every single image, and whether the image shows its "
      "pattern");
  verb.add_flag("--vdb", arguments->vdb, "Also write the fused surface's signed distances as surface.vdb (OpenVDB)");
  verb.add_flag("--no-report", arguments->no_report, "Do not write report.html");
  verb.add_flag("--real-time", arguments->real_time,
                "Process views at their timestamps, as from a camera; if mapping falls behind, the oldest are dropped");
  const Option page = add_live_option(verb, arguments->live);
  verb.add_option("--live-rate", arguments->live_rate_hz, "Maximum number of views per second; 0: no limit")
      .type_name("HZ")
      .check_range(0.0, 1000.0)
      .needs(page);
  verb.add_flag("--live-wait", arguments->live_wait, "Keep serving the page after the run, until Ctrl-C").needs(page);
  verb.add_option("--set", arguments->sets, "Setting: stage.key=value (repeatable; listed below)");
  verb.footer(settings_help());
  return [arguments, &common] {
    try {
      return run(*arguments, common);
    } catch (const Error& e) {
      if (!arguments->save_map || arguments->out.empty()) throw;
      for (const LeftMap& left : left_maps(arguments->out)) throw Error(std::string(e.what()) + "; " + left.message);
      throw;
    }
  };
}

}  // namespace fringeslam::tools
