// SPDX-License-Identifier: Apache-2.0
// gmock matchers for poses, matrices and errors.
#pragma once

#include <gmock/gmock.h>

#include <string>

#include "core/types/error.h"
#include "core/types/pose.h"

namespace fringeslam::support {

MATCHER_P2(MatrixNear, expected, tolerance, "is a matrix within the tolerance") {
  const double off = (arg - expected).cwiseAbs().maxCoeff();
  *result_listener << "largest difference " << off;
  return off <= tolerance;  // false for NaN
}

MATCHER_P3(PoseNear, expected, tolerance_m, tolerance_rad, "is a pose within the tolerances") {
  const Vector6d off = difference(arg, expected);
  *result_listener << "off by " << off.template tail<3>().norm() << " m and " << off.template head<3>().norm()
                   << " rad";
  return off.template tail<3>().norm() <= tolerance_m && off.template head<3>().norm() <= tolerance_rad;
}

// Returns the message of the Error that the statement throws, or "no Error was thrown".
template <class Statement>
std::string error_of(Statement&& statement) {
  try {
    statement();
  } catch (const Error& error) {
    return error.what();
  }
  return "no Error was thrown";
}

}  // namespace fringeslam::support
