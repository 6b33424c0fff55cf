// The kernels that make a SIREN's parameters of a pose, against the double-precision truth and the golden case.
#include <cmath>

#include "kernels/conditioning/pose_networks.h"
#include "kernels/optimizer/adam.h"
#include "kernels/optimizer/clip_scale.h"
#include "kernels/optimizer/sum_of_squares.h"
#include "kernels/reference/adam.h"
#include "kernels/reference/hypernetwork.h"
#include "kernels/reference/losses.h"
#include "kernels/reference/pose_encoder.h"
#include "tests/golden_tolerance.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/reference/pose_networks.h"

namespace arah {
namespace {

namespace ref = reference;

// One flat buffer of parameters, one of their gradients, and the networks' truth.
struct Networks {
  ref::PoseEncoder encoder;
  std::vector<ref::HyperTrunk> trunks;  // one a layer of the SIREN
  struct Change {
    std::vector<double> base_w, base_b, dense_w, dense_b;
    ref::LowRank low_rank;
  };
  std::vector<Change> changes;
};

// Lays the truth's tensors out one after the other and knows where each is.
class Flat {
 public:
  uint64_t add(const std::vector<double>& values) {
    const uint64_t at = floats_.size();
    floats_.insert(floats_.end(), values.begin(), values.end());
    floats_.resize((floats_.size() + 63) / 64 * 64, 0.0f);
    return at;
  }
  const std::vector<float>& floats() const { return floats_; }

 private:
  std::vector<float> floats_;
};

class Conditioning : public DeviceTest {
 protected:
  // Rounds the truth's numbers to what the device gets.
  static void round(std::vector<double>& values) {
    for (double& value : values) value = static_cast<float>(value);
  }

  struct On {
    PoseNetworksShape shape;
    Buffer parameters, gradients;
    PoseNetworksTensors p, g;
    std::unique_ptr<PoseNetworks> networks;
    struct Places {
      uint64_t encoder = 0;
      shared::PoseEncoderConstants at{};
      std::vector<std::array<uint64_t, 4>> hidden;   // w, b, scale, shift
      std::vector<std::array<uint64_t, 7>> changes;  // base w, base b, dense w, dense b, u, v, c
    } places;
  };

  std::unique_ptr<On> put(const Networks& n, PoseChange change, const std::vector<std::array<uint32_t, 2>>& layers, uint32_t frames = 1) {
    auto on = std::make_unique<On>();
    On::Places& places = on->places;
    const size_t hidden = n.trunks[0].layers.size();
    on->shape = {change, n.encoder.parents, static_cast<uint32_t>(n.trunks[0].layers[0].outputs), static_cast<uint32_t>(hidden), layers};
    Flat flat;
    places.encoder = 0;
    places.at = {0,
                 static_cast<uint32_t>(flat.add(n.encoder.global_w)), static_cast<uint32_t>(flat.add(n.encoder.global_b)), static_cast<uint32_t>(flat.add(n.encoder.w1)),
                 static_cast<uint32_t>(flat.add(n.encoder.b1)), static_cast<uint32_t>(flat.add(n.encoder.w2)), static_cast<uint32_t>(flat.add(n.encoder.b2))};
    const uint64_t encoder_end = flat.floats().size();
    for (size_t i = 0; i < hidden; ++i) {
      std::vector<double> stacked[4];
      for (const ref::HyperTrunk& trunk : n.trunks) {
        const ref::HyperLayer& layer = trunk.layers[i];
        const std::vector<double>* parts[] = {&layer.w, &layer.b, &layer.scale, &layer.shift};
        for (size_t k = 0; k < 4; ++k) stacked[k].insert(stacked[k].end(), parts[k]->begin(), parts[k]->end());
      }
      std::array<uint64_t, 4> at{};
      for (size_t k = 0; k < 4; ++k) at[k] = flat.add(stacked[k]);
      places.hidden.push_back(at);
    }
    for (const Networks::Change& c : n.changes) {
      std::array<uint64_t, 7> at{};
      const std::vector<double>* parts[] = {&c.base_w, &c.base_b, &c.dense_w, &c.dense_b, &c.low_rank.u, &c.low_rank.v, &c.low_rank.c};
      for (size_t k = 0; k < 7; ++k) at[k] = flat.add(*parts[k]);
      places.changes.push_back(at);
    }
    on->parameters = filled("parameters", flat.floats());
    on->gradients = filled("gradients", std::vector<float>(flat.floats().size(), 0.0f));
    const auto tensors = [&](Buffer& buffer) {
      const auto slice = [&](uint64_t at, uint64_t count) { return buffer.slice().elements(at, (count + 63) / 64 * 64); };
      PoseNetworksTensors t;
      t.encoder = buffer.slice().elements(0, encoder_end);
      for (size_t i = 0; i < hidden; ++i) {
        const uint64_t w = n.trunks[0].layers[i].w.size() * n.trunks.size(), b = n.trunks[0].layers[i].b.size() * n.trunks.size();
        const auto& at = places.hidden[i];
        t.hidden.push_back({slice(at[0], w), slice(at[1], b), slice(at[2], b), slice(at[3], b)});
      }
      for (size_t l = 0; l < n.changes.size(); ++l) {
        const Networks::Change& c = n.changes[l];
        const auto& at = places.changes[l];
        t.layers.push_back({slice(at[0], c.base_w.size()), slice(at[1], c.base_b.size()), slice(at[2], c.dense_w.size()), slice(at[3], c.dense_b.size()),
                            {slice(at[4], c.low_rank.u.size()), slice(at[5], c.low_rank.v.size()), slice(at[6], c.low_rank.c.size())}});
      }
      return t;
    };
    on->p = tensors(on->parameters);
    on->g = tensors(on->gradients);
    on->networks = std::make_unique<PoseNetworks>(device, "conditioning", on->shape, on->p, places.at, &on->g, frames);
    return on;
  }

  std::vector<double> read(const BufferSlice& slice, uint64_t count) { return as_doubles(device.download<float>(slice.elements(0, count))); }

  void upload_pose(On& on, const std::vector<double>& rotations, const std::vector<double>& positions) {
    std::vector<float> pose(rotations.begin(), rotations.end());
    pose.insert(pose.end(), positions.begin(), positions.end());
    device.upload(on.networks->pose(), pose);
  }

  void upload_gradient(On& on, uint32_t l, const std::vector<double>& w, const std::vector<double>& b) {
    const LayerTensors d = on.networks->generated_gradient(l);
    device.upload(d.weight, std::vector<float>(w.begin(), w.end()));
    device.upload(d.bias, std::vector<float>(b.begin(), b.end()));
  }
};

// Six joints (a code of 36, no multiple of 8 but of 4) or five (30, of neither).
Networks random_networks(const std::vector<int>& parents, size_t width, const std::vector<std::array<uint32_t, 2>>& layers) {
  Networks n;
  n.encoder = ref::random_pose_encoder(parents, 1);
  unsigned seed = 100;
  for (const auto& [outputs, inputs] : layers) {
    n.trunks.push_back(ref::random_trunk({6 * parents.size(), width, width}, seed += 20));
    Networks::Change c;
    c.base_w = ref::random_values(size_t{outputs} * inputs, 0.5, seed += 1);
    c.base_b = ref::random_values(outputs, 0.5, seed += 1);
    c.dense_w = ref::random_values(size_t{outputs} * inputs * width, 0.2, seed += 1);
    c.dense_b = ref::random_values(outputs * width, 0.2, seed += 1);
    c.low_rank = {outputs, inputs, width, ref::random_values(outputs * width, 0.4, seed += 1), ref::random_values(inputs * width, 0.4, seed += 1), ref::random_values(outputs * width, 0.4, seed += 1)};
    n.changes.push_back(std::move(c));
  }
  return n;
}

struct Truth {
  std::vector<ref::LayerChange> generated;
  ref::PoseEncoder d_encoder;
  std::vector<ref::HyperTrunk> d_trunks;
  std::vector<Networks::Change> d_changes;
  ref::PoseGradient d_pose;
  std::vector<std::vector<double>> h;
};

// Forward, and the gradients for upstream gradients `d` of the generated parameters.
Truth truth_of(const Networks& n, PoseChange change, const std::vector<double>& rotations, const std::vector<double>& positions, const std::vector<ref::LayerChange>& d) {
  Truth t;
  t.d_encoder = n.encoder.zeros();
  const ref::PoseEncoderTape tape = pose_encoder_forward(n.encoder, rotations, positions);
  std::vector<double> d_code(tape.code.size(), 0.0);
  for (size_t l = 0; l < n.trunks.size(); ++l) {
    const Networks::Change& c = n.changes[l];
    const ref::HyperTape trunk = hyper_trunk_forward(n.trunks[l], tape.code);
    Networks::Change dc;
    std::vector<double> d_h;
    ref::LayerChange made;
    if (change == PoseChange::dense) {
      made = {ref::dense_change(c.dense_w, trunk.h()), ref::dense_change(c.dense_b, trunk.h())};
      dc.dense_w.assign(c.dense_w.size(), 0.0);
      dc.dense_b.assign(c.dense_b.size(), 0.0);
      d_h = ref::dense_change_backward(c.dense_w, trunk.h(), d[l].w, dc.dense_w);
      const std::vector<double> more = ref::dense_change_backward(c.dense_b, trunk.h(), d[l].b, dc.dense_b);
      for (size_t i = 0; i < d_h.size(); ++i) d_h[i] += more[i];
    } else {
      made = low_rank_change(c.low_rank, trunk.h());
      dc.low_rank = c.low_rank.zeros();
      d_h = low_rank_backward(c.low_rank, trunk.h(), d[l], &dc.low_rank);
    }
    for (size_t i = 0; i < made.w.size(); ++i) made.w[i] += c.base_w[i];
    for (size_t i = 0; i < made.b.size(); ++i) made.b[i] += c.base_b[i];
    t.generated.push_back(made);
    t.d_trunks.push_back(n.trunks[l].zeros());
    const std::vector<double> more = hyper_trunk_backward(n.trunks[l], trunk, d_h, &t.d_trunks.back());
    for (size_t i = 0; i < d_code.size(); ++i) d_code[i] += more[i];
    t.d_changes.push_back(std::move(dc));
    t.h.push_back(trunk.h());
  }
  t.d_pose = pose_encoder_backward(n.encoder, rotations, positions, tape, d_code, &t.d_encoder);
  return t;
}

double scale_of(const std::vector<double>& values) {
  double scale = 0;
  for (double value : values) scale = std::max(scale, std::abs(value));
  return scale;
}

TEST_F(Conditioning, BothChangesMatchTheTruth) {
  const std::vector<std::array<uint32_t, 2>> layers{{20, 3}, {20, 20}, {1, 20}};
  for (const std::vector<int>& parents : {std::vector<int>{-1, 0, 0, 1, 3}, std::vector<int>{-1, 0, 1, 2, 0, 4}})
    for (const PoseChange change : {PoseChange::dense, PoseChange::low_rank}) {
      SCOPED_TRACE(change == PoseChange::dense ? "dense" : "low rank");
      const Networks n = random_networks(parents, 24, layers);
      const size_t joints = parents.size();
      const std::vector<double> rotations = as_doubles(uniform(9 * joints)), positions = as_doubles(uniform(3 * joints));
      std::vector<ref::LayerChange> d;
      for (const auto& [outputs, inputs] : layers) d.push_back({as_doubles(uniform(size_t{outputs} * inputs)), as_doubles(uniform(outputs))});
      const Truth truth = truth_of(n, change, rotations, positions, d);

      const auto on = put(n, change, layers);
      upload_pose(*on, rotations, positions);
      on->networks->record_clear_gradient(commands);
      on->networks->record_forward(commands);
      commands.submit_and_wait();
      for (uint32_t l = 0; l < layers.size(); ++l) {
        const ref::LayerChange& t = truth.generated[l];
        expect_close("W " + std::to_string(l), read(on->networks->generated(l).weight, t.w.size()), t.w, 3e-6 * scale_of(t.w));
        expect_close("b " + std::to_string(l), read(on->networks->generated(l).bias, t.b.size()), t.b, 3e-6 * scale_of(t.b));
        upload_gradient(*on, l, d[l].w, d[l].b);
      }
      on->networks->record_backward(commands);
      on->networks->record_backward(commands);  // raw gradients are added to
      commands.submit_and_wait();
      const auto expect = [&](const std::string& name, const BufferSlice& slice, std::vector<double> t, double times = 2) {
        for (double& value : t) value *= times;
        expect_close(name, read(slice, t.size()), t, 5e-6 * scale_of(t));
      };
      for (uint32_t l = 0; l < layers.size(); ++l) {
        const std::string at = " " + std::to_string(l);
        expect("base W" + at, on->g.layers[l].base_w, d[l].w);
        expect("base b" + at, on->g.layers[l].base_b, d[l].b);
        if (change == PoseChange::low_rank) {
          expect("U" + at, on->g.layers[l].low_rank.u, truth.d_changes[l].low_rank.u);
          expect("V" + at, on->g.layers[l].low_rank.v, truth.d_changes[l].low_rank.v);
          expect("C" + at, on->g.layers[l].low_rank.c, truth.d_changes[l].low_rank.c);
        }
      }
      for (size_t i = 0; i < 2; ++i) {
        std::vector<double> w, b, scale, shift;
        for (const ref::HyperTrunk& trunk : truth.d_trunks) {
          const ref::HyperLayer& layer = trunk.layers[i];
          w.insert(w.end(), layer.w.begin(), layer.w.end());
          b.insert(b.end(), layer.b.begin(), layer.b.end());
          scale.insert(scale.end(), layer.scale.begin(), layer.scale.end());
          shift.insert(shift.end(), layer.shift.begin(), layer.shift.end());
        }
        const std::string at = " " + std::to_string(i);
        expect("hidden W" + at, on->g.hidden[i].w, w);
        expect("hidden b" + at, on->g.hidden[i].b, b);
        expect("scale" + at, on->g.hidden[i].scale, scale);
        expect("shift" + at, on->g.hidden[i].shift, shift);
      }
      const auto& at = on->places.at;
      const auto encoder = [&](const char* name, uint32_t first, const std::vector<double>& t) { expect(name, on->g.encoder.elements(first, t.size()), t); };
      encoder("global W", at.global_w, truth.d_encoder.global_w);
      encoder("global b", at.global_b, truth.d_encoder.global_b);
      encoder("W1", at.w1, truth.d_encoder.w1);
      encoder("b1", at.b1, truth.d_encoder.b1);
      encoder("W2", at.w2, truth.d_encoder.w2);
      encoder("b2", at.b2, truth.d_encoder.b2);
      std::vector<double> d_pose = truth.d_pose.rotations;
      d_pose.insert(d_pose.end(), truth.d_pose.positions.begin(), truth.d_pose.positions.end());
      expect("pose", on->networks->pose_gradient(), d_pose, 1);
    }
}

TEST_F(Conditioning, WithLastLayersOfZeroTheParametersAreTheSharedOnes) {
  const std::vector<std::array<uint32_t, 2>> layers{{16, 3}, {1, 16}};
  for (const PoseChange change : {PoseChange::dense, PoseChange::low_rank}) {
    Networks n = random_networks({-1, 0}, 8, layers);
    for (Networks::Change& c : n.changes)
      for (std::vector<double>* zero : {&c.dense_w, &c.dense_b, &c.low_rank.u, &c.low_rank.c}) zero->assign(zero->size(), 0.0);
    const auto on = put(n, change, layers);
    upload_pose(*on, as_doubles(uniform(18)), as_doubles(uniform(6)));
    on->networks->record_forward(commands);
    commands.submit_and_wait();
    for (uint32_t l = 0; l < layers.size(); ++l) {
      std::vector<double> w = n.changes[l].base_w, b = n.changes[l].base_b;
      round(w), round(b);
      EXPECT_EQ(read(on->networks->generated(l).weight, w.size()), w);
      EXPECT_EQ(read(on->networks->generated(l).bias, b.size()), b);
    }
  }
}

// Three frames of a step: the outer products' norm and Adam step are those of their sum, written out.
TEST_F(Conditioning, AdamFormsTheOuterProducts) {
  const std::vector<std::array<uint32_t, 2>> layers{{20, 3}, {1, 20}};
  const uint32_t frames = 3, l = 0;
  const Networks n = random_networks({-1, 0, 1}, 16, layers);
  const auto on = put(n, PoseChange::dense, layers, frames);
  std::vector<double> gradient(n.changes[l].dense_w.size(), 0.0);
  for (uint32_t f = 0; f < frames; ++f) {
    const std::vector<double> rotations = as_doubles(uniform(27)), positions = as_doubles(uniform(9));
    std::vector<ref::LayerChange> d;
    for (const auto& [outputs, inputs] : layers) d.push_back({as_doubles(uniform(size_t{outputs} * inputs)), as_doubles(uniform(outputs))});
    const Truth truth = truth_of(n, PoseChange::dense, rotations, positions, d);
    for (size_t i = 0; i < gradient.size(); ++i) gradient[i] += truth.d_changes[l].dense_w[i];
    upload_pose(*on, rotations, positions);
    on->networks->record_forward(commands);
    commands.submit_and_wait();
    for (uint32_t k = 0; k < layers.size(); ++k) upload_gradient(*on, k, d[k].w, d[k].b);
    on->networks->record_backward(commands, f);
    commands.submit_and_wait();
  }
  double squares = 0;
  for (double g : gradient) squares += g * g;
  const double norm = std::sqrt(squares), limit = norm / 3;

  const size_t count = gradient.size(), padded = (count + 63) / 64 * 64;
  Buffer m = filled("m", std::vector<float>(padded, 0.0f)), v = filled("v", std::vector<float>(padded, 0.0f)), norms = empty("norms", 256), partials = empty("partials", 256);
  const OuterProduct outer = on->networks->dense_w_gradient(l, frames);
  record_outer_norm(commands, outer, partials.slice(), 0);
  record_clip_scale(commands, {outer_partials(frames), partials.slice(), static_cast<float>(limit), norms.slice(), 0});
  AdamArgs adam;
  adam.rate = 1e-3;
  adam.parameters = on->p.layers[l].dense_w;
  adam.first_moments = m.slice().elements(0, padded);
  adam.second_moments = v.slice().elements(0, padded);
  adam.outer = outer;
  adam.norms = norms.slice();
  record_adam(commands, adam);
  commands.submit_and_wait();
  EXPECT_NEAR(device.download<shared::GradientNorm>(norms.slice())[0].norm, norm, 1e-5 * norm);
  EXPECT_EQ(device.download<shared::GradientNorm>(norms.slice())[0].nonfinite, 0u);

  std::vector<double> p = n.changes[l].dense_w, first(count, 0.0), second(count, 0.0);
  round(p);
  const std::vector<ref::AdamGroup> group{{0, count, 1e-3, 0, limit}};
  ref::adam_step(p, gradient, first, second, group, 1);
  expect_close("m", read(m.slice(), count), first, 1e-5 * scale_of(first));
  expect_close("v", read(v.slice(), count), second, 2e-5 * scale_of(second));
  // The first step is the rate in the direction of the sign: where a gradient is nearly 0 rounding may turn it.
  const std::vector<double> found = read(on->p.layers[l].dense_w, count);
  for (size_t i = 0; i < count; ++i)
    if (std::abs(gradient[i]) > 1e-4 * scale_of(gradient)) {
      ASSERT_NEAR(found[i], p[i], 2e-6) << i;
    }
}

TEST_F(Conditioning, ANumberThatIsNotFiniteStopsTheOuterProduct) {
  const std::vector<std::array<uint32_t, 2>> layers{{8, 3}};
  const auto on = put(random_networks({-1}, 8, layers), PoseChange::dense, layers);
  upload_pose(*on, as_doubles(uniform(9)), as_doubles(uniform(3)));
  on->networks->record_forward(commands);
  commands.submit_and_wait();
  std::vector<double> w = as_doubles(uniform(24));
  w[7] = std::numeric_limits<double>::infinity();
  upload_gradient(*on, 0, w, as_doubles(uniform(8)));
  on->networks->record_backward(commands);
  Buffer partials = empty("partials", 256), norms = empty("norms", 256);
  record_outer_norm(commands, on->networks->dense_w_gradient(0), partials.slice(), 0);
  record_clip_scale(commands, {1, partials.slice(), 1, norms.slice(), 0});
  commands.submit_and_wait();
  const auto norm = device.download<shared::GradientNorm>(norms.slice())[0];
  EXPECT_EQ(norm.nonfinite, 1u);
  EXPECT_EQ(norm.usable, 0u);
}

TEST_F(Conditioning, ParameterNormMatchesTheTruth) {
  const std::vector<std::array<uint32_t, 2>> layers{{20, 3}, {20, 20}, {1, 20}};
  const Networks n = random_networks({-1, 0}, 16, layers);
  const auto on = put(n, PoseChange::dense, layers);
  upload_pose(*on, as_doubles(uniform(18)), as_doubles(uniform(6)));
  Buffer losses = filled("losses", std::vector<float>{5, 7});
  on->networks->record_clear_gradient(commands);
  on->networks->record_forward(commands);
  on->networks->record_parameter_norm(commands, 100, losses.slice(), 1);
  commands.submit_and_wait();
  std::vector<double> phi, gradient;
  for (uint32_t l = 0; l < layers.size(); ++l) {
    const size_t count = size_t{layers[l][0]} * layers[l][1];
    const std::vector<double> w = read(on->networks->generated(l).weight, count), d = read(on->networks->generated_gradient(l).weight, count);
    phi.insert(phi.end(), w.begin(), w.end());
    gradient.insert(gradient.end(), d.begin(), d.end());
    EXPECT_EQ(read(on->networks->generated_gradient(l).bias, layers[l][0]), std::vector<double>(layers[l][0], 0.0)) << "biases are not counted";
  }
  ref::ScalarLoss truth = ref::parameter_loss(phi);
  for (double& value : truth.gradient) value *= 100;
  EXPECT_NEAR(device.download<float>(losses.slice())[1], 7 + truth.value, 1e-5);
  EXPECT_EQ(device.download<float>(losses.slice())[0], 5);
  expect_close("gradient", gradient, truth.gradient, 1e-6 * scale_of(truth.gradient));
}

TEST_F(Conditioning, RefusesSizesThatDoNotFit) {
  const std::vector<std::array<uint32_t, 2>> layers{{8, 3}};
  EXPECT_THROW(put(random_networks({-1}, 12, layers), PoseChange::dense, layers), std::invalid_argument) << "a width that is no multiple of 8";
  EXPECT_THROW(put(random_networks({-1}, 8, layers), PoseChange::dense, {{8, 3}, {8, 8}}), std::invalid_argument);
  std::vector<int> chain;
  for (int j = 0; j < 65; ++j) chain.push_back(j - 1);
  const auto on = put(random_networks(chain, 8, layers), PoseChange::dense, layers);
  EXPECT_THROW(on->networks->record_forward(commands), std::invalid_argument) << "65 joints";
}

TEST_F(Conditioning, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("05_hyper");
  const std::vector<std::array<uint32_t, 2>> layers{{32, 3}, {32, 32}, {32, 32}, {1, 32}};
  const size_t poses = 2, joints = 24;
  Networks n;
  n.encoder = ref::golden_pose_encoder(truth);
  for (size_t l = 0; l < layers.size(); ++l) {
    const ref::GoldenHyper hyper = ref::golden_hyper(truth, l);
    n.trunks.push_back(hyper.trunk);
    std::vector<double> base = hyper.start;
    for (size_t i = 0; i < base.size(); ++i) base[i] += hyper.out_b[i];
    const auto split = [&](const std::vector<double>& all, size_t a_number) {
      const auto weights = std::ptrdiff_t(size_t{layers[l][0]} * layers[l][1] * a_number);
      return std::pair{std::vector<double>(all.begin(), all.begin() + weights), std::vector<double>(all.begin() + weights, all.end())};
    };
    Networks::Change c;
    std::tie(c.base_w, c.base_b) = split(base, 1);
    std::tie(c.dense_w, c.dense_b) = split(hyper.out_w, 32);
    n.changes.push_back(std::move(c));
  }
  const auto on = put(n, PoseChange::dense, layers, poses);
  std::vector<double> d_rotations, d_positions;
  std::vector<std::vector<double>> phi(layers.size());
  for (uint32_t p = 0; p < poses; ++p) {
    const auto part = [&](const std::string& name, size_t count) {
      const std::vector<double> all = truth.values(name);
      return std::vector<double>(all.begin() + std::ptrdiff_t(p * count), all.begin() + std::ptrdiff_t((p + 1) * count));
    };
    upload_pose(*on, part("in.R", 9 * joints), part("in.J", 3 * joints));
    on->networks->record_forward(commands);
    commands.submit_and_wait();
    for (uint32_t l = 0; l < layers.size(); ++l) {
      const size_t weights = size_t{layers[l][0]} * layers[l][1];
      for (const std::vector<double>& values : {read(on->networks->generated(l).weight, weights), read(on->networks->generated(l).bias, layers[l][0])})
        phi[l].insert(phi[l].end(), values.begin(), values.end());
      const std::vector<double> d = part("in.G." + std::to_string(l), weights + layers[l][0]);
      upload_gradient(*on, l, {d.begin(), d.begin() + std::ptrdiff_t(weights)}, {d.begin() + std::ptrdiff_t(weights), d.end()});
    }
    on->networks->record_backward(commands, p);
    commands.submit_and_wait();
    const std::vector<double> d_pose = read(on->networks->pose_gradient(), 12 * joints);
    d_rotations.insert(d_rotations.end(), d_pose.begin(), d_pose.begin() + std::ptrdiff_t(9 * joints));
    d_positions.insert(d_positions.end(), d_pose.begin() + std::ptrdiff_t(9 * joints), d_pose.end());
  }
  golden::expect_golden_float(truth, "grad.R", d_rotations);
  golden::expect_golden_float(truth, "grad.J", d_positions);
  const auto& at = on->places.at;
  const auto expect = [&](const std::string& name, const BufferSlice& slice) { golden::expect_golden_float(truth, name, read(slice, truth.values(name).size())); };
  const auto encoder = [&](const std::string& name, uint32_t first) { expect("grad.enc." + name, on->g.encoder.elements(first, truth.values("grad.enc." + name).size())); };
  encoder("global.W", at.global_w);
  encoder("global.b", at.global_b);
  encoder("l1.W", at.w1);
  encoder("l1.b", at.b1);
  encoder("l2.W", at.w2);
  encoder("l2.b", at.b2);
  for (uint32_t l = 0; l < layers.size(); ++l) {
    golden::expect_golden_float(truth, "out.phi." + std::to_string(l), phi[l]);
    const std::string name = "grad.hyper." + std::to_string(l) + ".";
    for (size_t i = 0; i < 2; ++i) {
      const uint64_t width = 32, inputs = i == 0 ? 144 : 32;
      const std::string k = std::to_string(i);
      expect(name + "fc" + k + ".W", on->g.hidden[i].w.elements(l * width * inputs, width * inputs));
      expect(name + "fc" + k + ".b", on->g.hidden[i].b.elements(l * width, width));
      expect(name + "ln" + k + ".w", on->g.hidden[i].scale.elements(l * width, width));
      expect(name + "ln" + k + ".b", on->g.hidden[i].shift.elements(l * width, width));
    }
    const size_t weights = size_t{layers[l][0]} * layers[l][1];
    std::vector<double> out = read(on->g.layers[l].base_w, weights), bias = read(on->g.layers[l].base_b, layers[l][0]);
    out.insert(out.end(), bias.begin(), bias.end());
    golden::expect_golden_float(truth, name + "out.b", out);
  }
}

}  // namespace
}  // namespace arah
