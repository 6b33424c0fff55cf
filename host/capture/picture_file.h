// Reading picture files that may be anything. For .cpp files only: OpenCV's headers are long.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace arah {

// The largest width and height of a picture, pixels.
inline constexpr int kLargestPicture = 8192;

// A PNG or JPEG picture as it is stored, channels in OpenCV's order, turned by nothing. Throws InputError naming the file:
// missing, neither of the two, cut off, larger than kLargestPicture (found before it is decoded), undecodable.
cv::Mat read_picture_file(const std::filesystem::path& path, bool png_only = false);

// Its width and height alone, from its first bytes.
cv::Size picture_file_size(const std::filesystem::path& path);

}  // namespace arah
