// Where the pixels of undistorted pictures lie in the pictures on disk. For .cpp files only.
#pragma once

#include <opencv2/core.hpp>

#include "host/capture/camera.h"

namespace arah {

// For cv::remap: [height][width] places in the distorted picture.
inline cv::Mat undistortion_map(const Camera& camera) {
  cv::Mat map(camera.height, camera.width, CV_32FC2);
  for (int v = 0; v < map.rows; ++v) {
    for (int u = 0; u < map.cols; ++u) {
      const glm::dvec2 at = camera.distort({u, v});
      map.at<cv::Vec2f>(v, u) = cv::Vec2f(static_cast<float>(at.x), static_cast<float>(at.y));
    }
  }
  return map;
}

}  // namespace arah
