// SPDX-License-Identifier: Apache-2.0
// The option --live [PORT] of the verbs that take stacks from a rig, and its access options.
#pragma once

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "tools/command_line.h"
#include "tools/live/live_page.h"

namespace fringeslam::tools {

struct LiveOption {
  std::optional<int> port;  // empty: no page
  LiveAccess access;
};

// Adds the options of who may open a page; returns that of the address.
inline Option add_access_options(Command verb, LiveAccess& access) {
  const Option host = verb.add_option("--live-host", access.host,
                                      "Address to listen on [127.0.0.1: this computer only]; others require a token")
                          .type_name("ADDRESS");
  verb.add_option("--live-token", access.token, "Token to require instead of a random one")
      .type_name("TEXT")
      .envname("FRINGESLAM_LIVE_TOKEN");
  return host;
}

// Adds the option that shows a page, and those of who may open it; returns the former, which further options of the page need.
inline Option add_page_option(Command verb, const std::string& name, LiveOption& live, const std::string& description) {
  const std::string usual = std::to_string(LivePage::kDefaultPort);
  const Option page = verb.add_option(name, live.port, description + "; 0: any free port [" + usual + "]")
                          .type_name("[PORT]")
                          .expected(0, 1)
                          .default_str(usual)
                          .check_range(0, 65535);
  add_access_options(verb, live.access).needs(page);
  return page;
}

inline Option add_live_option(Command verb, LiveOption& live) {
  return add_page_option(verb, "--live", live, "Show incoming data on a web page");
}

// Returns null if there is no port. Prints the page's address to stderr.
inline std::unique_ptr<LivePage> open_live_page(const LiveOption& live, LiveSetup setup) {
  if (!live.port) return nullptr;
  LiveAccess access = live.access;
  access.port = *live.port;
  auto page = std::make_unique<LivePage>(std::move(setup), std::move(access));
  std::fprintf(stderr, "live: %s\n", page->url().c_str());
  return page;
}

}  // namespace fringeslam::tools
