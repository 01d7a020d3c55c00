// SPDX-License-Identifier: Apache-2.0
// Judges registrations by their own covariance: right, unsure, or wrong with confidence.
#pragma once

#include <string>

#include "core/mapper/view_registration.h"
#include "core/types/pose.h"
#include "core/types/rig_model.h"

namespace fringeslam::bench {

struct Count {
  int found = 0, right = 0, wrong = 0, ambiguous = 0;

  Count& operator+=(const Count& other);
};

// Counts a registration: right within 1 mm, or confidently wrong (core/score/pose_honesty.h). Prints those that are not
// right, with `name` and the share of the view that both views see.
void judge(const ViewRegistration& registration, const Pose& truth, const RigModel& rig, const std::string& name,
           double overlap, Count& count);

}  // namespace fringeslam::bench
