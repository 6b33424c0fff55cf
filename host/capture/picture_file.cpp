#include "host/capture/picture_file.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <string_view>
#include <vector>

#include "host/input_error.h"

namespace arah {
namespace {

using namespace std::string_view_literals;
constexpr std::string_view kPngStart = "\x89PNG\r\n\x1a\n"sv, kPngEnd = "\0\0\0\0IEND\xae\x42\x60\x82"sv;
constexpr std::string_view kJpegStart = "\xff\xd8\xff"sv, kJpegEnd = "\xff\xd9"sv;
constexpr std::size_t kLargestFile = std::size_t{1} << 28;  // bytes

std::vector<char> bytes_of(const std::filesystem::path& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file) throw InputError(path.string(), "", "a picture", "no file that can be opened");
  if (size > kLargestFile) throw InputError(path.string(), "", fmt::format("at most {} bytes", kLargestFile), fmt::format("{}", size));
  return {std::istreambuf_iterator<char>(file), {}};
}

std::size_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::size_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

// JPEG's segments: 0xff, a kind, a length of two bytes that counts itself; the frame header (kinds c0 to cf but c4, c8 and
// cc) has precision, height and width. 0 x 0 where there is none.
cv::Size jpeg_size(std::string_view bytes) {
  for (std::size_t at = 2; at + 9 <= bytes.size();) {
    if (bytes[at] != '\xff') break;
    const auto kind = static_cast<unsigned char>(bytes[at + 1]);
    if (kind == 0xff) {  // filling
      ++at;
      continue;
    }
    if (kind >= 0xc0 && kind <= 0xcf && kind != 0xc4 && kind != 0xc8 && kind != 0xcc) {
      return {static_cast<int>(big_endian(bytes, at + 7, 2)), static_cast<int>(big_endian(bytes, at + 5, 2))};
    }
    at += 2 + big_endian(bytes, at + 2, 2);
  }
  return {};
}

// Checks all but the pixels. OpenCV fills what a truncated file lacks and only warns, so the ends are looked for.
cv::Size checked_size(std::string_view bytes, const std::string& where, bool png_only) {
  const bool png = bytes.starts_with(kPngStart), jpeg = !png_only && bytes.starts_with(kJpegStart);
  if (!png && !jpeg) throw InputError(where, "", png_only ? "a PNG picture" : "a PNG or JPEG picture", bytes.empty() ? "an empty file" : "something else");
  if (bytes.rfind(png ? kPngEnd : kJpegEnd) == bytes.npos || bytes.size() < 24) {
    throw InputError(where, "", fmt::format("a whole {} picture", png ? "PNG" : "JPEG"), fmt::format("one cut off after {} bytes", bytes.size()), "Copy it again.");
  }
  const std::size_t width = png ? big_endian(bytes, 16, 4) : 0, height = png ? big_endian(bytes, 20, 4) : 0;
  const cv::Size size = png ? cv::Size(static_cast<int>(std::min<std::size_t>(width, 1 << 30)), static_cast<int>(std::min<std::size_t>(height, 1 << 30))) : jpeg_size(bytes);
  if (size.width < 1 || size.height < 1 || size.width > kLargestPicture || size.height > kLargestPicture) {
    throw InputError(where, "size", fmt::format("1 to {} pixels each way", kLargestPicture), fmt::format("{}x{}", size.width, size.height));
  }
  return size;
}

}  // namespace

PictureFile::PictureFile(const std::filesystem::path& path, bool png_only)
    : where_(path.string()), bytes_(bytes_of(path)), size_(checked_size({bytes_.data(), bytes_.size()}, where_, png_only)) {}

cv::Mat PictureFile::decoded() const {
  cv::Mat picture;
  try {
    picture = cv::imdecode(cv::Mat(1, static_cast<int>(bytes_.size()), CV_8U, const_cast<char*>(bytes_.data())), cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw InputError(where_, "", "a picture", "one that cannot be decoded: " + error.err);
  }
  if (picture.empty() || picture.size() != size_) throw InputError(where_, "", "a picture", "one that cannot be decoded");
  return picture;
}

cv::Mat read_picture_file(const std::filesystem::path& path, bool png_only) { return PictureFile(path, png_only).decoded(); }

cv::Size picture_file_size(const std::filesystem::path& path) { return PictureFile(path).size(); }

}  // namespace arah
