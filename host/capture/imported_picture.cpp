#include "host/capture/imported_picture.h"

#include <opencv2/imgproc.hpp>

#include "host/capture/picture_file.h"
#include "host/capture/undistortion.h"
#include "host/input_error.h"

namespace arah {
namespace {

cv::Mat of_size(const cv::Mat& picture, const Camera& camera, const PictureTreatment& treatment, bool mask, const std::string& where) {
  const cv::Size size(camera.width, camera.height);
  if (picture.size() == size) return picture;
  if (!treatment.resize) {
    throw InputError(where, "size", fmt::format("{}x{}, as the other pictures of camera '{}'", size.width, size.height, camera.name),
                     fmt::format("{}x{}", picture.cols, picture.rows));
  }
  cv::Mat resized;
  cv::resize(picture, resized, size, 0.0, 0.0, mask ? cv::INTER_NEAREST : cv::INTER_AREA);
  return resized;
}

cv::Mat read_if_empty(const cv::Mat& picture, const std::string& name) { return picture.empty() ? read_picture_file(name) : picture; }

cv::Mat read_colors(const SourcePicture& source) {
  cv::Mat picture = read_if_empty(source.image, source.image_name), colors;
  if (picture.depth() == CV_16U) picture.convertTo(picture, CV_8U, 1.0 / 257.0);
  if (picture.depth() != CV_8U) throw InputError(source.image_name, "", "8 or 16 bits a channel", "another depth");
  if (picture.channels() == 3) return picture;
  cv::cvtColor(picture, colors, picture.channels() == 1 ? cv::COLOR_GRAY2BGR : cv::COLOR_BGRA2BGR);
  return colors;
}

// 255 for the person, 0 for all else; labels of parts are one person.
cv::Mat read_mask(const SourcePicture& source) {
  const cv::Mat picture = read_if_empty(source.mask, source.mask_name);
  cv::Mat channel = picture;
  if (picture.channels() > 1) cv::extractChannel(picture, channel, 0);
  cv::Mat person = channel != 0;
  for (int c = 1; c < std::min(3, picture.channels()); ++c) {
    cv::extractChannel(picture, channel, c);
    person |= channel != 0;
  }
  return person;
}

cv::Mat square(int radius) { return cv::getStructuringElement(cv::MORPH_RECT, cv::Size(2 * radius + 1, 2 * radius + 1)); }

cv::Mat remapped(const cv::Mat& picture, const cv::Mat& map, int interpolation) {
  cv::Mat result;
  cv::remap(picture, result, map, cv::noArray(), interpolation, cv::BORDER_CONSTANT, cv::Scalar());
  return result;
}

// Means over areas of colour on black and of coverage; each colour is divided by its coverage again.
cv::Mat reduced_straight(const cv::Mat& bgra, const cv::Size& size) {
  cv::Mat premultiplied, small;
  bgra.convertTo(premultiplied, CV_32F);
  for (int v = 0; v < premultiplied.rows; ++v) {
    auto* row = premultiplied.ptr<cv::Vec4f>(v);
    for (int u = 0; u < premultiplied.cols; ++u) {
      for (int c = 0; c < 3; ++c) row[u][c] *= row[u][3] / 255.0f;
    }
  }
  cv::resize(premultiplied, small, size, 0.0, 0.0, cv::INTER_AREA);
  cv::Mat result(size, CV_8UC4);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const cv::Vec4f& from = small.at<cv::Vec4f>(v, u);
      cv::Vec4b& to = result.at<cv::Vec4b>(v, u);
      to = cv::Vec4b(0, 0, 0, cv::saturate_cast<std::uint8_t>(from[3]));
      for (int c = 0; to[3] > 0 && c < 3; ++c) to[c] = cv::saturate_cast<std::uint8_t>(255.0f * from[c] / from[3]);
    }
  }
  return result;
}

}  // namespace

ImportedPicture import_picture(const SourcePicture& source, const Camera& camera, const PictureTreatment& treatment) {
  cv::Mat person = read_mask(source), colors = read_colors(source), band;
  // The band is as wide as it is in the mask's own pixels (the authors' get_mask).
  if (treatment.band > 0) {
    cv::Mat grown, shrunk;
    cv::dilate(person, grown, square(treatment.band));
    cv::erode(person, shrunk, square(treatment.band));
    band = of_size(grown & ~shrunk, camera, treatment, true, source.mask_name);
  }
  if (treatment.grow > 0) cv::dilate(person, person, square(treatment.grow));
  person = of_size(person, camera, treatment, true, source.mask_name);
  colors = of_size(colors, camera, treatment, false, source.image_name);
  if (camera.distorted()) {
    const cv::Mat map = undistortion_map(camera);
    colors = remapped(colors, map, cv::INTER_LINEAR);
    person = remapped(person, map, cv::INTER_NEAREST);
    if (!band.empty()) band = remapped(band, map, cv::INTER_NEAREST);
  }
  ImportedPicture result;
  result.bgra = cv::Mat(colors.size(), CV_8UC4, cv::Scalar(0, 0, 0, 0));
  cv::Mat opaque;
  cv::cvtColor(colors, opaque, cv::COLOR_BGR2BGRA);
  opaque.copyTo(result.bgra, person);
  result.border = band;
  if (treatment.width > 0 && treatment.width != camera.width) {
    const Camera small = camera.scaled(treatment.width);
    const cv::Size size(small.width, small.height);
    result.bgra = reduced_straight(result.bgra, size);
    if (!band.empty()) {
      cv::Mat touched;
      band.convertTo(touched, CV_32F);
      cv::resize(touched, touched, size, 0.0, 0.0, cv::INTER_AREA);
      result.border = touched > 0.0f;
    }
  }
  return result;
}

}  // namespace arah
