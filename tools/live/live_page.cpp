// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_page.h"

#include <chrono>
#include <regex>

#include "tools/report/report_page.h"

namespace fringeslam::tools {

namespace {

constexpr auto kLongestWait = std::chrono::seconds(5);  // for a change

}  // namespace

LivePage::LivePage(LiveSetup setup, LiveAccess access)
    : feed_(std::move(setup)),
      server_(std::move(access), "--live", [this](const PageRequest& request) { return answer(request); }) {}

PageAnswer LivePage::answer(const PageRequest& request) {
  // Repetitions are bounded, because std::regex needs stack in proportion to the text.
  static const std::regex picture(R"(/picture/(\d{1,9})/([a-z]{1,20}\.(jpg|png)))"),
      points(R"(/keyframe/(\d{1,9})/points)");
  if (request.path == "/") return PageAnswer::of(std::string(live_page()), "text/html; charset=utf-8");
  if (request.path == "/snapshot") return PageAnswer::of(feed_.snapshot(), "application/json");
  if (request.path == "/changes") {
    const std::string run = request.parameter("run");
    const auto since = number_in<uint64_t>(request.parameter("since"));
    if (!since) return {400, {}};
    const Waiting waiting(waiting_);
    if (waiting.place > kViewers) return {503, {}};
    feed_.await_change(run, *since, kLongestWait, request.given_up);
    return PageAnswer::of(feed_.changes(run, *since), "application/json");
  }
  std::smatch match;
  if (std::regex_match(request.path, match, picture)) {
    const int number = number_in<int>(match[1].str()).value_or(0);
    const auto view = feed_.view(number);
    if (!view && feed_.had_view(number)) return {204, {}};
    return PageAnswer::of(view ? view->picture(match[2]) : std::string(),
                          match[3] == "jpg" ? "image/jpeg" : "image/png");
  }
  if (std::regex_match(request.path, match, points))
    return PageAnswer::of(feed_.points_of(number_in<int>(match[1].str()).value_or(-1)).value_or(std::string()),
                          "application/octet-stream");
  return {};
}

}  // namespace fringeslam::tools
