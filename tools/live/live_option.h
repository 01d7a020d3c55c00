// SPDX-License-Identifier: Apache-2.0
// --live [PORT] of the verbs that take stacks from a rig.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "tools/live/live_page.h"

namespace fringeslam::tools {

inline void add_live_option(CLI::App& verb, std::optional<int>& port) {
  const std::string usual = std::to_string(LivePage::kUsualPort);
  verb.add_option("--live", port,
                  "Show stacks on a web page of this computer; 0: any port that is free [" + usual + "]")
      ->type_name("[PORT]")
      ->expected(0, 1)
      ->default_str(usual)
      ->check(CLI::Range(0, 65535));
}

// None without a port. Says where it is.
inline std::unique_ptr<LivePage> open_live_page(std::optional<int> port, const PatternSequence& sequence,
                                                const RigModel& rig) {
  if (!port) return nullptr;
  auto page = std::make_unique<LivePage>(sequence, rig, *port);
  std::fprintf(stderr, "live: %s\n", page->url().c_str());
  return page;
}

}  // namespace fringeslam::tools
