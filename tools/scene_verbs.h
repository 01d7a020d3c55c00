// SPDX-License-Identifier: Apache-2.0
// The verbs below `fringeslam scene`. Each function adds its subcommand to the group and returns the callback that runs
// it.
#pragma once

#include <string>

#include "tools/live/access.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

Verb add_scene_export(Command group, const Common& common);
Verb add_scene_generate(Command group, const Common& common);
Verb add_scene_new(Command group, const Common& common);
Verb add_scene_open(Command group, const Common& common);
Verb add_scene_preview(Command group, const Common& common);

// Serves the page of a folder of scenes (authoring/gallery_page.h) until Ctrl-C.
int show_gallery(const std::string& folder, const LiveAccess& access);

}  // namespace fringeslam::tools
