// The pictures of a capture: decoding, undistortion, premultiplication, reduction.
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "host/capture/capture.h"
#include "host/input_error.h"

namespace arah {
namespace {

// The PNG's pixels, 8 or 16 bits, BGRA. OpenCV fills what a truncated PNG lacks with zeros and only warns, so the end
// is checked here: a whole PNG has an empty IEND chunk.
cv::Mat read_png(const std::filesystem::path& path) {
  const std::string where = path.string();
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(where, "", "a picture", "no file that can be opened");
  const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const std::string_view content(bytes.data(), bytes.size());
  using namespace std::string_view_literals;
  if (!content.starts_with("\x89PNG\r\n\x1a\n"sv)) {
    throw InputError(where, "", "a PNG picture", bytes.empty() ? "an empty file" : "something else");
  }
  if (content.rfind("\0\0\0\0IEND\xae\x42\x60\x82"sv) == content.npos) {
    throw InputError(where, "", "a whole PNG picture", fmt::format("one cut off after {} bytes", bytes.size()),
                     "Copy it again.");
  }
  cv::Mat picture;
  try {
    picture = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data())),
                           cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw InputError(where, "", "a PNG picture", "one that cannot be decoded: " + error.err);
  }
  if (picture.empty()) throw InputError(where, "", "a PNG picture", "one that cannot be decoded");
  if (picture.channels() != 4 || (picture.depth() != CV_8U && picture.depth() != CV_16U)) {
    throw InputError(where, "", "red, green, blue and alpha", fmt::format("{} channels", picture.channels()),
                     "The mask is the picture's alpha channel.");
  }
  return picture;
}

// Straight BGRA integers → premultiplied RGBA floats in 0..1.
cv::Mat premultiplied(const cv::Mat& picture) {
  cv::Mat straight;
  picture.convertTo(straight, CV_32F, picture.depth() == CV_8U ? 1.0 / 255.0 : 1.0 / 65535.0);
  cv::Mat result(straight.size(), CV_32FC4);
  for (int v = 0; v < straight.rows; ++v) {
    const cv::Vec4f* from = straight.ptr<cv::Vec4f>(v);
    cv::Vec4f* to = result.ptr<cv::Vec4f>(v);
    for (int u = 0; u < straight.cols; ++u) {
      const float alpha = from[u][3];
      to[u] = cv::Vec4f(from[u][2] * alpha, from[u][1] * alpha, from[u][0] * alpha, alpha);
    }
  }
  return result;
}

// The picture that a camera without distortion would have taken. Premultiplied values are interpolated, so that the
// colour of transparent pixels does not bleed into the edge.
cv::Mat undistorted(const cv::Mat& picture, const Camera& camera) {
  cv::Mat map(picture.size(), CV_32FC2);
  for (int v = 0; v < map.rows; ++v) {
    for (int u = 0; u < map.cols; ++u) {
      const glm::dvec2 at = camera.distort({u, v});
      map.at<cv::Vec2f>(v, u) = cv::Vec2f(static_cast<float>(at.x), static_cast<float>(at.y));
    }
  }
  cv::Mat result;
  cv::remap(picture, result, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(0, 0, 0, 0));
  return result;
}

}  // namespace

Image load_image(const Capture& capture, const std::string& split, std::size_t camera, int frame, int width) {
  const Camera& view = capture.cameras.at(camera);
  const std::filesystem::path path = image_path(capture, split, camera, frame);
  cv::Mat picture = read_png(path);
  if (picture.cols != view.width || picture.rows != view.height) {
    throw InputError(path.string(), "size",
                     fmt::format("{}x{}, as camera '{}' in cameras.json", view.width, view.height, view.name),
                     fmt::format("{}x{}", picture.cols, picture.rows));
  }
  if (width < 0 || width > view.width) {
    throw InputError(path.string(), "size", fmt::format("1 to {} columns to be asked for", view.width),
                     fmt::format("{}", width), "Pictures are reduced, never enlarged.");
  }
  cv::Mat color = premultiplied(picture);
  if (view.distorted()) color = undistorted(color, view);
  Image image{color.cols, color.rows, {}};
  const float* values = color.ptr<float>();
  image.rgba.assign(values, values + color.total() * 4);
  return width == 0 || width == image.width ? image : reduced(image, width);
}

Image reduced(const Image& image, int width) {
  if (width < 1 || width > image.width) {
    throw std::invalid_argument(fmt::format("{} columns from a picture of {}", width, image.width));
  }
  Camera size;
  size.width = image.width;
  size.height = image.height;
  size = size.scaled(width);
  Image result{size.width, size.height,
               std::vector<float>(4 * static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height))};
  const cv::Mat from(image.height, image.width, CV_32FC4, const_cast<float*>(image.rgba.data()));
  cv::Mat to(result.height, result.width, CV_32FC4, result.rgba.data());
  cv::resize(from, to, to.size(), 0.0, 0.0, cv::INTER_AREA);
  return result;
}

}  // namespace arah
