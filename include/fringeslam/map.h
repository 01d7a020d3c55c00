// SPDX-License-Identifier: Apache-2.0
// KeyframeMap: keyframes and pose graph; the fused surface, clouds and meshes; saved maps.
#pragma once

#include "core/map/cloud.h"
#include "core/map/keyframe_map.h"
#include "core/map/mesh.h"
#include "core/map/surface.h"
#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
