// SPDX-License-Identifier: Apache-2.0
// Maps saved while they grow: what it costs, what a kill loses, and how long a large map takes to open.
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <numeric>
#include <optional>
#include <string>
#include <thread>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "bench/speed/loop_rig.h"
#include "core/landmarks/recognition.h"
#include "core/mapper/driver.h"
#include "core/rig/rig_file.h"
#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
#include "core/storage/map_parts.h"
#include "core/types/error.h"
#include "sim/random.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

// A folder that is removed with its content.
class Scratch {
 public:
  // Maps are too large for a memory file system.
  explicit Scratch(const char* name)
      : path_(fs::path("/var/tmp") / ("fringeslam-" + std::string(name) + "-" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

// Maps the loop; with `folder`, saves the map meanwhile. Returns processor time and time, s.
std::pair<double, double> mapped(const LoopScene& loop, const std::optional<fs::path>& folder) {
  LoopRig rig(loop, 1);
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  const std::clock_t cpu = std::clock();
  const double wall_s = seconds_of([&] {
    std::optional<MapJournal> journal;
    if (folder)
      journal.emplace(*folder / "run",
                      [](const std::string& message) { std::fprintf(stderr, "%s\n", message.c_str()); });
    Driver driver(rig, pipeline);
    while (driver.next()) {
      if (journal) journal->update(pipeline.map());
    }
    if (!journal) return;
    journal->finish(pipeline.map(), *folder / kMapFile);
    journal->remove();
  });
  const double cpu_s = static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  if (folder) {
    std::fprintf(stderr, "  %zu frames, %.0f MiB, %.2f s of processor time in %.2f s with saving\n",
                 pipeline.map().frames().size(), static_cast<double>(fs::file_size(*folder / kMapFile)) / (1 << 20),
                 cpu_s, wall_s);
    fs::remove(*folder / kMapFile);
  } else {
    std::fprintf(stderr, "  %.2f s of processor time in %.2f s without\n", cpu_s, wall_s);
  }
  return {cpu_s, wall_s};
}

std::vector<Row> cost_rows(const Context& context) {
  const LoopScene loop = rendered_loop();
  const Scratch scratch("save");
  std::vector<double> cpu, wall;
  (void)mapped(loop, std::nullopt);
  for (int turn = 0; turn < (context.quick ? 2 : 7); ++turn) {
    // The order alternates, so that a trend affects both alike.
    const bool first = turn % 2 == 0;
    const auto one = mapped(loop, first ? std::nullopt : std::optional(scratch / ""));
    const auto two = mapped(loop, first ? std::optional(scratch / "") : std::nullopt);
    const auto &with = first ? two : one, &without = first ? one : two;
    cpu.push_back(with.first / without.first);
    wall.push_back(with.second / without.second);
  }
  std::fprintf(stderr, "  time with saving relative to without: %.3f\n", median(wall));
  return {median_row("scale.save", cpu, "x", 1.05)};
}

double since_epoch_s(const timespec& time) {
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// When the results of a view were written, after it had been mapped; empty if they are not there.
std::optional<double> written_at(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return std::nullopt;
  return since_epoch_s(status.st_mtim);
}

// Kills a run that adds every view to the map as a keyframe. Returns the age of the oldest view that is not in the recovered
// map, s; empty if the run was not killed while it mapped.
std::optional<double> lost_by_kill(const fs::path& dataset, const fs::path& folder, double after_s) {
  fs::remove_all(folder);
  fs::create_directories(folder);
  const fs::path out = folder / "run";
  const std::string program = FRINGESLAM_BENCH_PROGRAM;
  const pid_t child = ::fork();
  if (child < 0) throw Error("scale.save.lost: cannot start a process");
  if (child == 0) {
    const int nowhere = ::open("/dev/null", O_RDWR);
    ::dup2(nowhere, 1), ::dup2(nowhere, 2);
    ::execl(program.c_str(), program.c_str(), "run", dataset.c_str(), "--out", out.c_str(), "--save-map", "--quiet",
            "--set", "mapping.every_view=true", nullptr);
    ::_exit(127);
  }
  std::this_thread::sleep_for(std::chrono::duration<double>(after_s));
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  ::kill(child, SIGKILL);
  int status = 0;
  (void)::waitpid(child, &status, 0);
  if (!WIFSIGNALED(status)) return std::nullopt;
  std::optional<fs::path> partial;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename().string().starts_with("run.partial-")) partial = entry.path() / "run/frames";
  }
  const std::vector<LeftMap> left = left_maps(out);
  std::vector<char> known;
  if (!left.empty()) {
    (void)recover_map(WorkFolder::taken_over(left[0].folder), folder / kMapFile);
    verify_map(folder / kMapFile);
    for (const auto& keyframe : read_map_info(folder / kMapFile).content.index.keyframes) {
      known.resize(std::max(known.size(), static_cast<size_t>(keyframe.index) + 1));
      known[static_cast<size_t>(keyframe.index)] = 1;
    }
  }
  double oldest_s = 0;
  int views = 0;
  for (size_t i = 0; partial; ++i, ++views) {
    char name[16];
    std::snprintf(name, sizeof name, "%06zu", i);
    const std::optional<double> at = written_at(*partial / name / "depth.exr");
    if (!at) break;
    if (i >= known.size() || !known[i]) oldest_s = std::max(oldest_s, since_epoch_s(now) - *at);
  }
  if (views == 0) return std::nullopt;
  std::fprintf(stderr,
               "  killed after %.1f s: %d views mapped, %td in the recovered map, the oldest lost is %.2f s old\n",
               after_s, views, std::count(known.begin(), known.end(), 1), oldest_s);
  return oldest_s;
}

std::vector<Row> lost_rows(const Context& context) {
  const Scratch scratch("lost");
  const fs::path dataset = scratch / "dataset";
  const std::string command = std::string(FRINGESLAM_BENCH_PROGRAM) + " render " + FRINGESLAM_SCENES +
                              "/loop --quiet --out " + dataset.string() +
                              " --set render.samples_per_pixel=1 > /dev/null";
  if (std::system(command.c_str()) != 0) throw Error(command + ": failed; see its message above");
  sim::Philox random(1, sim::Stream::views, 0);
  double most_s = 0;
  int kills = 0;
  for (int i = 0; i < (context.quick ? 4 : 25); ++i) {
    const std::optional<double> lost_s = lost_by_kill(dataset, scratch / "trial", 2 + 10 * random.uniform());
    if (!lost_s) continue;
    ++kills;
    most_s = std::max(most_s, *lost_s);
  }
  if (kills == 0) throw Error("scale.save.lost: no run was killed while it mapped");
  return {bound_row("scale.save.lost", most_s, kills, "s", 1, Limit::most)};
}

// Writes a large map made of the keyframes of a small one: each copy lies elsewhere, and its descriptors have their components
// in another order, so that they resemble no others. The first keyframes are the small map. Returns the mean number of
// keypoints.
size_t write_enlarged(const fs::path& file, const KeyframeMap& map, size_t count) {
  MapIndex index;
  index.camera = numbers_of(map.rig().camera);
  const FrameLayout layout(index.image_size());
  MapParts parts(file);
  const size_t period = map.keyframes().size();
  sim::Philox random(1, sim::Stream::views, 1);
  std::vector<int> order(128);
  size_t keypoints = 0;
  for (size_t i = 0; i < count; ++i) {
    const size_t copy = i / period;
    if (i % period == 0) {
      std::iota(order.begin(), order.end(), 0);
      for (size_t k = order.size() - 1; copy > 0 && k > 0; --k)
        std::swap(order[k], order[static_cast<size_t>(random.uniform() * static_cast<double>(k + 1))]);
    }
    const Keyframe& keyframe = map.keyframes()[i % period];
    Landmarks landmarks = *keyframe.landmarks.get();
    const cv::Mat1f from = landmarks.keypoints.descriptors;
    landmarks.keypoints.descriptors = cv::Mat1f(from.size());
    for (int row = 0; row < from.rows; ++row) {
      for (int col = 0; col < from.cols; ++col)
        landmarks.keypoints.descriptors(row, col) = from(row, order[static_cast<size_t>(col)]);
    }
    keypoints += landmarks.keypoints.keypoints.size();
    Pose pose = keyframe.world_from_camera;
    pose.translation.x() += 10.0 * static_cast<double>(copy);
    const int number = static_cast<int>(i);
    const StoredPart images = parts.add(keyframe.frame, layout);
    index.keyframes.push_back({number, keyframe.timestamp_s, pose, keyframe.motion, images,
                               parts.add(landmark_bytes(landmarks)), parts.add(digest_bytes(digest_of(landmarks)))});
    index.frames.push_back({number, {}, number, keyframe.timestamp_s, images, true});
    if (i > 0) {
      const Pose motion = index.keyframes[i - 1].world_from_camera.inverse() * pose;
      index.links.push_back({number - 1, number, orthonormalised(motion), 1e8 * Matrix6d::Identity(), false});
    }
  }
  parts.finish(index);
  return keypoints / count;
}

// Removes a file from the page cache.
void forget(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) throw Error(file.string() + ": cannot be opened");
  (void)::fdatasync(descriptor);
  (void)::posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED);
  ::close(descriptor);
}

std::vector<Row> open_rows(const Context& context) {
  const size_t count = context.quick ? 500 : 2000;
  const LoopScene loop = rendered_loop();
  const Scratch scratch("open");
  std::vector<int> between;  // views that are no keyframes
  {
    Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
    for (const FringeStack& stack : loop.stacks) {
      const FrameResult result = pipeline.process(stack);
      if (has_pose(result.tracking) && result.keyframe < 0) between.push_back(stack.index);
    }
    size_t keypoints = 0;
    const double write_s = seconds_of([&] { keypoints = write_enlarged(scratch / kMapFile, pipeline.map(), count); });
    std::fprintf(stderr, "  %zu keyframes, copies of %zu, with %zu keypoints each; written in %.1f s: %.0f MiB\n",
                 count, pipeline.map().keyframes().size(), keypoints, write_s,
                 static_cast<double>(fs::file_size(scratch / kMapFile)) / (1 << 20));
  }
  std::vector<double> all_s, search_ms, first_search_ms;
  const int turns = context.quick ? 3 : 8;
  for (int turn = 0; turn < turns; ++turn) {
    // Once from memory, to compare; then from disk.
    if (turn > 0) forget(scratch / kMapFile);
    size_t view = between.size() * static_cast<size_t>(turn) / static_cast<size_t>(turns);
    std::optional<KeyframeMap> map;
    std::optional<Pipeline> pipeline;
    const std::clock_t cpu = std::clock();
    const double open_s = seconds_of([&] { map = open_map(scratch / kMapFile, loop.scene.rig, {}); });
    const double index_s =
        seconds_of([&] { pipeline.emplace(std::move(*map), loop.scene.patterns, PipelineOptions{}); });
    int views = 0;
    const double first_s = seconds_of([&] {
      bool located = false;
      for (; !located && view < between.size(); ++views)
        located = has_pose(pipeline->process(loop.stacks[static_cast<size_t>(between[view++])]).tracking);
      if (!located) throw Error("scale.open: no view was located");
    });
    if (turn > 0) all_s.push_back(open_s + index_s + first_s);
    std::fprintf(stderr,
                 "  from %s: opened in %.2f s, landmarks indexed in %.2f s, first pose in %.2f s by view %d; %.2f s of "
                 "processor time\n",
                 turn > 0 ? "disk" : "memory", open_s, index_s, first_s, views,
                 static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC);
    for (size_t k = 0; k < count; k += count / 25) {
      const KeyframeMap& stored = pipeline->map();
      const Frame frame = stored.keyframe_image(static_cast<int>(k));
      for (std::vector<double>* times : {&first_search_ms, &search_ms})
        times->push_back(1e3 *
                         seconds_of([&] { (void)stored.overlapping(frame, stored.keyframes()[k].world_from_camera); }));
    }
  }
  std::fprintf(stderr, "  search %.1f ms; %.1f ms the first time, when the keyframes' images are read and verified\n",
               median(search_ms), median(first_search_ms));
  return {median_row("scale.open", all_s, "s", 2), median_row("scale.loop", search_ms, "ms", 10)};
}

}  // namespace

std::vector<Item> saving_items() {
  return {
      {{"scale.save"}, "processor time of mapping with the map saved meanwhile, relative to without", cost_rows, true},
      {{"scale.save.lost"}, "age of the oldest view that a kill loses", lost_rows, true},
      {{"scale.open", "scale.loop"},
       "a map of 2,000 keyframes: from its file to the first pose, and the search for keyframes that overlap a view",
       open_rows,
       true}};
}

}  // namespace fringeslam::bench
