#include "kernels/reference/dense_network.h"

#include <algorithm>

#include "kernels/reference/linear.h"
#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

// Rows of a and b side by side: [points][a_size + b_size].
std::vector<double> concatenated(std::size_t points, std::span<const double> a, std::size_t a_size,
                                 std::span<const double> b, std::size_t b_size) {
  std::vector<double> result;
  result.reserve(points * (a_size + b_size));
  for (std::size_t p = 0; p < points; ++p) {
    const auto row_a = a.subspan(p * a_size, a_size);
    const auto row_b = b.subspan(p * b_size, b_size);
    result.insert(result.end(), row_a.begin(), row_a.end());
    result.insert(result.end(), row_b.begin(), row_b.end());
  }
  return result;
}

}  // namespace

std::vector<double> DenseLayer::weights() const {
  return g.empty() ? v : weight_norm_forward(inputs, outputs, v, g);
}

DenseNetwork DenseNetwork::zeros() const {
  DenseNetwork result = *this;
  for (DenseLayer& layer : result.layers) {
    for (std::vector<double>* values : {&layer.v, &layer.g, &layer.b}) std::fill(values->begin(), values->end(), 0.0);
  }
  return result;
}

DenseTape dense_forward(const DenseNetwork& network, std::size_t points, std::span<const double> x) {
  check_size("dense network: x", x.size(), points * network.input_size());
  DenseTape tape;
  tape.points = points;
  std::vector<double> h(x.begin(), x.end());
  std::size_t width = network.input_size();
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    const DenseLayer& layer = network.layers[l];
    if (layer.concatenates_input) {
      h = concatenated(points, x, network.input_size(), h, width);
      width += network.input_size();
    }
    check_size("dense network: inputs of a layer", layer.inputs, width);
    const LinearShape shape{points, layer.inputs, layer.outputs};
    tape.inputs.push_back(std::move(h));
    tape.pre_activations.push_back(linear_pre_activation(shape, tape.inputs.back(), layer.weights(), layer.b));
    h = tape.pre_activations.back();
    for (double& value : h) value = activate(layer.activation, value);
    width = layer.outputs;
  }
  tape.output = std::move(h);
  return tape;
}

std::vector<double> dense_backward(const DenseNetwork& network, const DenseTape& tape, std::span<const double> d_output,
                                   DenseNetwork* gradients) {
  const std::size_t points = tape.points;
  const std::size_t input_size = network.input_size();
  check_size("dense network backward: d_output", d_output.size(), points * network.output_size());
  std::vector<double> d_x(points * input_size, 0.0);  // what the concatenations hand back
  std::vector<double> d_h(d_output.begin(), d_output.end());
  for (std::size_t l = network.layers.size(); l-- > 0;) {
    const DenseLayer& layer = network.layers[l];
    const LinearShape shape{points, layer.inputs, layer.outputs};
    const std::vector<double> d_a = activation_gradient(layer.activation, tape.pre_activations[l], d_h);
    if (gradients != nullptr) {
      DenseLayer& target = gradients->layers.at(l);
      if (layer.g.empty()) {
        linear_weight_gradient(shape, tape.inputs[l], d_a, target.v, target.b);
      } else {
        std::vector<double> d_w(layer.v.size(), 0.0);
        linear_weight_gradient(shape, tape.inputs[l], d_a, d_w, target.b);
        weight_norm_backward(layer.inputs, layer.outputs, layer.v, layer.g, d_w, target.v, target.g);
      }
    }
    d_h = linear_input_gradient(shape, d_a, layer.weights());
    if (layer.concatenates_input) {
      const std::size_t previous = layer.inputs - input_size;
      std::vector<double> d_previous(points * previous);
      for (std::size_t p = 0; p < points; ++p) {
        const double* row = d_h.data() + p * layer.inputs;
        for (std::size_t i = 0; i < input_size; ++i) d_x[p * input_size + i] += row[i];
        std::copy(row + input_size, row + layer.inputs, d_previous.begin() + static_cast<std::ptrdiff_t>(p * previous));
      }
      d_h = std::move(d_previous);
    }
  }
  for (std::size_t i = 0; i < d_x.size(); ++i) d_x[i] += d_h[i];
  return d_x;
}

}  // namespace arah::reference
