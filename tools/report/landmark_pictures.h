// SPDX-License-Identifier: Apache-2.0
// The stages of landmark detection as in [T] Figs. 3-1 to 3-13, 8-bit BGR.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "core/mapper/pipeline.h"

namespace fringeslam::tools {

// Texture or depth image with its keypoints: circles for their scales, lines for their orientations.
cv::Mat3b texture_keypoints_picture(const FrameResult& view);
cv::Mat3b depth_keypoints_picture(const FrameResult& view, const LandmarkStages& stages);

// Depth image with edges, depth keypoints coloured by cluster, and their connections.
cv::Mat3b cluster_picture(const FrameResult& view, const LandmarkStages& stages);

// Texture with the landmarks' outlines and the keypoints inside them.
cv::Mat3b landmark_picture(const FrameResult& view);

// A view's re-identified landmarks beside an earlier view's, with lines between matched keypoints.
cv::Mat3b recognition_picture(const FrameResult& earlier, int earlier_keyframe, const FrameResult& current);

// Depth, foreground, edges; dilated, thinned, cleaned; clusters, landmarks, texture keypoints.
cv::Mat3b landmark_sheet(const FrameResult& view, const LandmarkStages& stages);

}  // namespace fringeslam::tools
