// Activations on the device, through a linear layer whose weights are the identity.
#pragma once

#include <algorithm>
#include <vector>

#include "kernels/linear/linear.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {

class ActivationsOnDevice : public DeviceTest {
 protected:
  struct Activated {
    std::vector<double> value, slope;  // act(x); act'(x), as the way back finds it from what the way forward stored
  };
  // One number a point: a product of 0 with what is not finite would be NaN. forward_only: there is no slope then.
  Activated activate(Activation activation, const std::vector<float>& x, bool forward_only = false) {
    constexpr uint32_t channels = 8;
    const uint32_t points = static_cast<uint32_t>(x.size()), padded = padded_points(points);
    EffectiveWeights first{channels, channels, std::vector<double>(channels * channels), std::vector<double>(channels)};
    first.w[0] = 1;  // the other channels are 0
    std::vector<float> rows(size_t(padded) * channels, 0.0F), ones(size_t(padded) * channels, 1.0F);
    for (size_t i = 0; i < points; ++i) rows[channels * i] = x[i];
    Buffer input = filled("x", rows), weights = filled("identity", packed_forward(first)), value = empty("values", rows.size() * 4), cosine = empty("cosines", rows.size() * 4), d_value = filled("ones", ones), slope = empty("slopes", rows.size() * 4);
    LinearForwardArgs args;
    args.x = {input.slice(), channels, 0};
    args.weights = {channels, channels, weights.slice(), {}};
    args.y = {value.slice(), channels, 0};
    args.activation = activation;
    if (activation == Activation::sine) args.cosine = {cosine.slice(), channels, 0};
    args.range.points = points;
    record_linear_forward(commands, args);
    const Matrix stored = {activation == Activation::sine ? cosine.slice() : value.slice(), channels, 0};
    if (!forward_only) record_activation_gradient(commands, {{d_value.slice(), channels, 0}, stored, {slope.slice(), channels, 0}, activation, channels, points});
    commands.submit_and_wait();
    const std::vector<float> values = device.download<float>(value.slice());
    std::vector<float> slopes(values.size(), 0.0F);
    if (!forward_only) slopes = device.download<float>(slope.slice());
    Activated result;
    for (size_t i = 0; i < points; ++i) result.value.push_back(values[channels * i]), result.slope.push_back(slopes[channels * i]);
    return result;
  }
};

}  // namespace arah
