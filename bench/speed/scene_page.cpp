// SPDX-License-Identifier: Apache-2.0
// The page of a scene in a browser: from the command to the first picture, from a change to the new picture, and from the
// slider to a picture of another view.
#include <algorithm>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "bench/row.h"
#include "bench/script.h"
#include "bench/speed/interleaving.h"

namespace fringeslam::bench {

namespace {

using Seconds = std::map<std::string, std::vector<double>>;

// Runs a script of the browser tests, which prints the seconds of each kind as JSON.
Seconds measured_in_browser(int turns) {
  return nlohmann::json::parse(
             browser_result("scene_speed.mjs",
                            "'" FRINGESLAM_BENCH_PROGRAM "' '" FRINGESLAM_SCENES "' " + std::to_string(turns)))
      .get<Seconds>();
}

std::vector<Row> scene_page_rows(const Context& context) {
  const Seconds seconds = measured_in_browser(context.quick ? 3 : 11);
  for (const auto& [kind, times] : seconds) std::fprintf(stderr, "  %s: median %.3f s\n", kind.c_str(), median(times));
  const std::string changed = std::max({"light", "material", "path"}, [&](const char* a, const char* b) {
    return median(seconds.at(a)) < median(seconds.at(b));
  });
  return {median_row("speed.scene.open", seconds.at("open"), "s", 2.5),
          median_row("speed.scene.change", seconds.at(changed), "s", 1),
          median_row("speed.scene.view", in_ms(seconds.at("view")), "ms", 150)};
}

}  // namespace

std::vector<Item> scene_page_items() {
  return {{{"speed.scene.open", "speed.scene.change", "speed.scene.view"},
           "the page of scene rubble_pile in headless Chromium (needs tools/setup --test)",
           scene_page_rows,
           true}};
}

}  // namespace fringeslam::bench
