// SPDX-License-Identifier: Apache-2.0
// fringeslam calibrate rig|noise|response|stage
#include <memory>
#include <utility>
#include <vector>

#include "tools/verbs.h"

namespace fringeslam::tools {

Verb add_calibrate(Command app, const Common& common) {
  const Command group =
      app.add_subcommand("calibrate", "Calibrate lenses and relative pose, camera noise, projector response, or sensor mount");
  group.require_subcommand(1);
  auto verbs = std::make_shared<std::vector<std::pair<Command, Verb>>>();
  for (const auto add : {add_calibrate_rig, add_calibrate_noise, add_calibrate_response, add_calibrate_stage}) {
    Verb verb = add(group, common);
    verbs->emplace_back(group.subcommands().back(), std::move(verb));
  }
  return [verbs] {
    for (const auto& [subcommand, verb] : *verbs) {
      if (subcommand.parsed()) return verb();
    }
    return 2;
  };
}

}  // namespace fringeslam::tools
