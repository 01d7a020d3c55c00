// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/recognition.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "core/base/parallel.h"
#include "core/landmarks/keypoints.h"
#include "core/landmarks/mutual_nearest.h"

namespace fringeslam {

namespace {

constexpr double kUnitLength = 510;  // of a quantised unit vector
constexpr double kFinal_px = 0.1;    // added to the sigma of verified keypoints, pixel footprints

template <class List>
auto& at(List& list, int i) {
  return list[static_cast<size_t>(i)];
}

// Nearest and second-nearest descriptor of one view.
struct Nearest {
  int view = 0, entry = -1;
  int distance2 = 0, second2 = 0;  // second2 is 0 if there is none
};

void note(std::vector<Nearest>& nearest, int view, int entry, int distance2) {
  for (Nearest& n : nearest) {
    if (n.view != view) continue;
    // Among equal distances the lowest entry wins.
    if (distance2 < n.distance2 || (distance2 == n.distance2 && entry < n.entry)) {
      n = {view, entry, distance2, n.distance2};
    } else if (n.second2 == 0 || distance2 < n.second2) {
      n.second2 = distance2;
    }
    return;
  }
  nearest.push_back({view, entry, distance2, 0});
}

double footprint_m(const Eigen::Vector3d& point, const Pinhole& camera) {
  return std::max(0.0, point.z()) / std::min(camera.fx, camera.fy);
}

// Returns the landmarks of each keypoint.
std::vector<std::vector<int>> owners_of(const Landmarks& landmarks) {
  std::vector<std::vector<int>> owners(landmarks.keypoints.keypoints.size());
  for (size_t l = 0; l < landmarks.landmarks.size(); ++l) {
    for (const int k : landmarks.landmarks[l].keypoints) at(owners, k).push_back(static_cast<int>(l));
  }
  return owners;
}

// Returns the keypoints of each landmark in descending order of strength.
std::vector<std::vector<int>> by_strength(const Landmarks& landmarks) {
  const std::vector<Keypoint>& keypoints = landmarks.keypoints.keypoints;
  std::vector<std::vector<int>> result;
  for (const Landmark& landmark : landmarks.landmarks) {
    std::vector<int>& own = result.emplace_back(landmark.keypoints);
    std::stable_sort(own.begin(), own.end(),
                     [&](int a, int b) { return at(keypoints, a).strength > at(keypoints, b).strength; });
  }
  return result;
}

}  // namespace

LandmarkDatabase::LandmarkDatabase(const Pinhole& camera, const RecognitionOptions& options)
    : camera_(camera), options_(options) {
  check_options(options, "recognition");
}

LandmarkDigest digest_of(const Landmarks& landmarks) {
  const std::vector<Keypoint>& keypoints = landmarks.keypoints.keypoints;
  LandmarkDigest digest;
  digest.keypoints = static_cast<int>(keypoints.size());
  digest.strongest = by_strength(landmarks);
  std::set<int> indices;
  for (std::vector<int>& own : digest.strongest) {
    own.resize(std::min<size_t>(own.size(), LandmarkDigest::kMost));
    indices.insert(own.begin(), own.end());
  }
  digest.indices.assign(indices.begin(), indices.end());
  const std::vector<int> place = places_of(keypoints);
  const std::vector<std::vector<int>> owners = owners_of(landmarks);
  digest.descriptors.create(static_cast<int>(digest.indices.size()), kDescriptorSize);
  for (const int k : digest.indices) {
    const int row = static_cast<int>(digest.details.size());
    digest.details.push_back(at(keypoints, k));
    digest.place.push_back(at(place, k));
    digest.starts.push_back(static_cast<int>(digest.owners.size()));
    digest.owners.insert(digest.owners.end(), at(owners, k).begin(), at(owners, k).end());
    quantised(landmarks.keypoints.descriptors.row(k)).copyTo(digest.descriptors.row(row));
  }
  digest.starts.push_back(static_cast<int>(digest.owners.size()));
  return digest;
}

int LandmarkDatabase::View::in_digest(int keypoint) const {
  if (!digest) return -1;
  const auto found = std::lower_bound(digest->indices.begin(), digest->indices.end(), keypoint);
  return found != digest->indices.end() && *found == keypoint ? static_cast<int>(found - digest->indices.begin()) : -1;
}

const Keypoint& LandmarkDatabase::View::keypoint(int keypoint) const {
  const int i = in_digest(keypoint);
  return i >= 0 ? at(digest->details, i) : at(*details().keypoints, keypoint);
}

int LandmarkDatabase::View::place(int keypoint) const {
  const int i = in_digest(keypoint);
  return i >= 0 ? at(digest->place, i) : at(details().place, keypoint);
}

const uchar* LandmarkDatabase::View::descriptor(int keypoint) const {
  const int i = in_digest(keypoint);
  return i >= 0 ? digest->descriptors[i] : details().descriptors[keypoint];
}

std::span<const int> LandmarkDatabase::View::landmarks_of(int keypoint) const {
  const auto range = [](const std::vector<int>& owners, const std::vector<int>& starts, int i) {
    const auto first = static_cast<size_t>(at(starts, i)), end = static_cast<size_t>(at(starts, i + 1));
    return std::span(owners).subspan(first, end - first);
  };
  const int i = in_digest(keypoint);
  return i >= 0 ? range(digest->owners, digest->starts, i) : range(details().owners, details().starts, keypoint);
}

LandmarkDatabase::Details LandmarkDatabase::details_of(const Landmarks& landmarks,
                                                       std::shared_ptr<const std::vector<Keypoint>> keypoints) {
  Details details;
  details.keypoints = std::move(keypoints);
  details.descriptors = quantised(landmarks.keypoints.descriptors);
  details.place = places_of(*details.keypoints);
  for (const std::vector<int>& owners : owners_of(landmarks)) {
    if (!owners.empty()) details.owned.push_back(static_cast<int>(details.starts.size()));
    details.starts.push_back(static_cast<int>(details.owners.size()));
    details.owners.insert(details.owners.end(), owners.begin(), owners.end());
  }
  details.starts.push_back(static_cast<int>(details.owners.size()));
  std::stable_sort(details.owned.begin(), details.owned.end(), [&](int a, int b) {
    return at(*details.keypoints, a).point_m.x() < at(*details.keypoints, b).point_m.x();
  });
  return details;
}

// Selects the keypoints that are searched and queried, given those of each landmark in descending order of strength.
void LandmarkDatabase::select(View& view, const std::vector<std::vector<int>>& by_strength) const {
  const auto first_of_each = [&](int count) {
    std::vector<int> selected;
    for (const std::vector<int>& own : by_strength)
      selected.insert(selected.end(), own.begin(), own.begin() + std::min<std::ptrdiff_t>(std::ssize(own), count));
    std::sort(selected.begin(), selected.end());
    selected.erase(std::unique(selected.begin(), selected.end()), selected.end());
    return selected;
  };
  view.queried = first_of_each(options_.strongest / 2);
  view.strongest = first_of_each(options_.strongest);
  view.landmarks = by_strength.size();
}

LandmarkDatabase::View LandmarkDatabase::view_of(int frame, std::shared_ptr<const Landmarks> landmarks) const {
  View view;
  view.frame = frame;
  view.keypoints = landmarks->keypoints.keypoints.size();
  select(view, by_strength(*landmarks));
  std::call_once(view.loaded->once, [&] {
    view.loaded->details = details_of(*landmarks, {landmarks, &landmarks->keypoints.keypoints});
  });
  return view;
}

LandmarkDatabase::View LandmarkDatabase::view_of(int frame, const KnownLandmarks& known) const {
  if (!known.digest() || options_.strongest > LandmarkDigest::kMost) return view_of(frame, known.get());
  View view;
  view.frame = frame;
  view.keypoints = static_cast<size_t>(known.digest()->keypoints);
  select(view, known.digest()->strongest);
  view.digest = known.digest();
  view.load = [known] {
    const std::shared_ptr<const Landmarks> landmarks = known.get();
    // A copy, because the landmarks have large descriptors.
    return details_of(*landmarks, std::make_shared<const std::vector<Keypoint>>(landmarks->keypoints.keypoints));
  };
  return view;
}

void LandmarkDatabase::add(int frame, const KnownLandmarks& landmarks) {
  std::vector<View> added;
  added.push_back(view_of(frame, landmarks));
  add(std::move(added));
}

void LandmarkDatabase::add(int first, int count, const std::function<const KnownLandmarks&(int frame)>& landmarks_of) {
  std::vector<View> added(static_cast<size_t>(count));
  for_each_row(count, [&](int i) { at(added, i) = view_of(first + i, landmarks_of(first + i)); });
  add(std::move(added));
}

void LandmarkDatabase::add(std::vector<View> added) {
  // Which descriptors each tree contains; the empty ones are built afterwards.
  for (View& view : added) {
    const int number = static_cast<int>(views_.size()), before = keypoints();
    for (const int k : view.strongest) entries_.push_back({number, k});
    landmark_count_ += static_cast<int>(view.landmarks);
    views_.push_back(std::move(view));
    if (keypoints() == before) continue;
    Run run{before, keypoints(), {}};
    while (!runs_.empty() && runs_.back().end - runs_.back().first < 2 * (keypoints() - run.first)) {
      run.first = runs_.back().first;
      runs_.pop_back();
    }
    runs_.push_back(std::move(run));
  }
  for (Run& run : runs_) {
    if (run.tree.size() > 0) continue;
    cv::Mat1b descriptors(run.end - run.first, kDescriptorSize);
    for_each_row(descriptors.rows,
                 [&](int i) { std::copy_n(descriptor_of(run.first + i), kDescriptorSize, descriptors[i]); });
    run.tree = DescriptorTree(descriptors);
  }
}

const uchar* LandmarkDatabase::descriptor_of(int entry) const {
  const Entry& of = at(entries_, entry);
  return at(views_, of.view).descriptor(of.keypoint);
}

std::vector<LandmarkDatabase::Matches> LandmarkDatabase::matches_by_view(const View& current, int max_leaves) const {
  const int queries = static_cast<int>(current.queried.size());
  std::vector<std::vector<Nearest>> nearest(current.queried.size());
  for_each_row(queries, [&](int q) {
    const uchar* descriptor = current.descriptor(at(current.queried, q));
    std::vector<Nearest>& own = at(nearest, q);
    const auto note_entry = [&](int entry, int distance2) { note(own, at(entries_, entry).view, entry, distance2); };
    if (options_.search == DescriptorSearch::brute_force) {
      for (int e = 0; e < keypoints(); ++e) note_entry(e, squared_distance(descriptor, descriptor_of(e)));
      return;
    }
    for (const Run& run : runs_) {
      // Each tree visits a number of leaves proportional to its size.
      const int leaves = static_cast<int>(std::max<int64_t>(2, int64_t{max_leaves} * run.tree.size() / keypoints()));
      run.tree.visit_nearest_leaves(descriptor, leaves, [&](int i, int d2) { note_entry(run.first + i, d2); });
    }
  });
  std::vector<Matches> matches(views_.size());
  const double most = options_.max_ratio * options_.max_ratio;
  for (int q = 0; q < queries; ++q) {
    for (const Nearest& n : at(nearest, q)) {
      if (n.second2 > 0 && n.distance2 > most * n.second2) continue;
      at(matches, n.view)
          .push_back({at(entries_, n.entry).keypoint, at(current.queried, q), std::sqrt(n.distance2) / kUnitLength,
                      n.second2 > 0 ? std::sqrt(static_cast<double>(n.distance2) / n.second2) : 0});
    }
  }
  return matches;
}

// Keeps matches in the order of their distances, each position of both views at most once.
LandmarkDatabase::Matches LandmarkDatabase::one_to_one(Matches matches, const View& earlier,
                                                       const View& current) const {
  keep_one_to_one(
      matches, static_cast<size_t>(earlier.keypoints), [&](int k) { return earlier.place(k); },
      static_cast<size_t>(current.keypoints), [&](int k) { return current.place(k); });
  return matches;
}

RigidConsensus LandmarkDatabase::consensus(const View& earlier, const View& current, const Matches& matches,
                                           double spread_px, int random_triples) const {
  std::vector<WeightedPair> pairs;
  for (const KeypointMatch& match : matches) {
    const Keypoint &e = earlier.keypoint(match.earlier), &c = current.keypoint(match.current);
    const double noise = std::sqrt((e.covariance_m2 + c.covariance_m2).trace() / 3);
    pairs.push_back({e.point_m, c.point_m, std::hypot(noise, spread_px * footprint_m(e.point_m, camera_))});
  }
  return rigid_consensus(pairs, options_.inlier_sigma, random_triples);
}

// Matches keypoints of the current landmarks with keypoints of earlier landmarks near the position predicted by the
// motion: the nearest descriptor wins, provided that its scale agrees with the ratio of the depths.
LandmarkDatabase::Matches LandmarkDatabase::guided_matches(const View& earlier, const View& current,
                                                           const Pose& earlier_from_current, double distance_px) const {
  constexpr double kMostScale = 1.5;  // an octave has three scales
  const double most = options_.max_guided_ratio * kUnitLength;
  const Details &seen = earlier.details(), &now = current.details();
  Matches matches;
  for (const int q : now.owned) {
    const Keypoint& keypoint = at(*now.keypoints, q);
    const Eigen::Vector3d expected = earlier_from_current * keypoint.point_m;
    const double distance_m = distance_px * footprint_m(expected, camera_);
    const auto first = std::lower_bound(seen.owned.begin(), seen.owned.end(), expected.x() - distance_m,
                                        [&](int k, double x) { return at(*seen.keypoints, k).point_m.x() < x; });
    int best = -1;
    double best_distance2 = most * most;
    for (auto k = first; k != seen.owned.end(); ++k) {
      const Keypoint& other = at(*seen.keypoints, *k);
      if (other.point_m.x() > expected.x() + distance_m) break;
      if ((other.point_m - expected).squaredNorm() > distance_m * distance_m) continue;
      const double scale = other.scale * other.point_m.z() / (keypoint.scale * keypoint.point_m.z());
      if (scale > kMostScale || scale < 1 / kMostScale) continue;
      const int distance2 = squared_distance(now.descriptors[q], seen.descriptors[*k]);
      if (distance2 < best_distance2) best_distance2 = distance2, best = *k;
    }
    if (best >= 0) matches.push_back({best, q, std::sqrt(best_distance2) / kUnitLength, 0});
  }
  return one_to_one(std::move(matches), earlier, current);
}

// Returns the mutual nearest neighbours among all keypoints of landmarks that pass the ratio test.
LandmarkDatabase::Matches LandmarkDatabase::all_matches(const View& earlier, const View& current) const {
  const Details &seen = earlier.details(), &now = current.details();
  const auto distance2 = [&](int e, int c) {
    return squared_distance(seen.descriptors[at(seen.owned, e)], now.descriptors[at(now.owned, c)]);
  };
  Matches matches;
  for (const MutualPair& pair : mutual_nearest(static_cast<int>(seen.owned.size()), static_cast<int>(now.owned.size()),
                                               distance2, 1, options_.max_ratio))
    matches.push_back(
        {at(seen.owned, pair.earlier), at(now.owned, pair.current), pair.distance / kUnitLength, pair.ratio});
  return matches;
}

// If enough matches agree on the motion since a view, matches all keypoints by the positions it predicts; returns
// whether they do.
bool LandmarkDatabase::search_guided(const View& earlier, const View& current, Matches& matches) const {
  constexpr int kTriples = 4000;  // sufficient for 10 % inliers
  RigidConsensus motion =
      consensus(earlier, current, one_to_one(matches, earlier, current), options_.viewpoint_px, kTriples);
  Matches found;
  // The second pass uses the motion refined with the matches of the first pass.
  for (const double share : {1.0, 0.5}) {
    if (static_cast<int>(motion.inliers.size()) < options_.min_consensus) return false;
    found = guided_matches(earlier, current, motion.earlier_from_current, share * options_.guided_distance_px);
    motion = consensus(earlier, current, found, share == 1 ? options_.viewpoint_px : kFinal_px, kTriples);
  }
  matches.clear();
  for (const int i : motion.inliers) matches.push_back(at(found, i));
  return true;
}

// Searches the views with most matches guided; returns whether the motion since any of them was found.
bool LandmarkDatabase::search_views(const View& current, int max_views, std::vector<Matches>& matches) const {
  std::vector<int> order(views_.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return at(matches, a).size() > at(matches, b).size(); });
  order.resize(std::min(order.size(), static_cast<size_t>(max_views)));
  for (const int view : order) (void)at(views_, view).details();  // an Error must not arise in a parallel loop
  std::vector<char> known(order.size(), 0);
  for_each_row(static_cast<int>(order.size()), [&](int i) {
    const int view = at(order, i);
    at(known, i) = search_guided(at(views_, view), current, at(matches, view));
  });
  return std::find(known.begin(), known.end(), char{1}) != known.end();
}

// Repeats lookup and guided search with more leaves and views; returns whether any view is recognized then. Among the
// keypoints of a large map, a short lookup misses many neighbors, and views that share little surface with this one may have
// more matches by chance.
bool LandmarkDatabase::search_longer(const View& current, std::vector<Matches>& matches) const {
  constexpr int kViews = 8;
  for (const int leaves : {8, 128}) {
    std::vector<Matches> more = matches_by_view(current, leaves * options_.max_leaves);
    if (!search_views(current, kViews * options_.max_views, more)) continue;
    matches = std::move(more);
    return true;
  }
  return false;
}

// Returns the earlier landmarks that may be the same as `landmark`, the most promising first, each with the matches
// that agree on one motion.
std::vector<Recognition> LandmarkDatabase::candidates_of(int landmark, const std::vector<Matches>& matches,
                                                         const View& current) const {
  struct Candidate {
    int view;
    Recognition recognition;
  };
  std::vector<Candidate> candidates;
  for (size_t v = 0; v < matches.size(); ++v) {
    const View& seen = views_[v];
    std::map<int, Matches> by_landmark;
    for (const KeypointMatch& match : matches[v]) {
      const std::span<const int> owners = current.landmarks_of(match.current);
      if (std::find(owners.begin(), owners.end(), landmark) == owners.end()) continue;
      for (const int earlier : seen.landmarks_of(match.earlier)) by_landmark[earlier].push_back(match);
    }
    for (auto& [earlier, list] : by_landmark) {
      Matches once = one_to_one(std::move(list), seen, current);
      if (static_cast<int>(once.size()) >= options_.min_matches)
        candidates.push_back({static_cast<int>(v), {landmark, seen.frame, earlier, std::move(once), {}}});
    }
  }
  // Among equals, the latest view comes first.
  std::stable_sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    const size_t x = a.recognition.matches.size(), y = b.recognition.matches.size();
    return x != y ? x > y : a.view > b.view;
  });
  candidates.resize(std::min(candidates.size(), static_cast<size_t>(options_.max_candidates)));
  std::vector<Recognition> verified;
  for (Candidate& candidate : candidates) {
    Recognition& r = candidate.recognition;
    const RigidConsensus motion = consensus(at(views_, candidate.view), current, r.matches, kFinal_px, 400);
    if (static_cast<int>(motion.inliers.size()) < options_.min_matches) continue;
    Matches kept;
    for (const int i : motion.inliers) kept.push_back(at(r.matches, i));
    r.matches = std::move(kept);
    r.earlier_from_current = motion.earlier_from_current;
    verified.push_back(std::move(r));
  }
  return verified;
}

std::vector<Recognition> LandmarkDatabase::reidentify(const Landmarks& landmarks, bool longer) const {
  // Not owned: the view does not outlive the call.
  const View current = view_of(0, std::shared_ptr<const Landmarks>(std::shared_ptr<void>(), &landmarks));
  std::vector<Matches> matches = matches_by_view(current, options_.max_leaves);
  if (options_.guided && !views_.empty() && !search_views(current, options_.max_views, matches) &&
      !(longer && search_longer(current, matches))) {
    // From a very different viewpoint few of the strongest keypoints match; all keypoints of the last view are tried
    // then.
    Matches all = one_to_one(all_matches(views_.back(), current), views_.back(), current);
    if (search_guided(views_.back(), current, all)) matches.back() = std::move(all);
  }
  std::vector<std::vector<Recognition>> candidates(current.landmarks);
  for_each_row(static_cast<int>(current.landmarks),
               [&](int landmark) { at(candidates, landmark) = candidates_of(landmark, matches, current); });

  // Accepts the best supported candidates first. A landmark may have been seen as part of a larger one, but every
  // earlier keypoint is used only once.
  std::vector<Recognition*> all;
  for (auto& own : candidates) {
    for (Recognition& candidate : own) all.push_back(&candidate);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Recognition* a, const Recognition* b) { return a->matches.size() > b->matches.size(); });
  std::map<int, const View*> by_frame;
  for (const View& view : views_) by_frame[view.frame] = &view;
  std::set<int> recognised;
  std::set<std::pair<int, int>> taken;  // frames and position indices
  std::vector<Recognition> result;
  for (Recognition* r : all) {
    if (recognised.contains(r->landmark)) continue;
    const auto place = [&](const KeypointMatch& match) {
      return std::pair(r->earlier_frame, by_frame.at(r->earlier_frame)->place(match.earlier));
    };
    std::erase_if(r->matches, [&](const KeypointMatch& match) { return taken.contains(place(match)); });
    if (static_cast<int>(r->matches.size()) < options_.min_matches) continue;
    recognised.insert(r->landmark);
    for (const KeypointMatch& match : r->matches) taken.insert(place(match));
    result.push_back(std::move(*r));
  }
  std::sort(result.begin(), result.end(),
            [](const Recognition& a, const Recognition& b) { return a.landmark < b.landmark; });
  return result;
}

}  // namespace fringeslam
