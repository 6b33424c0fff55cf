// The frames of a video, one after the other. For .cpp files only.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

namespace arah {

class VideoFrames {
 public:
  // Throws InputError naming the file: missing, none that OpenCV can decode, pictures larger than kLargestPicture.
  explicit VideoFrames(const std::filesystem::path& path);

  // How many frames it has. The file's own word is taken where it is `expected` or one less or more; else they are counted,
  // by decoding all of them.
  std::size_t count(std::size_t expected) const;
  // Frame `number`, from 0; a new picture, BGR. Going forward is quick, going back begins anew. Throws InputError where the video
  // ends before it.
  cv::Mat read(std::size_t number);

 private:
  void open();

  std::string where_;
  cv::VideoCapture video_;
  std::size_t next_ = 0;
};

}  // namespace arah
