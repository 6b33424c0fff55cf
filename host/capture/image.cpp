// The pictures of a capture: decoding, undistortion, premultiplication, reduction.
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "host/capture/capture.h"
#include "host/capture/picture_file.h"
#include "host/capture/undistortion.h"
#include "host/input_error.h"

namespace arah {
namespace {

// Refuses a picture of another size than its camera's, before it is decoded.
void check_size(const PictureFile& file, const Camera& view, const std::string& where) {
  if (file.size() == cv::Size(view.width, view.height)) return;
  throw InputError(where, "size", fmt::format("{}x{}, as camera '{}' in cameras.json", view.width, view.height, view.name),
                   fmt::format("{}x{}", file.size().width, file.size().height));
}

// The picture's pixels, 8 or 16 bits, BGRA.
cv::Mat read_bgra(const std::filesystem::path& path, const Camera& view) {
  const std::string where = path.string();
  const PictureFile file(path, /*png_only=*/true);
  check_size(file, view, where);
  cv::Mat picture = file.decoded();
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
  cv::Mat result;
  cv::remap(picture, result, undistortion_map(camera), cv::noArray(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(0, 0, 0, 0));
  return result;
}

}  // namespace

Image load_image(const Capture& capture, const std::string& split, std::size_t camera, int frame, int width) {
  const Camera& view = capture.cameras.at(camera);
  const std::filesystem::path path = image_path(capture, split, camera, frame);
  cv::Mat picture = read_bgra(path, view);
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

PixelMask load_border(const Capture& capture, const std::string& split, std::size_t camera, int frame, int width) {
  const Camera& view = capture.cameras.at(camera);
  const std::filesystem::path path = capture.path / "borders" / split / view.name / image_path(capture, split, camera, frame).filename();
  if (!std::filesystem::is_regular_file(path)) return {};
  const PictureFile file(path, /*png_only=*/true);
  check_size(file, view, path.string());
  const cv::Mat picture = file.decoded();
  if (picture.type() != CV_8UC1) throw InputError(path.string(), "", "one channel of 8 bits", fmt::format("{} channels", picture.channels()));
  cv::Mat marked;
  cv::Mat(picture != 0).convertTo(marked, CV_32F);
  if (view.distorted()) {
    cv::Mat straight;
    cv::remap(marked, straight, undistortion_map(view), cv::noArray(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(0));
    marked = straight;
  }
  if (width != 0 && width != view.width) {
    const Camera size = view.scaled(width);
    cv::Mat small;
    cv::resize(marked, small, cv::Size(size.width, size.height), 0.0, 0.0, cv::INTER_AREA);
    marked = small;
  }
  const cv::Mat touched = marked > 0.0f;
  PixelMask mask{touched.cols, touched.rows, {}};
  for (int v = 0; v < touched.rows; ++v) {
    for (int u = 0; u < touched.cols; ++u) mask.inside.push_back(touched.at<std::uint8_t>(v, u) != 0);
  }
  return mask;
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
