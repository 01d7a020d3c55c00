// SPDX-License-Identifier: Apache-2.0
// The stages of landmark identification as the thesis shows them (Fig. 3-1 to 3-13), 8-bit BGR.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "core/mapper/pipeline.h"

namespace fringeslam::tools {

// Texture or depth with its keypoints: circles of their scales, lines in their directions.
cv::Mat3b texture_keypoints_picture(const FrameResult& view);
cv::Mat3b depth_keypoints_picture(const FrameResult& view);

// On the depth image: edges, depth keypoints by cluster, their connections.
cv::Mat3b cluster_picture(const FrameResult& view);

// On the texture: outlines, and the keypoints within.
cv::Mat3b landmark_picture(const FrameResult& view);

// A view's recognised landmarks beside an earlier view's, with lines between matched keypoints.
cv::Mat3b recognition_picture(const FrameResult& earlier, int earlier_keyframe, const FrameResult& current);

// Depth, foreground, edges, dilated, thinned, cleaned; keypoints, clusters, landmarks.
cv::Mat3b landmark_sheet(const FrameResult& view);

}  // namespace fringeslam::tools
