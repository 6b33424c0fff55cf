// Networks of the double-precision reference on the device: their parameters up, gradients back, rows of activations
// both ways. Raw tensors lie in one flat buffer, each aligned as the device needs it, as an avatar's parameters do.
#pragma once

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "kernels/linear/dense_network.h"
#include "kernels/reference/dense_network.h"
#include "kernels/reference/linear.h"
#include "kernels/reference/siren.h"
#include "kernels/sdf/siren.h"
#include "tests/golden_tolerance.h"
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

inline std::vector<uint32_t> widths_of(const reference::DenseNetwork& network) {
  std::vector<uint32_t> widths{static_cast<uint32_t>(network.input_size())};
  for (const reference::DenseLayer& layer : network.layers) widths.push_back(static_cast<uint32_t>(layer.outputs));
  return widths;
}

inline DenseShape shape_of(const reference::DenseNetwork& network, uint32_t constant_inputs = 0) {
  const LayerKind kind = network.layers[0].g.empty() ? LayerKind::plain : LayerKind::weight_norm;
  const auto activation = [](const reference::DenseLayer& layer) { return static_cast<Activation>(layer.activation); };
  DenseShape shape = DenseShape::chain(kind, widths_of(network), activation(network.layers.front()),
                                       activation(network.layers.back()), constant_inputs);
  for (size_t l = 0; l < network.layers.size(); ++l)
    if (network.layers[l].concatenates_input) shape = shape.with_skip(static_cast<int>(l));
  return shape;
}

// A reference network on the device with room for `capacity` points. The last constant_inputs channels of its input are
// the code, the same for all points.
struct DeviceDense {
  DeviceDense(Device& on, const reference::DenseNetwork& truth, uint32_t capacity,
              const std::vector<double>& code_values = {})
      : device(on),
        shape(shape_of(truth, static_cast<uint32_t>(code_values.size()))),
        tensors(on, raw_layers(truth)),
        network(on, "network", shape, tensors.parameters(), tensors.gradients()),
        tape(on, "tape", shape, capacity, true),
        scratch(on, "scratch", network.weight_gradient_scratch(capacity) * 4, BufferPlace::device) {
    if (code_values.empty()) return;
    code = Buffer(on, "code", code_values.size() * 4, BufferPlace::device);
    code_gradient = Buffer(on, "code gradient", code_values.size() * 4, BufferPlace::device);
    on.upload(code.slice(), std::vector<float>(code_values.begin(), code_values.end()));
    on.upload(code_gradient.slice(), std::vector<float>(code_values.size(), 0.0f));
  }

  uint32_t code_size() const { return shape.layers[0].constant_count; }
  BufferSlice code_slice() { return code_size() ? code.slice().elements(0, code_size()) : BufferSlice{}; }
  BufferSlice code_gradient_slice() {
    return code_size() ? code_gradient.slice().elements(0, code_size()) : BufferSlice{};
  }
  std::vector<double> output(size_t points) {
    return read_rows(device, tape.output(), points, shape.layers.back().outputs);
  }

  // Padding of the input is finite, and must not matter.
  void write_input(const std::vector<double>& x, size_t points) {
    write_rows(device, tape.input(), shape.padded_input(), x, points, 0.5f);
  }
  void write_cotangent(const Matrix& matrix, const std::vector<double>& d, size_t points) {
    write_rows(device, matrix, shape.layers.back().padded_outputs(), d, points);
  }

  // Forward, backward with all gradients, and back to the raw parameters.
  void run(Commands& commands, uint32_t points, const std::vector<double>& d_output) {
    write_cotangent(tape.output_gradient(), d_output, points);
    network.record_pack(commands, code_slice());
    network.record_forward(commands, tape, {points, {}});
    DenseNetwork::Backward backward;
    backward.input_gradient = true;
    backward.scratch = scratch.slice();
    network.record_backward(commands, tape, {points, {}}, backward);
    network.record_unpack(commands, code_slice(), code_gradient_slice());
    commands.submit_and_wait();
  }

  Device& device;
  DenseShape shape;
  DeviceTensors tensors;
  DenseNetwork network;
  DenseTape tape;
  Buffer scratch, code, code_gradient;
};

// A reference SIREN on the device with room for `capacity` points.
struct DeviceSiren {
  DeviceSiren(Device& on, const reference::Siren& truth, bool film, uint32_t capacity, SirenTape::Holds holds)
      : device(on),
        shape{static_cast<uint32_t>(truth.feature_size()), static_cast<uint32_t>(truth.layers.size() - 1),
              static_cast<float>(truth.omega), film},
        tensors(on, raw_layers(truth, film)),
        siren(on, "siren", shape, tensors.parameters(), tensors.gradients()),
        tape(on, "tape", shape, capacity, holds),
        scratch(on, "scratch", siren.weight_gradient_scratch(capacity) * 4, BufferPlace::device) {}

  std::vector<double> sdf(size_t points) { return read_rows(device, tape.sdf(), points, 1); }
  std::vector<double> feature(size_t points) { return read_rows(device, tape.feature(), points, shape.width); }
  std::vector<double> gradient(size_t points) { return read_rows(device, tape.gradient(), points, 3); }
  std::vector<double> input_gradient(size_t points) { return read_rows(device, tape.input_gradient(), points, 3); }

  // Empty parts of the adjoint stay as they are on the device.
  void write_cotangents(const reference::SirenAdjoint& adjoint, size_t points) {
    if (!adjoint.sdf.empty()) write_rows(device, tape.sdf_cotangent(), 8, adjoint.sdf, points);
    if (!adjoint.feature.empty())
      write_rows(device, tape.feature_cotangent(), padded_channels(shape.width), adjoint.feature, points);
    if (!adjoint.gradient.empty()) write_rows(device, tape.gradient_cotangent(), 8, adjoint.gradient, points);
  }

  Device& device;
  SirenShape shape;
  DeviceTensors tensors;
  Siren siren;
  SirenTape tape;
  Buffer scratch;
};

// "grad.<prefix>.<i>.{v or W, b, g}".
inline void expect_golden_gradients(const golden::Case& truth, const std::string& prefix,
                             const std::vector<RawLayer>& gradients) {
  for (size_t l = 0; l < gradients.size(); ++l) {
    const std::string name = "grad." + prefix + "." + std::to_string(l) + ".";
    golden::expect_golden_float(truth, name + (gradients[l][2].empty() ? "W" : "v"), gradients[l][0]);
    golden::expect_golden_float(truth, name + "b", gradients[l][1]);
    if (!gradients[l][2].empty()) golden::expect_golden_float(truth, name + "g", gradients[l][2]);
  }
}

}  // namespace arah
