// SPDX-License-Identifier: Apache-2.0
// Spatial phase unwrapping: relative fringe orders along connected pixels (docs/method.md, section 3.2, `spatial`).
// Views of rubble have many components, each with orders known only up to a common offset.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/decoded_stack.h"

namespace fringeslam {

// Relative order and component index of each pixel, H x W. Components are numbered from 0 in the order of their first
// pixels; -1: no phase.
struct SpatialOrders {
  cv::Mat1i order, component;
  int components = 0;
};

// Neighbours are joined if their phases, rad, differ by at most max_step_rad modulo 2 pi. Across a surface step phases
// may agree by chance; therefore, where `reference` gives the orders of some pixels (-1: unknown; empty: all unknown),
// parts with contradicting orders are not joined.
//
// By quality: a flood fill from the best pixel of each component, which always continues at the best pixel on its
// boundary; the best pixel is the one with the lowest sigma.
SpatialOrders unwrap_by_quality(const cv::Mat1f& wrapped_phase, const cv::Mat1f& sigma, double max_step_rad,
                                const cv::Mat1i& reference = {});

// By reliability (Herraez, Burton, Lalor and Gdeisat, Applied Optics 41, 2002): a pixel is more reliable the smaller
// its second differences are; neighbours are joined in order of the sum of their reliabilities.
SpatialOrders unwrap_by_reliability(const cv::Mat1f& wrapped_phase, double max_step_rad,
                                    const cv::Mat1i& reference = {});

// Order offset of each component: the most frequent difference (`shift`) between `reference` (-1: no vote) and the
// relative orders. A component without votes or with too little agreement is not absolute.
struct ComponentOrder {
  PhaseComponent summary;
  int shift = 0;
};
std::vector<ComponentOrder> vote(const SpatialOrders& orders, const cv::Mat1i& reference, double min_agreement);

}  // namespace fringeslam
