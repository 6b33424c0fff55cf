#include "kernels/linear/cooperative.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace arah {

void record_half_weights(Commands& commands, const PackedWeights& weights, const std::string& name) {
  if (!cooperative_product(weights.inputs, weights.outputs))
    throw std::invalid_argument(fmt::format("launch '{}': {} inputs and {} outputs are not multiples of 16", name, weights.inputs, weights.outputs));
  const struct {
    uint32_t inputs, outputs;
  } constants{weights.inputs, weights.outputs};
  const uint64_t numbers = packed_floats(weights.inputs, weights.outputs);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("linear/half_weights", {linear_tile(weights.inputs, weights.outputs)});
  launch.name = name;
  launch.groups = {static_cast<uint32_t>((numbers / 8 + 63) / 64), 1, 1};
  launch.bindings = {weights.forward.elements(0, numbers), {weights.halves, half_weights_bytes(weights.inputs, weights.outputs)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {0, 6.0 * double(numbers)};
  commands.dispatch(launch);
}

CooperativeCheck check_cooperative(Device& device, uint32_t inputs, uint32_t outputs, const std::function<void(Commands&, const LinearForwardArgs&)>& checked) {
  constexpr uint32_t points = 65;  // two workgroups
  const uint32_t rows = padded_points(points);
  // Up to 1,023 of a unit with either sign: halves that need all but one bit of their significand.
  std::mt19937 generator(1);
  const auto number = [&](float unit) { return unit * static_cast<float>(static_cast<int>(generator() % 2047) - 1023); };
  std::vector<float> x(uint64_t(rows) * inputs), w(packed_floats(inputs, outputs));
  for (float& value : x) value = number(1.0f / 128);
  for (float& value : w) value = number(1.0f / 1024);
  const auto buffer = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("cooperative matrices: ") + what, bytes, BufferPlace::device); };
  Buffer floats = buffer("x", x.size() * 4), half_x = buffer("x as halves", x.size() * 2), forward = buffer("weights", w.size() * 4), halves = buffer("weights as halves", half_weights_bytes(inputs, outputs)),
         ones = buffer("identity", packed_floats(inputs, inputs) * 4), expected = buffer("result", uint64_t(rows) * outputs * 4), found = buffer("checked result", uint64_t(rows) * outputs * 4);
  device.upload(floats.slice(), x);
  device.upload(forward.slice(), w);
  Commands commands(device);
  // X becomes halves by a layer that changes nothing.
  std::vector<float> identity(packed_floats(inputs, inputs), 0.0f);
  const uint32_t tile = linear_tile(inputs, inputs);
  for (uint32_t i = 0; i < inputs; ++i) identity[uint64_t(i / tile) * (inputs + 1) * tile + (1 + i) * tile + i % tile] = 1;
  device.upload(ones.slice(), identity);
  LinearForwardArgs copy;
  copy.x = {floats.slice(), inputs, 0};
  copy.weights = {inputs, inputs, ones.slice(), {}, {}};
  copy.y = {half_x.slice(), inputs, 0, Element::half};
  copy.range.points = points;
  copy.name = "cooperative matrices: x as halves";
  record_linear_forward(commands, copy);

  LinearForwardArgs args;
  args.x = copy.y;
  args.weights = {inputs, outputs, forward.slice(), {}, {}};
  args.y = {expected.slice(), outputs, 0};
  args.range.points = points;
  args.name = "cooperative matrices: float32 kernel";
  record_linear_forward(commands, args);
  args.weights.halves = halves.slice();
  args.y = {found.slice(), outputs, 0};
  args.name = "cooperative matrices: kernel to check";
  record_half_weights(commands, args.weights, "cooperative matrices: weights");
  checked(commands, args);
  commands.submit_and_wait();

  // Both sum the same products, which are exact in float32. A sum in float32 is off by K 2^-24 of Σ |x w| at most; the matrix
  // units of a device may cut off instead of rounding, twice that, and are granted as much again. Sums in halves would be off by
  // 1e-4 and more, weights at wrong places by all of it.
  const std::vector<float> a = device.download<float>(expected.slice()), b = device.download<float>(found.slice());
  CooperativeCheck check{0, inputs * std::ldexp(1.0, -22)};
  const uint32_t columns = linear_tile(inputs, outputs);
  for (uint32_t p = 0; p < points; ++p)
    for (uint32_t o = 0; o < outputs; ++o) {
      double sizes = 1e-6;  // against 0/0
      for (uint32_t i = 0; i < inputs; ++i) sizes += std::abs(double(x[uint64_t(p) * inputs + i]) * w[uint64_t(o / columns) * (inputs + 1) * columns + (1 + i) * columns + o % columns]);
      const double error = std::abs(double(a[uint64_t(p) * outputs + o]) - b[uint64_t(p) * outputs + o]) / sizes;
      check.error = std::isfinite(error) ? std::max(check.error, error) : HUGE_VAL;
    }
  return check;
}

const std::string& cooperative_refusal(Device& device) {
  return device.once("why not cooperative matrices", [&]() -> std::string {
    if (!device.report().cooperative_matrix_missing.empty()) return device.report().cooperative_matrix_missing;
    try {
      for (const auto& [inputs, outputs] : {std::pair{16u, 16u}, {64u, 64u}, {256u, 48u}}) {
        const CooperativeCheck check = check_cooperative(device, inputs, outputs, record_linear_forward);
        if (!(check.error <= check.allowed))
          return fmt::format("the device's own check failed: an output of {} inputs is off by {:.1e} of its products' sizes, {:.1e} allowed", inputs, check.error, check.allowed);
      }
    } catch (const std::exception& error) {
      return fmt::format("the device's own check failed: {}", error.what());
    }
    return "";
  });
}

}  // namespace arah
