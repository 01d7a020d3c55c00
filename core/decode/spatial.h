// SPDX-License-Identifier: Apache-2.0
// Spatial phase unwrapping: relative fringe orders along connected pixels (METHOD S3, `spatial`). In rubble there are
// many components, and the order of each is only known up to a common multiple.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/decoded_stack.h"

namespace fringeslam {

// H x W: relative order, and the component of each pixel, from 0, numbered in the order of their first pixels; -1
// where there is no phase.
struct SpatialOrders {
  cv::Mat1i order, component;
  int components = 0;
};

// Neighbours are joined where their phases, rad, differ by at most max_step_rad modulo 2 pi. Across a step of the
// surface phases agree by chance here and there; so where the orders of some pixels are known by `reference` (-1:
// unknown; empty: all), parts that these orders contradict are not joined.
//
// By quality: a flood from each component's best pixel that always goes on from the best pixel on its rim, the best
// being that of least sigma.
SpatialOrders unwrap_by_quality(const cv::Mat1f& wrapped_phase, const cv::Mat1f& sigma, double max_step_rad,
                                const cv::Mat1i& reference = {});

// By reliability (Herraez, Burton, Lalor and Gdeisat, Applied Optics 41, 2002): a pixel is the more reliable the
// smaller its second differences are; the joints of neighbours are made in the order of their reliabilities' sum.
SpatialOrders unwrap_by_reliability(const cv::Mat1f& wrapped_phase, double max_step_rad,
                                    const cv::Mat1i& reference = {});

// What the reference says of each component's order: the commonest difference between `reference` (-1: no vote) and the
// relative orders. A component with no vote or too little agreement is not absolute. `shift`: that difference.
struct ComponentOrder {
  PhaseComponent summary;
  int shift = 0;
};
std::vector<ComponentOrder> vote(const SpatialOrders& orders, const cv::Mat1i& reference, double min_agreement);

}  // namespace fringeslam
