// Networks of the double-precision reference on the device: their parameters up, gradients back, rows of activations
// both ways. Raw tensors lie in one flat buffer, each aligned as the device needs it, as an avatar's parameters do.
#pragma once

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "kernels/linear/layer.h"
#include "kernels/reference/dense_network.h"
#include "kernels/reference/linear.h"
#include "kernels/reference/siren.h"
#include "tests/golden.h"
#include "tests/kernels/device_fixture.h"

namespace arah {

// One layer's tensors in the raw order of LayerTensors: weight [outputs][inputs], bias, first (g or gamma), shift
// (eta).
using RawLayer = std::array<std::vector<double>, 4>;

inline std::vector<RawLayer> raw_layers(const reference::DenseNetwork& network) {
  std::vector<RawLayer> raw;
  for (const reference::DenseLayer& layer : network.layers)
    raw.push_back({reference::transposed(layer.v, layer.inputs, layer.outputs), layer.b, layer.g, {}});
  return raw;
}

// film: with gamma and eta, which the reference always has.
inline std::vector<RawLayer> raw_layers(const reference::Siren& siren, bool film) {
  std::vector<RawLayer> raw;
  for (const reference::SirenLayer& layer : siren.layers) {
    raw.push_back({reference::transposed(layer.w, layer.inputs, layer.outputs), layer.b, {}, {}});
    if (film) raw.back()[2] = layer.gamma, raw.back()[3] = layer.eta;
  }
  return raw;
}

class DeviceTensors {
 public:
  DeviceTensors(Device& device, const std::vector<RawLayer>& layers) : device_(device) {
    std::vector<float> values;
    for (const RawLayer& layer : layers) {
      ranges_.emplace_back();
      for (size_t t = 0; t < 4; ++t) {
        values.resize((values.size() + 63) / 64 * 64);
        ranges_.back()[t] = {values.size(), layer[t].size()};
        values.insert(values.end(), layer[t].begin(), layer[t].end());
      }
    }
    parameters_ = Buffer(device, "parameters", values.size() * 4, BufferPlace::device);
    gradients_ = Buffer(device, "gradients", values.size() * 4, BufferPlace::device);
    device.upload(parameters_.slice(), values);
    clear_gradients();
  }

  std::vector<LayerTensors> parameters() { return tensors(parameters_); }
  std::vector<LayerTensors> gradients() { return tensors(gradients_); }
  void clear_gradients() { device_.upload(gradients_.slice(), std::vector<float>(gradients_.bytes() / 4, 0.0f)); }
  std::vector<RawLayer> download_gradients() {
    const std::vector<float> values = device_.download<float>(gradients_.slice());
    std::vector<RawLayer> layers(ranges_.size());
    for (size_t l = 0; l < ranges_.size(); ++l)
      for (size_t t = 0; t < 4; ++t) {
        const auto begin = values.begin() + static_cast<std::ptrdiff_t>(ranges_[l][t].first);
        layers[l][t].assign(begin, begin + static_cast<std::ptrdiff_t>(ranges_[l][t].count));
      }
    return layers;
  }

 private:
  struct Range {
    size_t first = 0, count = 0;
  };
  std::vector<LayerTensors> tensors(Buffer& buffer) {
    std::vector<LayerTensors> result;
    for (const auto& r : ranges_) {
      const auto slice = [&](const Range& range) {
        return range.count ? buffer.slice().elements(range.first, range.count) : BufferSlice{};
      };
      result.push_back({slice(r[0]), slice(r[1]), slice(r[2]), slice(r[3])});
    }
    return result;
  }

  Device& device_;
  std::vector<std::array<Range, 4>> ranges_;
  Buffer parameters_, gradients_;
};

// Writes values [points][channels] into the matrix's first columns. The other columns up to `width` and all columns of
// the rows after the points become `padding`.
inline void write_rows(Device& device, const Matrix& matrix, uint32_t width, const std::vector<double>& values,
                       size_t points, float padding = 0) {
  const size_t channels = values.size() / points;
  std::vector<float> all = device.download<float>(matrix.slice);
  for (size_t p = 0; p < all.size() / matrix.stride; ++p)
    for (size_t c = 0; c < width; ++c)
      all[p * matrix.stride + matrix.column + c] =
          p < points && c < channels ? static_cast<float>(values[p * channels + c]) : padding;
  device.upload(matrix.slice, all);
}

// The matrix's first columns, [points][channels].
inline std::vector<double> read_rows(Device& device, const Matrix& matrix, size_t points, size_t channels) {
  const std::vector<float> all = device.download<float>(matrix.slice);
  std::vector<double> values;
  for (size_t p = 0; p < points; ++p)
    for (size_t c = 0; c < channels; ++c) values.push_back(all.at(p * matrix.stride + matrix.column + c));
  return values;
}

inline std::vector<double> times(std::vector<double> values, double factor) {
  for (double& value : values) value *= factor;
  return values;
}

// Errors up to `relative` of the largest number of the truth.
inline void expect_near(const std::string& label, const std::vector<double>& actual, const std::vector<double>& truth,
                        double relative) {
  double scale = 0;
  for (double value : truth) scale = std::max(scale, std::abs(value));
  golden::expect_close(label, actual, truth, relative * scale);
}

inline void expect_near(const std::string& label, const std::vector<RawLayer>& actual,
                        const std::vector<RawLayer>& truth, double factor, double relative) {
  static const char* const parts[] = {"weight", "bias", "g or gamma", "eta"};
  ASSERT_EQ(actual.size(), truth.size());
  for (size_t l = 0; l < truth.size(); ++l)
    for (size_t t = 0; t < 4; ++t)
      if (!truth[l][t].empty())
        expect_near(label + " " + parts[t] + " " + std::to_string(l), actual[l][t], times(truth[l][t], factor),
                    relative);
}

}  // namespace arah
