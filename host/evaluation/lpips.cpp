#include "host/evaluation/lpips.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <stdexcept>
#include <vector>

#include "host/evaluation/onnx_model.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* kAdvice =
    "For the authors' network: torch.onnx.export of lpips.LPIPS with opset_version=11 and the sizes of both inputs left open "
    "(dynamic_axes).";

// OpenCV writes what goes wrong inside to standard error, beside throwing it.
class QuietOpenCv {
 public:
  QuietOpenCv() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~QuietOpenCv() { cv::utils::logging::setLogLevel(before_); }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

std::string one_line(std::string text) {
  for (char& c : text)
    if (c == '\n') c = ' ';
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

// Whether the file's shape leaves room for the wanted one; -1: the file may fix nothing there.
bool shape_fits(const std::vector<int64_t>& shape, const std::vector<int64_t>& wanted) {
  if (shape.size() != wanted.size()) return false;
  for (std::size_t i = 0; i < shape.size(); ++i)
    if (shape[i] != wanted[i] && (shape[i] >= 0 || i == 1)) return false;
  return true;
}

std::vector<float> network_values(const RgbPicture& picture, const CropRectangle& crop) {
  if (picture.width < 1 || picture.height < 1 || picture.rgb.size() != 3 * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height))
    throw std::invalid_argument(fmt::format("LPIPS: {} numbers for a picture of {} x {}", picture.rgb.size(), picture.width, picture.height));
  if (crop.x0 < 0 || crop.y0 < 0 || crop.x0 >= crop.x1 || crop.y0 >= crop.y1 || crop.x1 > picture.width || crop.y1 > picture.height)
    throw std::invalid_argument(fmt::format("LPIPS: crop [{}, {}) x [{}, {}) of a picture of {} x {}", crop.x0, crop.x1, crop.y0, crop.y1, picture.width, picture.height));
  std::vector<float> values;
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (int y = crop.y0; y < crop.y1; ++y)
      for (int x = crop.x0; x < crop.x1; ++x) {
        const float value = picture.rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) + static_cast<std::size_t>(x)) + channel];
        if (!std::isfinite(value)) throw std::invalid_argument(fmt::format("LPIPS: {} at pixel ({}, {})", value, x, y));
        values.push_back(2 * value - 1);
      }
  return values;
}

}  // namespace

struct Lpips::Network {
  std::filesystem::path path;
  std::string file;
  std::string first, second;  // the inputs' names
  cv::dnn::Net net;           // for pictures of this size
  int width = 0, height = 0;

  // a, b: [3][h][w] in [-1, 1].
  double run(std::vector<float>& a, std::vector<float>& b, int w, int h) {
    const QuietOpenCv quiet;
    cv::Mat result;
    try {
      if (w != width || h != height) {
        const std::string fitted = for_opencv(file, {1, 3, h, w});
        width = height = 0;
        net = cv::dnn::readNetFromONNX(fitted.data(), fitted.size());
        net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
        net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
        width = w, height = h;
      }
      const int sizes[] = {1, 3, h, w};
      net.setInput(cv::Mat(4, sizes, CV_32F, a.data()), first);
      net.setInput(cv::Mat(4, sizes, CV_32F, b.data()), second);
      result = net.forward();
    } catch (const cv::Exception& error) {
      throw InputError(path.string(), "", fmt::format("a network that OpenCV's dnn can run on pictures of {} x {}", w, h), "this refusal: " + one_line(error.what()), kAdvice);
    }
    if (result.total() != 1 || result.type() != CV_32F) throw InputError(path.string(), "output", "one number for a pair of pictures", fmt::format("{}", result.total()), kAdvice);
    const double distance = static_cast<double>(*result.ptr<float>());
    if (!std::isfinite(distance)) throw InputError(path.string(), "output", "a finite number", fmt::format("{} for pictures of {} x {}", distance, w, h));
    return distance;
  }
};

Lpips::Lpips(const std::filesystem::path& network) : network_(std::make_unique<Network>()) {
  network_->path = network;
  std::ifstream file(network, std::ios::binary);
  if (!file || std::filesystem::is_directory(network)) throw InputError(network.string(), "", "an ONNX file of the LPIPS network", "no such file", kAdvice);
  network_->file.assign(std::istreambuf_iterator<char>(file), {});
  OnnxSignature signature;
  try {
    signature = onnx_signature(network_->file);
  } catch (const NotOnnx& error) {
    throw InputError(network.string(), "", "an ONNX file of the LPIPS network", fmt::format("a file of {} bytes that {}", network_->file.size(), error.what()), kAdvice);
  }
  const auto is_picture = [](const OnnxValue& value) { return value.element_type == kOnnxFloat32 && shape_fits(value.shape, {1, 3, -1, -1}) && !value.name.empty(); };
  if (signature.inputs.size() != 2 || !is_picture(signature.inputs[0]) || !is_picture(signature.inputs[1]) || signature.inputs[0].name == signature.inputs[1].name)
    throw InputError(network.string(), "inputs", "two of float32 [?, 3, ?, ?] (pictures, channels, rows and columns; ? is left open)", describe(signature.inputs), kAdvice);
  const auto is_number = [](const OnnxValue& value) {
    for (const int64_t size : value.shape)
      if (size > 1) return false;
    return value.element_type == kOnnxFloat32;
  };
  if (signature.outputs.size() != 1 || !is_number(signature.outputs[0])) throw InputError(network.string(), "outputs", "one of float32, with one number for a pair of pictures", describe(signature.outputs), kAdvice);
  network_->first = signature.inputs[0].name;
  network_->second = signature.inputs[1].name;

  // A ramp and a checkerboard, of sizes that neither each other nor a fixed size hides.
  constexpr int w = 80, h = 64;
  std::vector<float> ramp, squares;
  for (int i = 0; i < 3 * w * h; ++i) {
    ramp.push_back(static_cast<float>(i % w) / (w / 2) - 1);
    squares.push_back((i / 8 + i / (8 * w)) % 2 ? 0.5f : -0.5f);
  }
  const double same = network_->run(ramp, ramp, w, h), apart = network_->run(ramp, squares, w, h);
  if (std::abs(same) > 1e-6 || !(apart > 0)) throw InputError(network.string(), "output", "a distance: 0 for equal pictures, above 0 for others", fmt::format("{:g} and {:g}", same, apart), kAdvice);
}

Lpips::~Lpips() = default;
Lpips::Lpips(Lpips&&) noexcept = default;
Lpips& Lpips::operator=(Lpips&&) noexcept = default;

double Lpips::distance(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop) {
  std::vector<float> a = network_values(rendering, crop), b = network_values(truth, crop);
  return network_->run(a, b, crop.x1 - crop.x0, crop.y1 - crop.y0);
}

const std::filesystem::path& Lpips::path() const { return network_->path; }

std::string lpips_definition(const std::filesystem::path& network) {
  return fmt::format(" LPIPS: the network {} on the whole bounding rectangle, values x as 2x − 1, not quantised; lower is nearer.", network.string());
}

}  // namespace arah
