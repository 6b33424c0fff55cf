#include "host/evaluation/video.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>

#include "host/capture/picture_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

struct Codec {
  std::array<char, 4> tag;
  const char* name;
};
constexpr std::array<Codec, 2> mp4_codecs{{{{'a', 'v', 'c', '1'}, "H.264"}, {{'m', 'p', '4', 'v'}, "MPEG-4 part 2"}}};

// Blue first, over the background, of an even size.
cv::Mat over_background(const fs::path& path, const cv::Scalar& background) {
  const cv::Mat picture = read_picture_file(path, /*png_only=*/true);
  if (picture.depth() != CV_8U || picture.channels() < 3) throw InputError(path.string(), "", "a PNG of 8 bits in colour", "another kind");
  const int channels = picture.channels();
  cv::Mat frame((picture.rows + 1) / 2 * 2, (picture.cols + 1) / 2 * 2, CV_8UC3, background);
  for (int y = 0; y < picture.rows; ++y) {
    const std::uint8_t* from = picture.ptr<std::uint8_t>(y);
    std::uint8_t* to = frame.ptr<std::uint8_t>(y);
    for (int x = 0; x < picture.cols; ++x, from += channels)
      for (int c = 0; c < 3; ++c, ++to) {
        const double alpha = channels == 4 ? from[3] / 255.0 : 1.0;
        *to = static_cast<std::uint8_t>(std::lround(alpha * from[c] + (1 - alpha) * background[c]));
      }
  }
  return frame;
}

}  // namespace

std::string write_video(const fs::path& path, std::span<const fs::path> pictures, double fps, const std::array<float, 3>& background) {
  if (pictures.empty()) throw std::invalid_argument("a video of no pictures");
  const cv::Scalar blue_first(255.0 * background[2], 255.0 * background[1], 255.0 * background[0]);
  const cv::Mat first = over_background(pictures[0], blue_first);
  // The encoder knows the format by the name's end.
  const fs::path temporary = path.parent_path() / fmt::format(".{}.{}.part.mp4", path.filename().string().substr(0, 200), ::getpid());
  cv::VideoWriter writer;
  const char* name = nullptr;
  for (const Codec& codec : mp4_codecs) {
    if (!writer.open(temporary.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc(codec.tag[0], codec.tag[1], codec.tag[2], codec.tag[3]), fps, first.size())) continue;
    name = codec.name;
    break;
  }
  if (!name) {
    fs::remove(temporary);
    throw std::runtime_error(fmt::format("{}: no MP4 could be begun: OpenCV has no FFmpeg with an encoder for H.264 or MPEG-4, or the folder takes no file", path.string()));
  }
  try {
    for (const fs::path& picture : pictures) {
      const cv::Mat frame = over_background(picture, blue_first);
      if (frame.size() != first.size())
        throw InputError(picture.string(), "", fmt::format("{} x {} pixels, as the first picture", first.cols, first.rows), fmt::format("{} x {}", frame.cols, frame.rows));
      writer.write(frame);
    }
    writer.release();
    // VideoWriter keeps write errors to itself: the file must hold every picture.
    cv::VideoCapture written(temporary.string(), cv::CAP_FFMPEG);
    const double frames = written.isOpened() ? written.get(cv::CAP_PROP_FRAME_COUNT) : 0;
    if (std::lround(frames) != static_cast<long>(pictures.size()))
      throw std::runtime_error(fmt::format("{}: the video holds {:.0f} of {} pictures: is the disk full?", path.string(), frames, pictures.size()));
    fs::rename(temporary, path);
  } catch (...) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw;
  }
  return name;
}

}  // namespace arah
