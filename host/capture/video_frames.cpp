#include "host/capture/video_frames.h"

#include <algorithm>
#include <cmath>
#include <opencv2/videoio/registry.hpp>

#include "host/capture/picture_file.h"
#include "host/input_error.h"

namespace arah {

VideoFrames::VideoFrames(const std::filesystem::path& path) : where_(path.string()) {
  if (!std::filesystem::is_regular_file(path)) throw InputError(where_, "", "a video", "no file");
  open();
}

void VideoFrames::open() {
  next_ = 0;
  try {
    const std::vector<cv::VideoCaptureAPIs> readers = cv::videoio_registry::getStreamBackends();
    const bool ffmpeg = std::find(readers.begin(), readers.end(), cv::CAP_FFMPEG) != readers.end();
    video_.open(where_, ffmpeg ? cv::CAP_FFMPEG : cv::CAP_ANY);
  } catch (const cv::Exception& error) {
    throw InputError(where_, "", "a video", "one that cannot be opened: " + error.err);
  }
  if (!video_.isOpened()) throw InputError(where_, "", "a video that OpenCV can decode", "something else", "Its frames as image/000000.jpg, … beside it serve too.");
  const double width = video_.get(cv::CAP_PROP_FRAME_WIDTH), height = video_.get(cv::CAP_PROP_FRAME_HEIGHT);
  if (!(width >= 1 && width <= kLargestPicture && height >= 1 && height <= kLargestPicture)) {
    throw InputError(where_, "size", fmt::format("1 to {} pixels each way", kLargestPicture), fmt::format("{:.0f}x{:.0f}", width, height));
  }
}

std::size_t VideoFrames::count(std::size_t expected) const {
  const double stated = video_.get(cv::CAP_PROP_FRAME_COUNT);
  if (std::abs(stated - static_cast<double>(expected)) <= 1) return static_cast<std::size_t>(stated);
  VideoFrames another{std::filesystem::path(where_)};
  std::size_t frames = 0;
  while (another.video_.grab()) ++frames;
  return frames;
}

cv::Mat VideoFrames::read(std::size_t number) {
  if (number < next_) open();
  for (; next_ <= number; ++next_) {
    if (!video_.grab()) throw InputError(where_, fmt::format("frame {}", number), "a video that is long enough", fmt::format("{} frames", next_), "Copy it again.");
  }
  cv::Mat decoded;
  if (!video_.retrieve(decoded) || decoded.empty()) throw InputError(where_, fmt::format("frame {}", number), "a frame that can be decoded", "none", "Copy it again.");
  return decoded.clone();
}

}  // namespace arah
