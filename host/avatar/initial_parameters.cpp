// First values of an avatar's parameters, drawn tensor by tensor.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string_view>

#include "host/avatar/parameter_layout.h"

namespace arah {
namespace {

constexpr double kGridStd = 0.01;
constexpr double kMappingSlope = 0.2;  // of the mapping network's leaky ReLU

// The standard library's distributions differ between implementations; the engine and these formulas do not.
class Stream {
 public:
  Stream(uint64_t seed, std::string_view name) {
    uint64_t hash = 14695981039346656037u;  // FNV-1a
    for (char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
    std::seed_seq words{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32), static_cast<uint32_t>(hash),
                        static_cast<uint32_t>(hash >> 32)};
    engine_.seed(words);
  }

  double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }  // [0, 1)

  void uniform(std::span<float> values, double bound) {
    for (float& value : values) value = static_cast<float>(bound * (2.0 * unit() - 1.0));
  }

  void normal(std::span<float> values, double deviation) {
    for (float& value : values) {
      const double radius = std::sqrt(-2.0 * std::log(1.0 - unit()));  // Box–Muller; 1 − u lies in (0, 1]
      value = static_cast<float>(deviation * radius * std::cos(2.0 * std::numbers::pi * unit()));
    }
  }

 private:
  std::mt19937_64 engine_;
};

// The tensors of one network's layers, by name.
class Initializer {
 public:
  Initializer(const ParameterLayout& layout, uint64_t seed, std::vector<float>& values)
      : layout_(layout), seed_(seed), values_(values) {}

  std::span<float> of(const TensorSlot& slot) { return std::span(values_).subspan(slot.offset, slot.count); }

  void uniform(const TensorSlot& slot, double bound) { Stream(seed_, slot.name).uniform(of(slot), bound); }
  void normal(const TensorSlot& slot, double deviation) { Stream(seed_, slot.name).normal(of(slot), deviation); }

  // `draw(i, weight slot, inputs)` fills the weights of layer i; biases follow the usual default, uniform in
  // ±1/√inputs.
  template <typename Draw>
  void network(const std::string& name, const std::string& weight, const Draw& draw) {
    for (int i = 0; layout_.has(layer_name(name, i) + "b"); ++i) {
      const TensorSlot& weights = layout_.slot(layer_name(name, i) + weight);
      const double inputs = static_cast<double>(weights.shape[1]);
      draw(i, weights, inputs);
      uniform(layout_.slot(layer_name(name, i) + "b"), 1.0 / std::sqrt(inputs));
    }
  }

  void weight_norm_network(const std::string& name) {
    network(name, "v", [&](int i, const TensorSlot& v, double inputs) {
      uniform(v, 1.0 / std::sqrt(inputs));
      const std::span<float> directions = of(v), lengths = of(layout_.slot(layer_name(name, i) + "g"));
      const std::size_t columns = static_cast<std::size_t>(v.shape[1]);
      for (std::size_t row = 0; row < lengths.size(); ++row) {
        double square = 0;
        for (float x : directions.subspan(row * columns, columns))
          square += static_cast<double>(x) * static_cast<double>(x);
        lengths[row] = static_cast<float>(std::sqrt(square));
      }
    });
  }

 private:
  static std::string layer_name(const std::string& name, int i) { return name + "." + std::to_string(i) + "."; }

  const ParameterLayout& layout_;
  uint64_t seed_;
  std::vector<float>& values_;
};

}  // namespace

std::vector<float> initial_parameters(const AvatarSpec& spec, const ParameterLayout& layout, uint64_t seed) {
  std::vector<float> values(layout.floats, 0.0f);
  Initializer fill(layout, seed, values);
  fill.network("sdf", "W", [&](int i, const TensorSlot& w, double inputs) {
    fill.uniform(w, i == 0 ? 1.0 / inputs : std::sqrt(6.0 / inputs) / spec.sdf.omega);
  });
  fill.network("mapping", "W", [&](int, const TensorSlot& w, double inputs) {
    fill.normal(w, std::sqrt(2.0 / ((1.0 + kMappingSlope * kMappingSlope) * inputs)));
  });
  if (spec.sdf.conditioning == SdfConditioning::latent) {
    // The modulation starts as the identity, γ = 1 and η = 0, whatever the code.
    const std::string last = "mapping." + std::to_string(spec.sdf.mapping_hidden_layers);
    std::ranges::fill(fill.of(layout.slot(last + ".W")), 0.0f);
    const std::span<float> bias = fill.of(layout.slot(last + ".b"));
    std::ranges::fill(bias.first(bias.size() / 2), 1.0f);
    std::ranges::fill(bias.last(bias.size() / 2), 0.0f);
  }
  fill.weight_norm_network("skinning");
  fill.weight_norm_network("color");
  if (layout.has("pose_code.1.W")) {
    for (const char* part : {"global", "1", "2"}) {
      const std::string name = std::string("pose_code.") + part;
      const double bound = 1.0 / std::sqrt(static_cast<double>(layout.slot(name + ".W").shape.back()));
      fill.uniform(layout.slot(name + ".W"), bound);
      fill.uniform(layout.slot(name + ".b"), bound);
    }
  }
  for (int i = 0; layout.has("hyper." + std::to_string(i) + ".W"); ++i) {
    const std::string name = "hyper." + std::to_string(i) + ".";
    const double inputs = static_cast<double>(layout.slot(name + "W").shape.back());
    fill.normal(layout.slot(name + "W"), std::sqrt(2.0 / inputs));
    fill.uniform(layout.slot(name + "b"), 1.0 / std::sqrt(inputs));
    std::ranges::fill(fill.of(layout.slot(name + "scale")), 1.0f);
  }
  for (int l = 0; layout.has("low_rank." + std::to_string(l) + ".V"); ++l) {
    const TensorSlot& v = layout.slot("low_rank." + std::to_string(l) + ".V");
    fill.normal(v, 1.0 / std::sqrt(static_cast<double>(v.shape.back())));
  }
  if (spec.latent_size > 0) fill.normal(layout.slot("latent"), spec.latent_init_std);
  fill.of(layout.slot("b"))[0] = static_cast<float>(spec.b_init);
  for (std::size_t i = 0; i < spec.grid_cells.size(); ++i) {
    fill.normal(layout.slot("grid." + std::to_string(i)), kGridStd);
  }
  return values;
}

}  // namespace arah
