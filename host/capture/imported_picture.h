// From a photograph and its mask to a picture of a capture. For .cpp files only.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

#include "host/capture/camera.h"

namespace arah {

struct ImportedPicture {
  cv::Mat bgra;    // straight alpha, 8 bits; colour 0 where alpha is 0
  cv::Mat border;  // 8 bits, 255 where training is not to look; empty without a band
};

struct PictureTreatment {
  bool resize = false;  // to the camera's size first (photographs by areas, masks by nearest pixels)
  int band = 0;         // pixels on either side of the mask's edge that go into `border`
  int grow = 0;         // pixels by which the mask is grown
  int width = 0;        // columns to reduce to at last; 0: none
};

// `camera`: of the picture on disk; its distortion is taken out. Pixels where the mask is not 0 are the person. Throws
// InputError naming the file: missing, damaged, or of another size than the camera's.
ImportedPicture import_picture(const std::filesystem::path& image, const std::filesystem::path& mask, const Camera& camera,
                               const PictureTreatment& treatment);

}  // namespace arah
