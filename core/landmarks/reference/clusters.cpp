// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/reference/clusters.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <tuple>

#include "core/types/error.h"

namespace fringeslam {

namespace {

using Eigen::Vector2d;

struct Line {
  Vector2d from, to;
};

bool boxes_apart(const Line& a, const Line& b) {
  return std::max(a.from.x(), a.to.x()) < std::min(b.from.x(), b.to.x()) ||
         std::max(b.from.x(), b.to.x()) < std::min(a.from.x(), a.to.x()) ||
         std::max(a.from.y(), a.to.y()) < std::min(b.from.y(), b.to.y()) ||
         std::max(b.from.y(), b.to.y()) < std::min(a.from.y(), a.to.y());
}

double side(const Line& line, const Vector2d& p) {
  const Vector2d u = line.to - line.from, v = p - line.from;
  return u.x() * v.y() - u.y() * v.x();
}

// Lines that share an end or merely touch do not cross.
bool cross(const Line& a, const Line& b) {
  return !boxes_apart(a, b) && side(a, b.from) * side(a, b.to) < 0 && side(b, a.from) * side(b, a.to) < 0;
}

// State of the search: cluster membership and the lines drawn so far.
class Search {
 public:
  Search(std::vector<DepthKeypoint>& keypoints, const cv::Mat1b& levels, const cv::Mat1b& edges,
         const ClusterOptions& options)
      : keypoints_(keypoints),
        levels_(levels),
        edges_(edges),
        options_(options),
        by_depth_(options.method != ClusterMethod::convex_hull) {
    for (size_t i = 0; i < keypoints.size(); ++i) {
      DepthKeypoint& k = keypoints[i];
      k.cluster = k.order = -1;
      k.connections = 0;
      k.samples.clear();
      if (inside(k.pixel)) free_.push_back(static_cast<int>(i));
    }
    // Keeps the strongest; among equals the first.
    const auto most = static_cast<size_t>(options.max_keypoints);
    if (free_.size() > most) {
      std::stable_sort(free_.begin(), free_.end(), [&](int a, int b) { return at(a).strength > at(b).strength; });
      free_.resize(most);
      std::sort(free_.begin(), free_.end());
    }
  }

  Clusters run() {
    clustered_ = free_;
    around_.resize(keypoints_.size());
    taken_.resize(keypoints_.size());
    between_.resize(keypoints_.size());
    for (const Vector2d& start : starts()) grow_from(start);
    if (by_depth_) assign_remaining();
    // Remaining keypoints start clusters of their own.
    const std::vector<int> left_over = free_;
    for (const int k : left_over) {
      if (at(k).cluster < 0) grow(k);
    }
    return std::move(found_);
  }

 private:
  DepthKeypoint& at(int i) { return keypoints_[static_cast<size_t>(i)]; }
  const DepthKeypoint& at(int i) const { return keypoints_[static_cast<size_t>(i)]; }

  bool inside(const Vector2d& p) const {
    return p.x() > -0.5 && p.y() > -0.5 && p.x() < levels_.cols - 0.5 && p.y() < levels_.rows - 0.5;  // false for NaN
  }

  std::vector<Vector2d> starts() const {
    std::vector<Vector2d> starts;
    const double right = levels_.cols - 1, bottom = levels_.rows - 1;
    if (options_.starts != ClusterStarts::random) starts = {{0, 0}, {right, 0}, {0, bottom}, {right, bottom}};
    if (options_.starts != ClusterStarts::corners) {
      std::mt19937 random(static_cast<uint32_t>(options_.seed));
      const auto below = [&](int size) { return static_cast<double>(random() % static_cast<uint32_t>(size)); };
      for (int i = 0; i < options_.random_starts; ++i) {
        const double x = below(levels_.cols), y = below(levels_.rows);
        starts.emplace_back(x, y);
      }
    }
    return starts;
  }

  // Starts a cluster at the first free keypoint met by the growing square that a line reaches.
  void grow_from(const Vector2d& start) {
    for (const int k : in_growing_square(start)) {
      if (!crosses_edge({start, at(k).pixel}, options_.line_end_px)) return grow(k);
    }
  }

  void grow(int first) { by_depth_ ? grow_by_depth(first) : grow_region(first); }

  // --- region search ---

  void grow_region(int first) {
    std::vector<int> members = {first};
    take(first);
    for (size_t next = 0; next < members.size(); ++next) {
      const int from = members[next];
      double blocked_at = -1;  // size of the square at which only edges were met
      bool reached = true;
      for (const auto& [size, k, level] : around(from)) {
        if (taken_[static_cast<size_t>(k)]) continue;
        // The square has grown past a ring in which every line crosses an edge.
        if (!reached && size > blocked_at + kGrowth_px) break;
        const Line line{at(from).pixel, at(k).pixel};
        if (crosses_edge(line, options_.line_end_px)) {
          if (reached) blocked_at = size;
          reached = false;
          continue;
        }
        reached = true;
        take(k);
        connect(from, k);
        members.push_back(k);
      }
    }
    keep(members);
  }

  // --- depth sampling ---

  void grow_by_depth(int first) {
    std::vector<int> members = {first}, path = {first};
    take(first);
    int low = at(first).level, high = low;
    while (!path.empty()) {
      const int next = nearest_by_depth(path.back(), low, high);
      if (next < 0) {
        path.pop_back();
        continue;
      }
      take(next);
      at(next).samples = sampled({at(path.back()).pixel, at(next).pixel});
      connect(path.back(), next);
      low = std::min(low, at(next).level);
      high = std::max(high, at(next).level);
      members.push_back(next);
      path.push_back(next);
    }
    give_second_connections(members);
    drop_weakly_connected(members);
    keep(members);
  }

  // Eq. 4 and 5, among the keypoints in the square that first contains an admissible one; -1 if there is none.
  int nearest_by_depth(int from, int low, int high) {
    int best = -1, best_change = 256;
    double reach = std::numeric_limits<double>::infinity();
    const int level = at(from).level;
    for (const Near& near : around(from)) {
      if (near.size > reach) break;
      if (taken_[static_cast<size_t>(near.keypoint)]) continue;
      const int change = std::abs(near.level - level);
      if (change >= best_change) continue;
      if (std::max(high, near.level) - std::min(low, near.level) > options_.max_depth_change) continue;
      if (!admissible(from, near.keypoint)) continue;
      if (best < 0) reach = near.size + kGrowth_px;
      best = near.keypoint;
      best_change = change;
    }
    return best;
  }

  // Cached properties of the straight line between two keypoints, which is tested repeatedly.
  struct Between {
    enum : char { kUnknown, kNo, kYes } on_surface = kUnknown;
    bool crossed = false;    // by a line of the current cluster, or permanently
    int epoch = 0;           // value of epoch_ at the last test
    int kept = 0, free = 0;  // lines of completed clusters at that time; number of leading lines that do not cross it
  };
  Between& between(int a, int b) {
    std::vector<Between>& known = between_[static_cast<size_t>(std::min(a, b))];
    if (known.empty()) known.resize(keypoints_.size());
    return known[static_cast<size_t>(std::max(a, b))];
  }

  bool admissible(int from, int to) {
    Between& known = between(from, to);
    return stays_on_surface(from, to, known) && !crosses_line({at(from).pixel, at(to).pixel}, known);
  }

  // Tests only lines drawn since the last test. If lines were removed meanwhile, results for lines of clusters
  // completed by then remain valid.
  bool crosses_line(const Line& line, Between& known) const {
    if (known.epoch != epoch_) {
      known.crossed = known.crossed && known.free < known.kept;
      known.free = std::min(known.free, known.kept);
      known.epoch = epoch_;
    }
    known.kept = static_cast<int>(own_connections_);
    const int drawn = static_cast<int>(lines_.size());
    while (!known.crossed && known.free < drawn) {
      known.crossed = cross(line, lines_[static_cast<size_t>(known.free)]);
      known.free += !known.crossed;
    }
    return known.crossed;
  }

  bool stays_on_surface(int from, int to, Between& known) const {
    if (known.on_surface == Between::kUnknown) {
      const Line line{at(std::min(from, to)).pixel, at(std::max(from, to)).pixel};
      const int low = std::min(at(from).level, at(to).level) - options_.sample_threshold;
      const int high = std::max(at(from).level, at(to).level) + options_.sample_threshold;
      known.on_surface = Between::kYes;
      for (int i = 1; i <= options_.samples && known.on_surface == Between::kYes; ++i) {
        const int level = sample(line, i);
        if (level < low || level > high) known.on_surface = Between::kNo;
      }
      if (known.on_surface == Between::kYes && crosses_edge(line, options_.line_end_px))
        known.on_surface = Between::kNo;
    }
    return known.on_surface == Between::kYes;
  }

  // Samples levels between the two ends; the ends themselves belong to keypoints, often on edges.
  uchar sample(const Line& line, int i) const {
    const Vector2d p = line.from + (line.to - line.from) * i / (options_.samples + 1);
    return levels_(static_cast<int>(p.y() + 0.5), static_cast<int>(p.x() + 0.5));
  }
  std::vector<uchar> sampled(const Line& line) const {
    std::vector<uchar> samples;
    for (int i = 1; i <= options_.samples; ++i) samples.push_back(sample(line, i));
    return samples;
  }

  // Connects each member that has a single line with the nearest other member it can reach.
  void give_second_connections(const std::vector<int>& members) {
    for (const int k : members) {
      if (at(k).connections >= 2) continue;
      const std::vector<int> partners = connected_to(k);
      for (const Near& near : around(k)) {
        const int other = near.keypoint;
        if (at(other).cluster != at(k).cluster ||
            std::find(partners.begin(), partners.end(), other) != partners.end() || !admissible(k, other))
          continue;
        connect(k, other);
        break;
      }
    }
  }

  // Drops members with fewer than two connections; a removal may leave its neighbour with one.
  void drop_weakly_connected(std::vector<int>& members) {
    for (bool changed = true; changed;) {
      changed = false;
      for (const int k : members) {
        if (at(k).connections >= 2 || at(k).cluster < 0) continue;
        disconnect(k);
        release(k);
        changed = true;
      }
      std::erase_if(members, [&](int k) { return at(k).cluster < 0; });
    }
  }

  // Remaining keypoints join an existing cluster where they obtain two connections.
  void assign_remaining() {
    const std::vector<int> left_over = free_;
    for (const int k : left_over) {
      for (size_t c = 0; c < found_.members.size(); ++c) {
        std::vector<int>& members = found_.members[c];
        std::vector<int> reached;
        for (const Near& near : around(k)) {
          const int m = near.keypoint;
          if (at(m).cluster != static_cast<int>(c)) continue;
          if (std::abs(near.level - at(k).level) <= options_.max_depth_change && admissible(k, m)) reached.push_back(m);
          if (reached.size() == 2) break;
        }
        if (reached.size() < 2 || !within_depth(members, at(k).level)) continue;
        take(k);
        at(k).cluster = static_cast<int>(c);
        at(k).order = static_cast<int>(members.size());
        at(k).samples = sampled({at(reached[0]).pixel, at(k).pixel});
        members.push_back(k);
        for (const int m : reached) connect(m, k);
        break;
      }
    }
  }

  bool within_depth(const std::vector<int>& members, int level) {
    int low = level, high = level;
    for (const int m : members) low = std::min(low, at(m).level), high = std::max(high, at(m).level);
    return high - low <= options_.max_depth_change;
  }

  // --- lines ---

  // True if the line, apart from its ends, enters an edge pixel. Every pixel entered is tested, so that the line
  // cannot pass between two edge pixels that touch at their corners.
  bool crosses_edge(const Line& line, double line_end) const {
    const Vector2d way = line.to - line.from;
    const double length = way.norm();
    if (length <= 2 * line_end) return false;
    const Vector2d from = line.from + way * (line_end / length), to = line.to - way * (line_end / length);
    int x = static_cast<int>(std::lround(from.x())), y = static_cast<int>(std::lround(from.y()));
    const int last_x = static_cast<int>(std::lround(to.x())), last_y = static_cast<int>(std::lround(to.y()));
    const int step_x = to.x() > from.x() ? 1 : -1, step_y = to.y() > from.y() ? 1 : -1;
    const double dx = std::abs(to.x() - from.x()), dy = std::abs(to.y() - from.y());
    // Fraction of the line at which it enters the next column or row of pixels.
    double next_x = dx > 0 ? (0.5 + step_x * (x - from.x())) / dx : 2;
    double next_y = dy > 0 ? (0.5 + step_y * (y - from.y())) / dy : 2;
    const auto on_edge = [&] { return x >= 0 && y >= 0 && x < edges_.cols && y < edges_.rows && edges_(y, x) != 0; };
    for (int left = std::abs(last_x - x) + std::abs(last_y - y);; --left) {
      if (on_edge()) return true;
      if (left <= 0) return false;
      if (next_x < next_y) {
        x += step_x;
        next_x += 1 / dx;
      } else {
        y += step_y;
        next_y += dy > 0 ? 1 / dy : 0;
      }
    }
  }

  // Keypoints connected to k within the current cluster.
  std::vector<int> connected_to(int k) const {
    std::vector<int> partners;
    for (size_t i = own_connections_; i < found_.connections.size(); ++i) {
      const cv::Vec2i& c = found_.connections[i];
      if (c[0] == k || c[1] == k) partners.push_back(c[0] == k ? c[1] : c[0]);
    }
    return partners;
  }
  void connect(int a, int b) {
    found_.connections.emplace_back(a, b);
    lines_.push_back({at(a).pixel, at(b).pixel});
    ++at(a).connections;
    ++at(b).connections;
  }
  void disconnect(int k) {
    ++epoch_;
    for (size_t i = found_.connections.size(); i-- > own_connections_;) {
      const cv::Vec2i c = found_.connections[i];
      if (c[0] != k && c[1] != k) continue;
      --at(c[0]).connections;
      --at(c[1]).connections;
      found_.connections.erase(found_.connections.begin() + static_cast<std::ptrdiff_t>(i));
      lines_.erase(lines_.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  // --- keypoints ---

  double size_of(int k, const Vector2d& centre) { return (at(k).pixel - centre).cwiseAbs().maxCoeff(); }
  // Free keypoints in the order in which a growing square around the centre meets them.
  std::vector<int> in_growing_square(const Vector2d& centre) {
    std::vector<int> list = free_;
    std::stable_sort(list.begin(), list.end(), [&](int a, int b) { return size_of(a, centre) < size_of(b, centre); });
    return list;
  }
  // The same around a keypoint, up to the largest square, for all keypoints: some become free again when a cluster
  // drops them.
  struct Near {
    double size;
    int keypoint, level;
    bool operator<(const Near& other) const { return std::tie(size, keypoint) < std::tie(other.size, other.keypoint); }
  };
  const std::vector<Near>& around(int k) {
    std::vector<Near>& list = around_[static_cast<size_t>(k)];
    if (list.empty()) {
      for (const int other : clustered_) {
        const double size = size_of(other, at(k).pixel);
        if (other != k && size <= options_.max_radius_px) list.push_back({size, other, at(other).level});
      }
      std::sort(list.begin(), list.end());
    }
    return list;
  }

  void take(int k) {
    at(k).cluster = static_cast<int>(found_.members.size());
    taken_[static_cast<size_t>(k)] = 1;
    free_.erase(std::lower_bound(free_.begin(), free_.end(), k));
  }
  void release(int k) {
    at(k).cluster = -1;
    taken_[static_cast<size_t>(k)] = 0;
    at(k).samples.clear();
    free_.insert(std::lower_bound(free_.begin(), free_.end(), k), k);
  }
  // Completes a cluster; one without members is discarded.
  void keep(const std::vector<int>& members) {
    own_connections_ = found_.connections.size();
    if (members.empty()) return;
    for (size_t i = 0; i < members.size(); ++i) at(members[i]).order = static_cast<int>(i);
    found_.members.push_back(members);
  }

  static constexpr double kGrowth_px = 8;

  std::vector<DepthKeypoint>& keypoints_;
  const cv::Mat1b &levels_, &edges_;
  const ClusterOptions& options_;
  const bool by_depth_;
  std::vector<int> clustered_;  // candidates for clusters, ascending
  std::vector<int> free_;       // those without a cluster
  std::vector<char> taken_;     // by a cluster
  std::vector<std::vector<Near>> around_;
  std::vector<std::vector<Between>> between_;  // of each keypoint with those after it
  Clusters found_;
  std::vector<Line> lines_;     // of the connections
  int epoch_ = 0;               // incremented whenever lines are removed
  size_t own_connections_ = 0;  // earlier ones belong to completed clusters
};

}  // namespace

Clusters find_clusters(std::vector<DepthKeypoint>& keypoints, const cv::Mat1b& levels, const cv::Mat1b& edges,
                       const ClusterOptions& options) {
  check_options(options, "clusters");
  if (levels.size() != edges.size()) throw Error("clusters: the depth image and its edges differ in size");
  return Search(keypoints, levels, edges, options).run();
}

}  // namespace fringeslam
