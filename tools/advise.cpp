// SPDX-License-Identifier: Apache-2.0
// fringeslam advise SCENE|DATASET: which coding, how many images and which exposures a scene needs, from images of it. A
// scene is rendered again with the advised patterns and compared with its ground truth.
#include "tools/advise.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/base/shell.h"
#include "core/decode/advice.h"
#include "core/depth/depth.h"
#include "core/io/json_text.h"
#include "core/io/setting_groups.h"
#include "core/mapper/front_end.h"
#include "core/patterns/design.h"
#include "core/rig/dataset.h"
#include "core/score/depth_honesty.h"
#include "core/score/local_scatter.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;

struct AdviseSettings {
  DecodeOptions decode;
  AdviceOptions advice;
  sim::RenderOptions render;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("decode", decode);
    visit("advice", advice);
    visit("render", render);
  }
};

struct AdviseArguments {
  std::string path;
  int views = 3;
  bool unverified = false;
  SceneVariant variant;
  std::vector<std::string> sets;
};

// A view as the advice needs it, and what only the report needs.
struct ExaminedView {
  ViewEvidence evidence;
  ObservedMotion motion = ObservedMotion::unknown;
  LocalScatter scatter;        // of the depth, or of the coordinate without a calibration
  double depth_sigma_m = NAN;  // median
};

struct Verification {
  std::string patterns;
  int images = 0;
  DepthHonesty depth;
};

double rounded(double value, int digits) {
  if (value == 0 || !std::isfinite(value)) return value;
  const double scale = std::pow(10.0, digits - 1 - std::floor(std::log10(std::abs(value))));
  return std::round(value * scale) / scale;
}

double rounded_down(double value, int digits) {
  const double scale = std::pow(10.0, digits - 1 - std::floor(std::log10(value)));
  return std::floor(value * scale) / scale;
}

std::string number(double value, int digits = 2) { return to_text(rounded(value, digits)); }

// 0.99872 as "99.87 %": the digits that the smaller of the share and its complement needs.
std::string percent(double share) {
  const double smaller = 100 * std::min(share, 1 - share);
  const int decimals = smaller <= 0 ? 0 : std::clamp(1 - static_cast<int>(std::floor(std::log10(smaller))), 0, 4);
  char text[32];
  std::snprintf(text, sizeof text, "%.*f %%", decimals, 100 * share);
  return text;
}

double share(int64_t part, int64_t all) { return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0; }

std::string list_of(const std::vector<double>& values, const char* separator) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : separator) + number(value, 5);
  return text;
}

// Runs a part of the analysis, whose errors do not name the input.
template <class Part>
auto naming(const std::string& path, Part&& part) {
  try {
    return part();
  } catch (const Error& e) {
    throw Error(path + ": " + e.what());
  }
}

class Examiner {
 public:
  Examiner(const std::string& path, const RigModel& rig, const PatternSequence& sequence,
           const AdviseSettings& settings, bool times_known)
      : path_(path),
        rig_(rig),
        settings_(settings),
        axis_(naming(path, [&] { return advice_axis(sequence); })),
        times_known_(times_known),
        rays_(pixel_rays(rig.camera)) {
    if (rig.calibrated) triangulation_.emplace(rig, rays_, depth_.near_m, depth_.far_m, axis_);
  }

  Axis axis() const { return axis_; }

  ExaminedView examine(const FringeStack& stack) const {
    ExaminedView view;
    view.evidence = naming(path_, [&] { return fringeslam::examine(stack, rig_, settings_.decode, axis_); });
    if (!view.evidence.decoded.unwrapping || view.evidence.agreement == std::nullopt) return view;
    const DecodedStack& decoded = view.evidence.decoded;
    if (!triangulation_) {
      view.scatter = local_scatter(decoded.coordinate_px, decoded.sigma_px);
      return view;
    }
    Frame frame;
    triangulate(frame, decoded, *triangulation_, depth_);
    cv::Mat1f depth_m;
    cv::extractChannel(frame.points_m, depth_m, 2);
    view.scatter = local_scatter(depth_m, frame.sigma_m);
    std::vector<double> sigmas;
    for (const float sigma : frame.sigma_m) {
      if (!std::isnan(sigma)) sigmas.push_back(static_cast<double>(sigma));
    }
    if (!sigmas.empty()) {
      const auto middle = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 2);
      std::nth_element(sigmas.begin(), middle, sigmas.end());
      view.depth_sigma_m = *middle;
    }
    if (times_known_)
      view.motion = observed_motion(stack, rig_, rays_, filled_depth(depth_m, rig_.middle_range_m()), axis_);
    return view;
  }

  void look(ExaminedView& view, const FringeStack& stack) const {
    add_look(view.evidence, stack, rig_, settings_.decode, axis_);
  }

 private:
  std::string path_;
  const RigModel& rig_;
  const AdviseSettings& settings_;
  Axis axis_;
  bool times_known_;
  DepthOptions depth_;
  PixelRays rays_;
  std::optional<Triangulation> triangulation_;
};

ObservedMotion motion_of(const std::vector<ExaminedView>& views) {
  ObservedMotion motion = ObservedMotion::unknown;
  for (const ExaminedView& view : views) {
    if (view.motion == ObservedMotion::moving) return view.motion;
    if (view.motion == ObservedMotion::none) motion = view.motion;
  }
  return motion;
}

Advice advice_of(const std::vector<ExaminedView>& views, const PatternSequence& sequence, const RigModel& rig,
                 const AdviseSettings& settings) {
  std::vector<ViewEvidence> evidence;
  for (const ExaminedView& view : views) evidence.push_back(view.evidence);
  return advise(evidence, sequence, rig, settings.decode, settings.advice, motion_of(views));
}

// Evidence and checks behind the advice.
struct Report {
  std::string path;
  bool is_scene = false;
  PatternSequence taken;
  RigModel rig;
  double exposure_s = 0;  // at the rig's exposure, of the first view
  std::vector<ExaminedView> views;
  std::vector<double> looks;    // further exposures that were looked at
  bool unchanged = false;       // the advice keeps the scene's patterns
  bool tested_periods = false;  // a further look, because the scene's patterns do not show indirect light
  Advice advice;
  std::vector<Verification> verification;
  std::string unverified;  // why the advised patterns are not among them
};

// Looks again at exposures that show what saturation hides. `look` returns the stacks of the views, or none if that is
// impossible.
template <class LookAt>
void look_further(Report& report, const Examiner& examiner, const AdviseSettings& settings, const LookAt& look) {
  constexpr int kMostLooks = 3;
  for (int i = 0; i < kMostLooks && report.advice.look_first; ++i) {
    const double exposure = *report.advice.look_first;
    PatternSequence patterns = report.taken;
    for (Pattern& pattern : patterns.patterns) pattern.exposure = exposure;
    const std::vector<FringeStack> stacks = look(patterns);
    if (stacks.empty()) return;
    report.looks.push_back(exposure);
    for (size_t k = 0; k < stacks.size(); ++k) examiner.look(report.views[k], stacks[k]);
    report.advice = advice_of(report.views, report.taken, report.rig, settings);
  }
}

std::string design_flags(const SequenceDesign& design) {
  std::string text;
  if (!design.periods_px.empty()) text += " --periods " + list_of(design.periods_px, ",");
  if (design.micro_period_px > 0) text += " --micro " + number(design.micro_period_px, 5);
  if (design.micro_images > 0) text += " --micro-images " + std::to_string(design.micro_images);
  if (design.gray != GrayCode::none) text += std::string(" --gray ") + to_string(design.gray);
  if (!design.gray_xor_px.empty()) text += " --gray-xor " + list_of(design.gray_xor_px, ",");
  text += " --steps " + std::to_string(design.steps);
  if (design.rows) text += design.columns ? " --axis both" : " --axis rows";
  if (design.bits != 8 && design.bits != 0) text += " --bits " + std::to_string(design.bits);
  return text;
}

std::string design_yaml(const SequenceDesign& design, const std::vector<double>& exposures) {
  std::string text = "{axis: ";
  text += design.columns && design.rows ? "both" : design.rows ? "rows" : "columns";
  text += ", steps: " + std::to_string(design.steps);
  if (!design.periods_px.empty()) text += ", periods_px: [" + list_of(design.periods_px, ", ") + "]";
  if (design.micro_period_px > 0) text += ", micro_period_px: " + number(design.micro_period_px, 5);
  if (design.micro_images > 0) text += ", micro_images: " + std::to_string(design.micro_images);
  if (design.gray != GrayCode::none) text += std::string(", gray: ") + to_string(design.gray);
  if (!design.gray_xor_px.empty()) text += ", gray_xor_px: [" + list_of(design.gray_xor_px, ", ") + "]";
  if (exposures.size() > 1) text += ", exposures: [" + list_of(exposures, ", ") + "]";
  return text + "}";
}

// Poses spread over the path.
void thin_trajectory(sim::Scene& scene, int views) {
  const auto n = static_cast<int>(scene.trajectory.size());
  if (scene.path || n <= views) return;
  Trajectory chosen;
  for (int i = 0; i < views; ++i)
    chosen.push_back(scene.trajectory[static_cast<size_t>(views == 1 ? 0 : i * (n - 1) / (views - 1))]);
  scene.trajectory = chosen;
}

// Sets a fixed exposure, and displays patterns long enough for the longest.
void set_exposure(sim::Scene& scene, double exposure_s, double longest) {
  scene.auto_exposure = false;
  Timing& timing = scene.rig.timing;
  timing.exposure_s = rounded_down(exposure_s, 4);
  const double rate_hz = rounded_down(1 / (std::max(1.0, longest) * exposure_s), 3);
  if (timing.pattern_rate_hz <= rate_hz) return;
  timing.pattern_rate_hz = rate_hz;
  timing.camera_rate_hz = std::min(timing.camera_rate_hz, rate_hz);
}

std::vector<sim::SimulatedView> render(const sim::Scene& scene, const PatternSequence& sequence,
                                       const sim::RenderOptions& options, int views, Progress& progress) {
  sim::VirtualRig rig(scene, options);
  std::vector<sim::SimulatedView> all;
  while (static_cast<int>(all.size()) < views) {
    std::optional<sim::SimulatedView> view = rig.simulate(sequence);
    if (!view) break;
    all.push_back(std::move(*view));
    progress.step();
  }
  return all;
}

DepthHonesty honesty_of(const std::vector<sim::SimulatedView>& views, const sim::Scene& scene,
                        const DecodeOptions& options, Axis axis, ObservedMotion motion) {
  DepthHonesty depth;
  const RigModel rig = sim::calibration_of(scene);
  const DepthOptions depth_options;
  const Triangulation triangulation(rig, pixel_rays(rig.camera), depth_options.near_m, depth_options.far_m, axis);
  DecodeContext context;
  context.axis = axis;
  std::optional<FringeFrontEnd> in_motion;
  if (motion == ObservedMotion::moving && axis == Axis::columns && !views.empty())
    in_motion.emplace(rig, views.front().stack.patterns, FrontEndOptions{options, depth_options});
  ReconstructionPrior prior;
  prior.motion = unknown_motion({});
  for (const sim::SimulatedView& view : views)
    depth.add(in_motion ? in_motion->reconstruct(view.stack, prior).frame
                        : reconstruct(decode(view.stack, rig, options, context), rig, triangulation, depth_options),
              view.truth);
  return depth;
}

Report advise_scene(const AdviseArguments& arguments, const AdviseSettings& settings, const Common& common) {
  sim::Scene scene = sim::load_scene(scene_file(arguments.path), arguments.variant.reading());
  thin_trajectory(scene, arguments.views);
  Report report;
  report.path = arguments.path;
  report.is_scene = true;
  report.taken = scene.patterns;
  report.rig = sim::calibration_of(scene);
  Progress progress("looking", arguments.views, common.quiet || common.json);
  std::vector<sim::SimulatedView> first = render(scene, scene.patterns, settings.render, arguments.views, progress);
  if (first.empty()) throw Error(arguments.path + ": its path is too short for one stack");
  const Examiner examiner(report.path, report.rig, scene.patterns, settings, true);
  for (const sim::SimulatedView& view : first) report.views.push_back(examiner.examine(view.stack));
  report.exposure_s = first.front().stack.exposure_s.front() / scene.patterns.patterns.front().exposure;
  report.advice = advice_of(report.views, scene.patterns, report.rig, settings);
  look_further(report, examiner, settings, [&](const PatternSequence& patterns) {
    std::vector<FringeStack> stacks;
    for (sim::SimulatedView& view : render(scene, patterns, settings.render, arguments.views, progress))
      stacks.push_back(std::move(view.stack));
    return stacks;
  });
  if (report.advice.indirect == ObservedIndirect::unknown && !report.advice.nonlinear &&
      report.advice.motion != ObservedMotion::moving) {
    const PatternSequence test = period_test_patterns(scene.patterns);
    const Examiner tester(report.path, report.rig, test, settings, true);
    const std::vector<sim::SimulatedView> views = render(scene, test, settings.render, arguments.views, progress);
    for (size_t i = 0; i < std::min(views.size(), report.views.size()); ++i) {
      const ExaminedView tested = tester.examine(views[i].stack);
      report.views[i].evidence.agreement = tested.evidence.agreement;
      report.views[i].motion = tested.motion;
    }
    report.tested_periods = true;
    report.advice = advice_of(report.views, scene.patterns, report.rig, settings);
  }
  if (arguments.unverified) return report;
  const PatternSequence advised = advised_sequence(report.advice, scene.patterns);
  const auto verify = [&](const std::string& name, const std::vector<sim::SimulatedView>& views) {
    if (views.empty()) return;
    report.verification.push_back({name, static_cast<int>(views.front().stack.images.size()),
                                   honesty_of(views, scene, settings.decode, examiner.axis(), report.advice.motion)});
  };
  verify("present", first);
  first.clear();
  const std::vector<double>& exposures = report.advice.exposures;
  const bool single = exposures.size() == 1;
  const bool same_exposure = single && exposures.front() == 1;
  report.unchanged = same_exposure && advised.patterns == scene.patterns.patterns;
  if (report.unchanged) {
    report.verification.push_back(report.verification.front());
    report.verification.back().patterns = "advised";
    return report;
  }
  if (!same_exposure)
    set_exposure(scene, report.exposure_s * (single ? exposures.front() : 1), single ? 1 : exposures.back());
  std::vector<sim::SimulatedView> views;
  try {
    views = render(scene, advised, settings.render, arguments.views, progress);
    if (views.empty()) report.unverified = "the path is too short for them";
  } catch (const Error& e) {  // such as a view rate that the camera does not reach with them
    report.unverified = e.what();
  }
  verify("advised", views);
  return report;
}

Report advise_dataset(const AdviseArguments& arguments, const AdviseSettings& settings, const Common& common) {
  if (arguments.variant.seed || !arguments.variant.with.empty())
    throw Error(arguments.path + ": --seed and --with have no effect on a recorded dataset; leave them out");
  ReplayRig replay(arguments.path);
  const DatasetInfo& info = replay.info();
  Report report;
  report.path = arguments.path;
  report.taken = replay.sequence();
  report.rig = replay.model();
  const Examiner examiner(report.path, report.rig, report.taken, settings, !info.imported || info.image_times);
  const int views = std::min(arguments.views, info.stacks);
  Progress progress("looking", views, common.quiet || common.json);
  for (int index = 0, next = 0; index < info.stacks && next < views; ++index) {
    const auto stack = replay.capture(report.taken);
    if (!stack) break;
    if (index < (views == 1 ? 0 : next * (info.stacks - 1) / (views - 1))) continue;
    report.views.push_back(examiner.examine(*stack));
    if (next++ == 0) report.exposure_s = stack->exposure_s.front() / report.taken.patterns.front().exposure;
    progress.step();
  }
  if (report.views.empty()) throw Error(arguments.path + ": has no stacks");
  report.advice = advice_of(report.views, report.taken, report.rig, settings);
  return report;
}

std::string size_text(const PatternSequence& sequence) {
  return std::to_string(sequence.width) + "x" + std::to_string(sequence.height);
}

std::string periods_flags(const PatternSequence& sequence) {
  std::vector<double> periods_px;
  const Axis axis = advice_axis(sequence);
  for (const FringeGroup& group : fringe_groups(sequence, axis)) periods_px.push_back(group.period_px);
  return " --periods " + list_of(periods_px, ",") + (axis == Axis::rows ? " --axis rows" : "");
}

// The finest period of the patterns, px; 0: no fringes.
double finest_period_px(const PatternSequence& sequence) {
  const std::vector<FringeGroup> groups = fringe_groups(sequence, advice_axis(sequence));
  return groups.empty() ? 0 : groups.back().period_px;
}

// The coding in words.
std::string coding_text(const CodingChoice& coding) {
  std::string text = coding.name;
  if (!coding.design.periods_px.empty())
    text += ", periods of " + list_of(coding.design.periods_px, ", ") + " px";
  else if (coding.design.micro_period_px > 0)
    text += ", period of " + number(coding.design.micro_period_px, 5) + " px";
  if (!coding.design.gray_xor_px.empty())
    text += ", bits combined by XOR to stripes of " + list_of(coding.design.gray_xor_px, ", ") + " px";
  return text + ", " + std::to_string(coding.design.steps) + " steps" + (coding.current ? " (as in these images)" : "");
}

std::string view_text(const ExaminedView& view) {
  const ViewEvidence& e = view.evidence;
  std::string text = "  view " + std::to_string(e.index) + ": " + percent(share(e.valid, e.pixels)) + " valid, " +
                     percent(share(e.saturated, e.pixels)) + " saturated, " + percent(share(e.unlit, e.pixels)) +
                     " without fringes, " + percent(share(e.noisy, e.pixels)) + " too dark, " +
                     percent(share(e.rejected, e.pixels)) + " contradictory\n    modulation";
  for (const double dn : e.modulation_dn) text += " " + number(dn);
  text += " DN (1, 10, 50, 90, 99 % of the lit pixels)";
  if (!std::isnan(e.phase_sigma_rad)) text += "; sigma: phase " + number(e.phase_sigma_rad) + " rad";
  if (!std::isnan(view.depth_sigma_m)) text += ", depth " + number(1e3 * view.depth_sigma_m) + " mm";
  if (!std::isnan(e.light.noise_ratio) || view.scatter.windows > 0) text += "\n    measured / predicted:";
  if (!std::isnan(e.light.noise_ratio)) text += " noise " + number(e.light.noise_ratio);
  if (view.scatter.windows > 0)
    text += std::string(std::isnan(e.light.noise_ratio) ? " " : ", ") + "scatter of the " +
            (std::isnan(view.depth_sigma_m) ? "coordinate " : "depth ") + number(view.scatter.over_sigma);
  if (e.agreement && e.agreement->tested > 0)
    text += "\n    periods disagree by more than 4 sigmas on " +
            percent(share(e.agreement->biased, e.agreement->tested)) + " of the smooth surfaces" +
            (e.agreement->biased > 0 ? ", by " + number(e.agreement->bias_rad) + " rad" : "");
  return text + "\n";
}

// Shares of the lit pixels that a coding decodes, by exposures.
std::string coverage_text(const CodingChoice& coding) {
  std::string text;
  for (size_t k = 0; k < coding.covered.size(); ++k)
    text += (k == 0 ? "" : "; ") + std::string("[") + list_of(coding.exposures[k], ", ") + "] " +
            percent(coding.covered[k]);
  return text;
}

double largest(const Report& report, double PeriodAgreement::*value) {
  double most = 0;
  for (const ExaminedView& view : report.views) {
    if (view.evidence.agreement) most = std::max(most, (*view.evidence.agreement).*value);
  }
  return most;
}

int64_t total(const Report& report, int64_t ViewEvidence::*count) {
  int64_t sum = 0;
  for (const ExaminedView& view : report.views) sum += view.evidence.*count;
  return sum;
}

std::string coding_reason(const Report& report) {
  const Advice& advice = report.advice;
  if (advice.motion == ObservedMotion::moving)
    return "the images show motion: its estimate needs several periods, and in motion neither micro phase shifting nor "
           "several exposures can be decoded";
  if (advice.nonlinear) return "provisional: the response of the projector must be corrected first";
  if (advice.indirect == ObservedIndirect::present)
    return "indirect light: on " + percent(advice.biased_share) +
           " of the smooth surfaces, neighboring pixels share a phase error of more than 4 sigmas, " +
           number(largest(report, &PeriodAgreement::bias_rad)) +
           " rad in the median. To short periods alone, indirect light is a constant";
  std::string text;
  if (advice.indirect == ObservedIndirect::none)
    text = "the periods agree on " + percent(1 - advice.biased_share) +
           " of the smooth surfaces, so indirect light is weak; ";
  return text + "the shortest capture that decodes " + percent(advice.covered) + " of the lit pixels";
}

std::string exposure_reason(const Report& report) {
  const Advice& advice = report.advice;
  std::string text = "predicted share of the lit pixels with depth: " + coverage_text(advice.coding);
  if (advice.exposures.size() == 1 && !advice.coding.decodes_exposures) {
    const CodingChoice* wider = nullptr;
    for (const CodingChoice& choice : advice.alternatives) {
      if (choice.decodes_exposures && choice.covered.size() > 1 &&
          (!wider || choice.covered.back() > wider->covered.back()))
        wider = &choice;
    }
    if (wider && wider->covered.back() > advice.covered + 0.01)
      text += ". " + advice.coding.name + " decodes one exposure only; " + wider->name + " at [" +
              list_of(wider->exposures.back(), ", ") + "] reaches " + percent(wider->covered.back()) +
              (advice.indirect == ObservedIndirect::present ? ", but with the bias of the indirect light" : "");
  }
  return text;
}

std::vector<std::string> unknowns_of(const Report& report) {
  const Advice& advice = report.advice;
  std::vector<std::string> unknowns;
  if (advice.look_first)
    unknowns.push_back("the brightness of " + percent(advice.hidden_share) +
                       " of the lit pixels, which are saturated; look first at an exposure of " +
                       number(*advice.look_first, 3) + " times the present one, and ask again");
  const int64_t unlit = total(report, &ViewEvidence::unlit);
  if (unlit > 0)
    unknowns.push_back("whether the " + percent(share(unlit, total(report, &ViewEvidence::pixels))) +
                       " of pixels without fringes are shadow, empty, or darker than the noise");
  if (advice.motion == ObservedMotion::moving) {
    unknowns.push_back("whether indirect light disturbs the phases: motion does, too; look again at rest");
  } else if (advice.nonlinear) {
    unknowns.push_back(
        "whether indirect light disturbs the phases: the nonlinear response hides it; calibrate response, and ask "
        "again");
  } else if (advice.indirect == ObservedIndirect::unknown) {
    double unmodulated = NAN;
    for (const ExaminedView& view : report.views) {
      if (view.evidence.agreement) unmodulated = view.evidence.agreement->unmodulated;
    }
    unknowns.push_back(
        "whether indirect light disturbs the phases: only fringes of several periods, with a coordinate, show it" +
        (std::isnan(unmodulated) ? std::string()
                                 : ". Relative to the direct light it is at most " + number(unmodulated) +
                                       ", the light that is not modulated, of which ambient light is a part") +
        (report.is_scene ? ""
                         : ". For a test, capture these: fringeslam patterns --size " + size_text(report.taken) +
                               periods_flags(period_test_patterns(report.taken)) + " --out test"));
  } else {
    unknowns.push_back(
        "indirect light that reaches the finest period, too, as in translucent surfaces, very narrow corners, glass "
        "and "
        "mirrors");
  }
  const double seen_px = finest_period_px(report.taken),
               advised_px = finest_period_px(advised_sequence(advice, report.taken));
  if (advised_px < 0.99 * seen_px || (seen_px == 0 && advised_px > 0))
    unknowns.push_back("how much the lenses blur a period of " + number(advised_px, 3) +
                       " px: these images hold none as fine");
  if (advice.motion == ObservedMotion::unknown)
    unknowns.push_back(
        "whether the camera moved: that takes a calibrated rig, image times, and several periods at one exposure");
  if (std::all_of(report.views.begin(), report.views.end(),
                  [](const ExaminedView& view) { return std::isnan(view.evidence.light.noise_ratio); }))
    unknowns.push_back(
        "whether the rig's noise model is right: these patterns leave no residuals; see calibrate noise");
  return unknowns;
}

std::vector<std::string> warnings_of_rig(const Report& report) {
  std::vector<std::string> warnings;
  const double ripple = largest(report, &PeriodAgreement::ripple_rad),
               sigma = largest(report, &PeriodAgreement::sigma_rad);
  if (report.advice.nonlinear || (report.advice.motion != ObservedMotion::moving && ripple > sigma))
    warnings.push_back("the phases ripple by " + number(ripple) +
                       " rad, more than their sigma: the projector's response is not linear; see calibrate response");
  return warnings;
}

// The changes of exposure and display time for `--with`; empty if there are none.
std::vector<std::string> exposure_changes(const Report& report) {
  const std::vector<double>& exposures = report.advice.exposures;
  if (exposures.size() == 1 && exposures.front() == 1) return {};
  sim::Scene scene;
  scene.rig = report.rig;
  set_exposure(scene, report.exposure_s * (exposures.size() == 1 ? exposures.front() : 1),
               exposures.size() == 1 ? 1 : exposures.back());
  const Timing &before = report.rig.timing, &after = scene.rig.timing;
  std::vector<std::string> changes = {"light.auto_exposure=false", "light.exposure_s=" + to_text(after.exposure_s)};
  if (after.pattern_rate_hz != before.pattern_rate_hz)
    changes.push_back("rig.timing.pattern_rate_hz=" + to_text(after.pattern_rate_hz));
  if (after.camera_rate_hz != before.camera_rate_hz)
    changes.push_back("rig.timing.camera_rate_hz=" + to_text(after.camera_rate_hz));
  return changes;
}

bool names_patterns(const CodingChoice& coding) {
  return !coding.design.periods_px.empty() || coding.design.micro_period_px > 0;
}

// Lines to copy.
std::vector<std::string> commands_of(const Report& report) {
  const Advice& advice = report.advice;
  const bool named = names_patterns(advice.coding);
  std::vector<std::string> lines;
  if (named)
    lines.push_back("fringeslam patterns --size " + size_text(report.taken) + design_flags(advice.coding.design) +
                    (advice.exposures.size() > 1 ? " --exposures " + list_of(advice.exposures, ",") : "") +
                    " --out patterns");
  if (!report.is_scene) return lines;
  std::string run = "fringeslam run " + shell_word(report.path);
  if (named)
    run += " --with 'patterns=" + design_yaml(advice.coding.design, advice.exposures) + "'";
  else if (advice.exposures.size() > 1)
    run += " --with 'patterns.exposures=[" + list_of(advice.exposures, ", ") + "]'";
  for (const std::string& change : exposure_changes(report)) run += " --with " + change;
  lines.push_back(run);
  return lines;
}

std::string text_of(const Report& report) {
  const Advice& advice = report.advice;
  std::string text = "what the images show\n";
  for (const ExaminedView& view : report.views) text += view_text(view);
  text +=
      std::string("  motion: ") + to_string(advice.motion) + "; indirect light: " + to_string(advice.indirect) + "\n";
  for (const double look : report.looks)
    text += "  a further look at " + number(look, 3) + " times the exposure shows what saturation hid\n";
  if (report.tested_periods) text += "  a further look with three periods tests for indirect light\n";
  for (const std::string& warning : warnings_of_rig(report)) text += "  " + warning + "\n";
  text += "advice\n  coding: " + coding_text(advice.coding) + "\n    " + coding_reason(report) + "\n  exposures: [" +
          list_of(advice.exposures, ", ") + "] times the rig's (" + number(1e3 * report.exposure_s, 3) + " ms)\n    " +
          exposure_reason(report) + "\n  images: " + std::to_string(advice.images) + " per view, now " +
          std::to_string(report.taken.patterns.size()) + "\n";
  if (advice.exposures.size() == 1 && advice.exposures.front() != 1 && !report.is_scene)
    text +=
        "    set the camera's exposure to " + number(1e3 * report.exposure_s * advice.exposures.front(), 3) + " ms\n";
  for (const std::string& line : commands_of(report)) text += "  " + line + "\n";
  if (!names_patterns(advice.coding) && !report.is_scene) text += "  keep the recorded patterns\n";
  text += "what these images cannot show\n";
  for (const std::string& unknown : unknowns_of(report)) text += "  - " + unknown + "\n";
  if (!report.verification.empty()) text += "check against ground truth, in the same views\n";
  if (!report.unverified.empty()) text += "  the advised patterns are not checked: " + report.unverified + "\n";
  for (const Verification& v : report.verification) {
    if (report.unchanged && v.patterns == "advised") continue;
    text += "  " + v.patterns + " patterns: " + std::to_string(v.images) + " images, " +
            percent(v.depth.measured_share()) + " of the pixels in the beam have depth, " +
            percent(v.depth.dishonest_share()) + " of these are off by more than 4 sigmas\n";
  }
  if (report.unchanged) text += "  the advice keeps these patterns\n";
  text.pop_back();
  return text;
}

Json number_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

Json json_of(const ExaminedView& view) {
  const ViewEvidence& e = view.evidence;
  Json json = {{"view", e.index},
               {"valid", share(e.valid, e.pixels)},
               {"saturated", share(e.saturated, e.pixels)},
               {"without_fringes", share(e.unlit, e.pixels)},
               {"too_dark", share(e.noisy, e.pixels)},
               {"contradictory", share(e.rejected, e.pixels)},
               {"phase_sigma_rad", number_or_null(e.phase_sigma_rad)},
               {"depth_sigma_m", number_or_null(view.depth_sigma_m)},
               {"noise_over_predicted", number_or_null(e.light.noise_ratio)},
               {"scatter_over_sigma", view.scatter.windows > 0 ? number_or_null(view.scatter.over_sigma) : Json()},
               {"motion", to_string(view.motion)}};
  for (size_t i = 0; i < e.modulation_dn.size(); ++i)
    json["modulation_dn"].push_back(
        {{"quantile", kModulationQuantiles[i]}, {"value", number_or_null(e.modulation_dn[i])}});
  if (e.agreement)
    json["periods"] = {
        {"tested_pixels", e.agreement->tested}, {"biased", share(e.agreement->biased, e.agreement->tested)},
        {"bias_rad", e.agreement->bias_rad},    {"ripple_rad", e.agreement->ripple_rad},
        {"sigma_rad", e.agreement->sigma_rad},  {"unmodulated", number_or_null(e.agreement->unmodulated)}};
  return json;
}

Json json_of(const CodingChoice& coding) {
  Json json = {{"name", coding.name},
               {"periods_px", coding.design.periods_px},
               {"micro_period_px", coding.design.micro_period_px},
               {"gray_xor_px", coding.design.gray_xor_px},
               {"steps", coding.design.steps},
               {"present", coding.current},
               {"images", coding.images},
               {"max_phase_sigma_rad", coding.demand.max_phase_sigma_rad}};
  for (size_t k = 0; k < coding.covered.size(); ++k)
    json["by_exposures"].push_back({{"exposures", coding.exposures[k]}, {"covered", coding.covered[k]}});
  return json;
}

Json json_of(const Report& report) {
  const Advice& advice = report.advice;
  Json json = {{"path", report.path}, {"views", Json::array()}};
  for (const ExaminedView& view : report.views) json["views"].push_back(json_of(view));
  json["looks"] = report.looks;
  json["tested_periods"] = report.tested_periods;
  json["motion"] = to_string(advice.motion);
  json["indirect"] = to_string(advice.indirect);
  json["nonlinear"] = advice.nonlinear;
  json["warnings"] = warnings_of_rig(report);
  json["advice"] = {{"coding", json_of(advice.coding)},
                    {"coding_reason", coding_reason(report)},
                    {"exposures", advice.exposures},
                    {"exposure_s", report.exposure_s},
                    {"exposure_reason", exposure_reason(report)},
                    {"images", advice.images},
                    {"covered", advice.covered},
                    {"hidden", advice.hidden_share},
                    {"look_first", advice.look_first ? Json(*advice.look_first) : Json()},
                    {"commands", commands_of(report)}};
  for (const CodingChoice& choice : advice.alternatives) json["codings"].push_back(json_of(choice));
  json["unknown"] = unknowns_of(report);
  for (const Verification& v : report.verification)
    json["check"][v.patterns] = {{"images", v.images},
                                 {"lit_pixels", v.depth.lit},
                                 {"valid", v.depth.measured_share()},
                                 {"beyond_4_sigma", v.depth.dishonest_share()}};
  return json;
}

int advise_path(const AdviseArguments& arguments, const Common& common) {
  AdviseSettings settings;
  apply_settings(settings, arguments.sets);
  settings.render.check();
  std::error_code ignored;
  const bool dataset = fs::exists(fs::path(arguments.path) / kDatasetFile, ignored);
  const Report report =
      dataset ? advise_dataset(arguments, settings, common) : advise_scene(arguments, settings, common);
  print_result(common, json_of(report), text_of(report));
  return 0;
}

}  // namespace

namespace {

// Captures and examines one view with `sequence`, and further looks where it is saturated.
Report look_with(Rig& rig, const Look& look, const PatternSequence& sequence, const std::string& path,
                 const AdviseSettings& settings) {
  Report report;
  report.path = path;
  report.rig = rig.model();
  report.taken = sequence;
  const Examiner examiner(path, report.rig, report.taken, settings, true);
  const std::optional<FringeStack> stack = rig.capture(report.taken);
  if (!stack) throw Error(path + ": has no stacks");
  report.views.push_back(examiner.examine(*stack));
  report.exposure_s = stack->exposure_s.front();
  report.advice = advice_of(report.views, report.taken, report.rig, settings);
  look_further(report, examiner, settings, [&](const PatternSequence& patterns) {
    std::vector<FringeStack> stacks;
    if (std::optional<FringeStack> other = look(patterns)) stacks.push_back(std::move(*other));
    return stacks;
  });
  return report;
}

}  // namespace

RigAdvice advise_for(Rig& rig, const Look& look, const std::string& path, bool takes_exposures) {
  const PatternSequence sequence = default_sequence(rig.model().projector.width, rig.model().projector.height);
  AdviseSettings settings;
  // The images of packed patterns are as long as the projector shows each of them.
  if (!takes_exposures) settings.advice.most_exposures = 1, settings.advice.longest = 1;
  const Report report = look_with(rig, look, sequence, path, settings);
  return {json_of(report), text_of(report)};
}

ExposureChoice exposures_for(Rig& rig, const Look& look, const PatternSequence& sequence, const std::string& path) {
  if (has_exposures(sequence)) throw Error(path + ": the patterns have exposures already");
  const AdviseSettings settings;
  const Report report = look_with(rig, look, sequence, path, settings);
  return naming(path, [&] { return present_exposures(report.advice, settings.advice.covered); });
}

Verb add_advise(Command app, const Common& common) {
  auto a = std::make_shared<AdviseArguments>();
  const Command verb = app.add_subcommand(
      "advise", "Advise which coding, how many images and which exposures a scene or dataset needs, from its images");
  verb.add_option("path", a->path, "Scene file, folder with scene.yaml, or dataset folder").required();
  verb.add_option("--views", a->views, "Number of views, spread over the path or recording").check_range(1, 1000);
  verb.add_flag("--no-check", a->unverified, "Scenes: do not render the advised patterns");
  a->variant.add_to(verb);
  verb.add_option("--set", a->sets, "decode.key=value, advice.key=value, render.key=value (repeatable; listed below)");
  verb.footer(groups_help(AdviseSettings()));
  return [a, &common] { return advise_path(*a, common); };
}

}  // namespace fringeslam::tools
