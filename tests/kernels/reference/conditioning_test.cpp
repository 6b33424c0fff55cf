#include <gtest/gtest.h>

#include "kernels/reference/hypernetwork.h"
#include "kernels/reference/losses.h"
#include "kernels/reference/pose_encoder.h"
#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"
#include "tests/kernels/reference/pose_networks.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

TEST(PoseEncoder, BackwardMatchesFiniteDifferences) {
  PoseEncoder encoder = random_pose_encoder({-1, 0, 0, 1, 3}, 1);
  std::vector<double> rotations = random_values(45, 1, 2), positions = random_values(15, 1, 3);
  const std::vector<double> weights = random_values(30, 1, 4);
  const auto loss = [&] { return dot(weights, pose_encoder_forward(encoder, rotations, positions).code); };
  PoseEncoder gradients = encoder.zeros();
  const PoseGradient d = pose_encoder_backward(encoder, rotations, positions,
                                               pose_encoder_forward(encoder, rotations, positions), weights, &gradients);
  expect_gradient("rotations", loss, rotations, d.rotations, 1e-5);
  expect_gradient("positions", loss, positions, d.positions, 1e-5);
  expect_gradient("global W", loss, encoder.global_w, gradients.global_w, 1e-5);
  expect_gradient("global b", loss, encoder.global_b, gradients.global_b, 1e-5);
  expect_gradient("W1", loss, encoder.w1, gradients.w1, 1e-5);
  expect_gradient("b1", loss, encoder.b1, gradients.b1, 1e-5);
  expect_gradient("W2", loss, encoder.w2, gradients.w2, 1e-5);
  expect_gradient("b2", loss, encoder.b2, gradients.b2, 1e-5);
}

TEST(PoseEncoder, OneJointAtTheOriginHasNoBone) {
  const PoseEncoder encoder = random_pose_encoder({-1}, 5);
  const std::vector<double> rotations = random_values(9, 1, 6), positions(3, 0.0);
  const PoseEncoderTape tape = pose_encoder_forward(encoder, rotations, positions);
  EXPECT_EQ(tape.inputs[kPoseChannels], 0);
  for (double value : pose_encoder_backward(encoder, rotations, positions, tape, tape.code, nullptr).positions)
    EXPECT_TRUE(std::isfinite(value));
}

TEST(HyperTrunk, BackwardMatchesFiniteDifferences) {
  HyperTrunk trunk = random_trunk({7, 6, 8}, 11);
  std::vector<double> code = random_values(7, 1, 12);
  const std::vector<double> weights = random_values(8, 1, 13);
  const auto loss = [&] { return dot(weights, hyper_trunk_forward(trunk, code).h()); };
  HyperTrunk gradients = trunk.zeros();
  const std::vector<double> d_code = hyper_trunk_backward(trunk, hyper_trunk_forward(trunk, code), weights, &gradients);
  expect_gradient("code", loss, code, d_code, 1e-5, 1e-7);
  for (std::size_t l = 0; l < 2; ++l) {
    expect_gradient("W", loss, trunk.layers[l].w, gradients.layers[l].w, 1e-5, 1e-7);
    expect_gradient("b", loss, trunk.layers[l].b, gradients.layers[l].b, 1e-5, 1e-7);
    expect_gradient("scale", loss, trunk.layers[l].scale, gradients.layers[l].scale, 1e-5, 1e-7);
    expect_gradient("shift", loss, trunk.layers[l].shift, gradients.layers[l].shift, 1e-5, 1e-7);
  }
}

TEST(DenseChange, BackwardMatchesFiniteDifferences) {
  std::vector<double> w = random_values(10 * 4, 1, 21), h = random_values(4, 1, 22);
  const std::vector<double> weights = random_values(10, 1, 23);
  const auto loss = [&] { return dot(weights, dense_change(w, h)); };
  std::vector<double> d_w(w.size(), 0.0);
  const std::vector<double> d_h = dense_change_backward(w, h, weights, d_w);
  expect_gradient("W", loss, w, d_w);
  expect_gradient("h", loss, h, d_h);
}

TEST(LowRank, BackwardMatchesFiniteDifferences) {
  LowRank l{5, 3, 4, random_values(20, 1, 31), random_values(12, 1, 32), random_values(20, 1, 33)};
  std::vector<double> h = random_values(4, 1, 34);
  const LayerChange weights{random_values(15, 1, 35), random_values(5, 1, 36)};
  const auto loss = [&] {
    const LayerChange change = low_rank_change(l, h);
    return dot(weights.w, change.w) + dot(weights.b, change.b);
  };
  LowRank gradients = l.zeros();
  const std::vector<double> d_h = low_rank_backward(l, h, weights, &gradients);
  expect_gradient("U", loss, l.u, gradients.u);
  expect_gradient("V", loss, l.v, gradients.v);
  expect_gradient("C", loss, l.c, gradients.c);
  expect_gradient("h", loss, h, d_h);
}

// Column c of a dense W is the matrix that h_c scales. Written as outputs outer products, unit vector times row, it is of low
// rank, and the coefficient that all of them share is h_c: h repeated, which a trunk with repeated rows makes, its layer
// norm's mean and variance being the same.
TEST(LowRank, WithFullRankIsTheDenseNetwork) {
  const std::size_t outputs = 5, inputs = 3, hidden = 4, rank = hidden * outputs;
  const HyperTrunk trunk = random_trunk({7, 6, hidden}, 41);
  const std::vector<double> code = random_values(7, 1, 42);
  const std::vector<double> w = random_values(outputs * inputs * hidden, 1, 43), b = random_values(outputs * hidden, 1, 44);
  const std::vector<double> h = hyper_trunk_forward(trunk, code).h();

  HyperTrunk wide = trunk;
  HyperLayer& last = wide.layers.back();
  const HyperLayer& narrow = trunk.layers.back();
  last = {narrow.inputs, rank, {}, {}, {}, {}};
  for (std::size_t c = 0; c < hidden; ++c)
    for (std::size_t k = 0; k < outputs; ++k) {
      last.w.insert(last.w.end(), &narrow.w[c * narrow.inputs], &narrow.w[c * narrow.inputs] + narrow.inputs);
      last.b.push_back(narrow.b[c]);
      last.scale.push_back(narrow.scale[c]);
      last.shift.push_back(narrow.shift[c]);
    }
  LowRank l{outputs, inputs, rank, std::vector<double>(outputs * rank, 0.0), std::vector<double>(rank * inputs, 0.0), std::vector<double>(outputs * rank, 0.0)};
  for (std::size_t c = 0; c < hidden; ++c)
    for (std::size_t k = 0; k < outputs; ++k) {
      const std::size_t r = c * outputs + k;
      l.u[k * rank + r] = 1;
      l.c[k * rank + r] = b[k * hidden + c];
      for (std::size_t i = 0; i < inputs; ++i) l.v[r * inputs + i] = w[(k * inputs + i) * hidden + c];
    }
  const LayerChange change = low_rank_change(l, hyper_trunk_forward(wide, code).h());
  golden::expect_close("W", change.w, dense_change(w, h), 1e-12);
  golden::expect_close("b", change.b, dense_change(b, h), 1e-12);
}

TEST(Hypernetwork, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("05_hyper");
  const PoseEncoder encoder = golden_pose_encoder(truth);
  const std::size_t poses = extent(truth, "in.R", 0), joints = encoder.joints(), layers = 4;
  std::vector<GoldenHyper> hyper;
  for (std::size_t l = 0; l < layers; ++l) hyper.push_back(golden_hyper(truth, l));

  PoseEncoder d_encoder = encoder.zeros();
  std::vector<GoldenHyper> d_hyper = hyper;
  for (GoldenHyper& d : d_hyper) {
    d.trunk = d.trunk.zeros();
    d.out_w.assign(d.out_w.size(), 0.0);
    d.out_b.assign(d.out_b.size(), 0.0);
  }
  std::vector<double> codes, d_rotations, d_positions;
  std::vector<std::vector<double>> phi(layers);
  double loss = 0;
  for (std::size_t p = 0; p < poses; ++p) {
    const auto part = [&](const std::string& name, std::size_t count) {
      const std::vector<double> all = truth.values(name);
      return std::vector<double>(all.begin() + std::ptrdiff_t(p * count), all.begin() + std::ptrdiff_t((p + 1) * count));
    };
    const std::vector<double> rotations = part("in.R", 9 * joints), positions = part("in.J", 3 * joints);
    const PoseEncoderTape tape = pose_encoder_forward(encoder, rotations, positions);
    codes.insert(codes.end(), tape.code.begin(), tape.code.end());
    std::vector<double> d_code(tape.code.size(), 0.0);
    for (std::size_t l = 0; l < layers; ++l) {
      const HyperTape trunk = hyper_trunk_forward(hyper[l].trunk, tape.code);
      std::vector<double> generated = dense_change(hyper[l].out_w, trunk.h());
      const std::vector<double> weights = part("in.G." + std::to_string(l), generated.size());
      for (std::size_t i = 0; i < generated.size(); ++i) {
        generated[i] += hyper[l].out_b[i] + hyper[l].start[i];
        d_hyper[l].out_b[i] += weights[i];
        loss += weights[i] * generated[i];
      }
      phi[l].insert(phi[l].end(), generated.begin(), generated.end());
      const std::vector<double> d_h = dense_change_backward(hyper[l].out_w, trunk.h(), weights, d_hyper[l].out_w);
      const std::vector<double> d = hyper_trunk_backward(hyper[l].trunk, trunk, d_h, &d_hyper[l].trunk);
      for (std::size_t i = 0; i < d.size(); ++i) d_code[i] += d[i];
    }
    const PoseGradient d = pose_encoder_backward(encoder, rotations, positions, tape, d_code, &d_encoder);
    d_rotations.insert(d_rotations.end(), d.rotations.begin(), d.rotations.end());
    d_positions.insert(d_positions.end(), d.positions.begin(), d.positions.end());
  }
  expect_golden(truth, "out.code", codes);
  expect_golden(truth, "out.L", loss);
  expect_golden(truth, "grad.R", d_rotations);
  expect_golden(truth, "grad.J", d_positions);
  expect_golden(truth, "grad.enc.global.W", d_encoder.global_w);
  expect_golden(truth, "grad.enc.global.b", d_encoder.global_b);
  expect_golden(truth, "grad.enc.l1.W", d_encoder.w1);
  expect_golden(truth, "grad.enc.l1.b", d_encoder.b1);
  expect_golden(truth, "grad.enc.l2.W", d_encoder.w2);
  expect_golden(truth, "grad.enc.l2.b", d_encoder.b2);
  for (std::size_t l = 0; l < layers; ++l) {
    expect_golden(truth, "out.phi." + std::to_string(l), phi[l]);
    const std::string name = "grad.hyper." + std::to_string(l) + ".";
    for (std::size_t i = 0; i < 2; ++i) {
      const HyperLayer& layer = d_hyper[l].trunk.layers[i];
      const std::string n = std::to_string(i);
      expect_golden(truth, name + "fc" + n + ".W", layer.w);
      expect_golden(truth, name + "fc" + n + ".b", layer.b);
      expect_golden(truth, name + "ln" + n + ".w", layer.scale);
      expect_golden(truth, name + "ln" + n + ".b", layer.shift);
    }
    expect_golden(truth, name + "out.W", d_hyper[l].out_w);
    expect_golden(truth, name + "out.b", d_hyper[l].out_b);
  }

  // The regulariser of pose 0: its weights alone, not its biases.
  std::vector<double> weights;
  const std::size_t inputs[] = {3, 32, 32, 32}, outputs[] = {32, 32, 32, 1};
  for (std::size_t l = 0; l < layers; ++l) weights.insert(weights.end(), phi[l].begin(), phi[l].begin() + std::ptrdiff_t(inputs[l] * outputs[l]));
  const ScalarLoss norm = parameter_loss(weights);
  expect_golden(truth, "out.S", norm.value);
  const std::vector<double> code(codes.begin(), codes.begin() + std::ptrdiff_t(kPoseFeatures * joints));
  std::size_t at = 0;
  for (std::size_t l = 0; l < layers; ++l) {
    std::vector<double> d_phi(outputs[l] * (inputs[l] + 1), 0.0);
    for (std::size_t i = 0; i < inputs[l] * outputs[l]; ++i) d_phi[i] = norm.gradient[at++];
    const HyperTape trunk = hyper_trunk_forward(hyper[l].trunk, code);
    std::vector<double> d_w(hyper[l].out_w.size(), 0.0);
    dense_change_backward(hyper[l].out_w, trunk.h(), d_phi, d_w);
    expect_golden(truth, "gradS.hyper." + std::to_string(l) + ".out.W", d_w);
    expect_golden(truth, "gradS.hyper." + std::to_string(l) + ".out.b", d_phi);
  }
}

}  // namespace
}  // namespace arah::reference
