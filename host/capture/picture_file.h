// Reading picture files that may be anything. For .cpp files only: OpenCV's headers are long.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace arah {

// The largest width and height of a picture, pixels.
inline constexpr int kLargestPicture = 8192;

// A PNG or JPEG picture whose size is known before it is decoded.
class PictureFile {
 public:
  // Throws InputError naming the file: missing, neither of the two, cut off, larger than kLargestPicture.
  explicit PictureFile(const std::filesystem::path& path, bool png_only = false);

  cv::Size size() const { return size_; }
  // As it is stored, channels in OpenCV's order, turned by nothing. Throws InputError where that cannot be done.
  cv::Mat decoded() const;

 private:
  std::string where_;
  std::vector<char> bytes_;
  cv::Size size_;
};

// The picture of a file, whatever its size. Throws as PictureFile does.
cv::Mat read_picture_file(const std::filesystem::path& path, bool png_only = false);

// Its width and height alone.
cv::Size picture_file_size(const std::filesystem::path& path);

}  // namespace arah
