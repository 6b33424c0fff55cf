// Layers between rows of halves on a device's matrix units (cooperative matrices): halves are multiplied, sums are float32.
// Pictures alone; docs/decisions/arithmetic.md.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>

#include "kernels/linear/linear.h"

namespace arah {

// The device lacks what the kernel needs, or its answers are wrong.
class CooperativeMatrixError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Sizes (padded) that the kernel's blocks of 16 × 16 fill.
constexpr bool cooperative_product(uint32_t inputs, uint32_t outputs) { return inputs && outputs && inputs % 16 == 0 && outputs % 16 == 0; }
constexpr uint64_t half_weights_bytes(uint32_t inputs, uint32_t outputs) { return outputs * 4ull + uint64_t(inputs) * outputs * 2; }

// weights.forward → weights.halves, each weight rounded to the nearest half; the biases stay float32.
// Throws std::invalid_argument where cooperative_product does not hold.
void record_half_weights(Commands& commands, const PackedWeights& weights, const std::string& name);

// Why layers cannot be computed so on this device; "" where they can. The first call on a device that has what the kernel needs
// compares it there with the float32 kernel.
const std::string& cooperative_refusal(Device& device);

// What that comparison says; for tests of its own.
struct CooperativeCheck {
  double error = 0;      // the largest |difference| of an output over Σ |x w| of its products
  double allowed = 0;
};
// The float32 kernel with halves for X against `checked`, which gets the same X and weights that are halves already.
CooperativeCheck check_cooperative(Device& device, uint32_t inputs, uint32_t outputs, const std::function<void(Commands&, const LinearForwardArgs&)>& checked);

}  // namespace arah
