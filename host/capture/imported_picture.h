// From a photograph and its mask to a picture of a capture. For .cpp files only.
#pragma once

#include <opencv2/core.hpp>
#include <string>

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

// A photograph and its mask as they lie on disk, 8 or 16 bits and any channels, and what errors call them. Where there are no
// pixels yet, the name is that of a picture file.
struct SourcePicture {
  cv::Mat image, mask;
  std::string image_name, mask_name;
};

// `camera`: of the picture on disk; its distortion is taken out. Pixels where the mask is not 0 are the person. Throws
// InputError naming the file: missing, damaged, or of another size than the camera's.
ImportedPicture import_picture(const SourcePicture& source, const Camera& camera, const PictureTreatment& treatment);

}  // namespace arah
