// SPDX-License-Identifier: Apache-2.0
// Landmarks of generated scenes, re-identified in the next view and checked against ground truth.
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <utility>
#include <vector>

#include "bench/accuracy/percent_chart.h"
#include "bench/landmark_method.h"
#include "bench/row.h"
#include "core/score/landmark_score.h"

namespace fringeslam::bench {

namespace {

struct Sample {
  LandmarkScore score;
  int depth_keypoints = 0, texture_keypoints = 0;  // second view's, in the foreground and with depth
  double seconds = 0;
};

Sample sample(const ViewPair& pair, const LandmarkMethod& method) {
  const std::clock_t start = std::clock();
  const Landmarks first = landmarks_of(pair, pair.views[0], method), second = landmarks_of(pair, pair.views[1], method);
  LandmarkDatabase database(pair.rig.camera, method.recognition);
  database.add(0, first);
  const std::vector<Recognition> recognised = database.reidentify(second);
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  const auto judged = [&](const Landmarks& landmarks, const View& view) {
    return ScoredView{&landmarks, &view.truth, view.truth.world_from_robot * pair.rig.robot_from_camera};
  };
  return {score_landmarks({judged(first, pair.views[0])}, judged(second, pair.views[1]), recognised, pair.rig.camera),
          static_cast<int>(second.depth_keypoints.size()), static_cast<int>(second.keypoints.keypoints.size()),
          seconds};
}

double percent(double part, double whole) { return whole > 0 ? 100 * part / whole : NAN; }

// Sums over pairs.
struct Total {
  int pairs = 0, depth_keypoints = 0, texture_keypoints = 0;
  double seconds = 0;  // processor time: landmarks of both views and their matching
  LandmarkScore sum;

  void add(const Sample& s) {
    ++pairs;
    seconds += s.seconds;
    depth_keypoints += s.depth_keypoints;
    texture_keypoints += s.texture_keypoints;
    sum.landmarks += s.score.landmarks;
    sum.covisible += s.score.covisible;
    sum.recognised += s.score.recognised;
    sum.repeated += s.score.repeated;
    sum.false_reidentifications += s.score.false_reidentifications;
    sum.matches += s.score.matches;
    sum.right += s.score.right;
    sum.purity.insert(sum.purity.end(), s.score.purity.begin(), s.score.purity.end());
  }
  double per_pair(int count) const { return static_cast<double>(count) / pairs; }
  double recognised() const { return percent(sum.recognised, sum.covisible); }
  double precision() const { return percent(sum.right, sum.matches); }
  double repeated() const { return percent(sum.repeated, sum.covisible); }
  double purity() const {
    double all = 0;
    for (const double p : sum.purity) all += p;
    return percent(all, static_cast<double>(sum.purity.size()));
  }
};

void print_head() {
  std::fprintf(stderr, "  %-34s %6s %8s %9s %9s %9s %8s %8s %7s %8s %8s\n", "mean per pair", "depth", "texture",
               "landmarks", "covisible", "re-id. %", "repeat %", "matches", "corr. %", "purity %", "CPU ms");
}
void print(const std::string& name, const Total& t) {
  std::fprintf(stderr, "  %-34s %6.0f %8.0f %9.1f %9.1f %9.1f %8.1f %8.1f %7.2f %8.1f %8.0f\n", name.c_str(),
               t.per_pair(t.depth_keypoints), t.per_pair(t.texture_keypoints), t.per_pair(t.sum.landmarks),
               t.per_pair(t.sum.covisible), t.recognised(), t.repeated(), t.per_pair(t.sum.matches), t.precision(),
               t.purity(), 1e3 * t.seconds / t.pairs);
}

// The papers' experiments: 15 degrees of rotation, a face mask, grey dust and dim light, 70 cm of motion.
const std::vector<std::string> kExperiments = {"boxes_and_foam", "face_mask", "rubble_under_dust", "paper_boxes"};
// The papers' results: keypoints of the depth image and the texture, landmarks, re-identified ones.
const char* const kPapers[] = {"269 / 1074 keypoints, 5 of 7 landmarks", "177 / 766 keypoints, 4 of 9 landmarks",
                               "197 / 1124 keypoints, 4 of 6 landmarks", "264 / 1073 keypoints, 8 landmarks matched"};

std::vector<Row> experiment_rows(const Context& context) {
  const int seeds = context.quick ? 3 : 15;
  Total all;
  print_head();
  for (size_t i = 0; i < kExperiments.size(); ++i) {
    Total total;
    for (int seed = 1; seed <= seeds; ++seed) {
      const Sample s = sample(rendered_pair(kExperiments[i], static_cast<uint64_t>(seed)), {});
      total.add(s);
      all.add(s);
    }
    print(kExperiments[i], total);
    std::fprintf(stderr, "    (the paper: %s)\n", kPapers[i]);
  }
  print("all", all);
  const auto row = [&](const char* id, double value, int n, double limit) {
    return bound_row(id, value, n, "%", limit, Limit::least);
  };
  return {row("landmarks.recognised", all.recognised(), all.sum.covisible, 80),
          row("landmarks.precision", all.precision(), all.sum.matches, 99)};
}

using Variant = std::pair<std::string, LandmarkMethod>;

// The ways to outline a landmark, the edge detectors, and each extension of the papers disabled in turn.
std::vector<Variant> variants() {
  std::vector<Variant> all = {{"default", {}}};
  const auto vary = [&](const std::string& name, const auto& change) {
    LandmarkMethod method;
    change(method);
    all.emplace_back(name, method);
  };
  for (const ClusterMethod method : choice_values<ClusterMethod>())
    vary(std::string("clusters: ") + to_string(method), [&](LandmarkMethod& m) {
      m.landmarks.outlines = OutlineSource::clusters;
      m.clusters.method = method;
      m.keypoints.depth_halved = false;
    });
  for (const EdgeDetector edges : choice_values<EdgeDetector>()) {
    if (edges != ConditioningOptions().edges)
      vary(std::string("edges: ") + to_string(edges), [&](LandmarkMethod& m) { m.conditioning.edges = edges; });
  }
  vary("without guided search", [](LandmarkMethod& m) { m.recognition.guided = false; });
  vary("SIFT instead of RootSIFT", [](LandmarkMethod& m) { m.keypoints.root_sift = false; });
  vary("depth keypoints at full resolution", [](LandmarkMethod& m) { m.keypoints.depth_halved = false; });
  vary("brute force", [](LandmarkMethod& m) { m.recognition.search = DescriptorSearch::brute_force; });
  vary("texture keypoints at half resolution", [](LandmarkMethod& m) { m.keypoints.texture_halved = true; });
  vary("1500 keypoints", [](LandmarkMethod& m) { m.keypoints.max_keypoints = 1500; });
  vary("1500 keypoints of contrast 0.01", [](LandmarkMethod& m) {
    m.keypoints.max_keypoints = 1500;
    m.keypoints.contrast_threshold = 0.01;
  });
  vary("method as published", [](LandmarkMethod& m) {
    m.landmarks.outlines = OutlineSource::clusters;
    m.keypoints.depth_halved = false;
    m.landmarks.within_foreground = false;
    m.recognition.guided = false;
    m.keypoints.root_sift = false;
  });
  return all;
}

std::vector<Row> method_rows(const Context& context) {
  const int seeds = context.quick ? 2 : 13;
  std::vector<std::string> scenes = kExperiments;
  scenes.push_back("rubble_pile");
  const std::vector<Variant> methods = variants();
  std::vector<Total> totals(methods.size());
  for (const std::string& scene : scenes) {
    for (int seed = 1; seed <= seeds; ++seed) {
      const ViewPair pair = rendered_pair(scene, static_cast<uint64_t>(seed));
      for (size_t i = 0; i < methods.size(); ++i) totals[i].add(sample(pair, methods[i].second));
    }
  }
  print_head();
  std::vector<BarGroup> bars;
  for (size_t i = 0; i < methods.size(); ++i) {
    print(methods[i].first, totals[i]);
    bars.push_back({methods[i].first, {totals[i].recognised(), totals[i].repeated(), totals[i].precision()}});
  }
  if (!context.quick)
    write_percent_chart(FRINGESLAM_SCENES "/../bench/accuracy/landmark_methods.png",
                        "landmarks of " + std::to_string(totals[0].pairs) + " generated view pairs, %",
                        {"re-identified", "repeated", "correct matches"}, bars);
  return {bound_row("landmarks.methods", totals[0].recognised(), totals[0].sum.covisible, "%", 80, Limit::least)};
}

}  // namespace

std::vector<Item> landmark_items() {
  return {{{"landmarks.recognised", "landmarks.precision"},
           "the papers' experiments: landmarks re-identified in the second view, and fraction of correct matches",
           experiment_rows},
          {{"landmarks.methods"}, "ways to outline and re-identify landmarks, over generated scenes", method_rows}};
}

}  // namespace fringeslam::bench
