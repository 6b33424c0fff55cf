// Golden case 12, one training step of a small avatar on 16 rays: its networks, the SIREN that the pose encoder and the
// hypernetwork make, and gradients by the names of the golden tensors ("lbs.0.v" of "grad.lbs.0.v").
#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "kernels/reference/film_mapping.h"
#include "kernels/reference/hypernetwork.h"
#include "kernels/reference/losses.h"
#include "kernels/reference/pose_encoder.h"
#include "tests/kernels/reference/golden_networks.h"
#include "tests/kernels/reference/pose_networks.h"

namespace arah::reference {

using NamedTensors = std::map<std::string, std::vector<double>>;

// Of the loss terms: total = Σ weight · term (README.md of the set).
inline const std::map<std::string, double> kStepWeights{{"colour_loss", 30}, {"eikonal", 50},  {"off", 100},
                                                        {"inside", 10},      {"skinning", 10}, {"params", 100}};

struct GoldenStep {
  golden::Case truth{"12_step"}, parameters{"12_step_params"}, gradients{"12_step_grads"};
  PoseEncoder encoder = golden_pose_encoder(parameters);
  std::vector<GoldenHyper> hyper;  // one a SIREN layer
  DenseNetwork mapping = golden_dense(parameters, "map", Activation::leaky_relu, Activation::none);
  DenseNetwork color = golden_dense(parameters, "col", Activation::relu, Activation::sigmoid);
  SkinningNetwork skinning = golden_skinning(parameters, truth);
  std::vector<double> bones = truth.values("in.B");
  std::vector<double> latent;  // of the step's frame
  double b = parameters.scalar("param.b");
  std::size_t rays = extent(truth, "in.dir", 0), samples = extent(truth, "in.samples.z", 1);

  GoldenStep() {
    for (std::size_t l = 0; parameters.has("param.hyper." + std::to_string(l) + ".init"); ++l)
      hyper.push_back(golden_hyper(parameters, l));
    color.layers[3].concatenates_input = true;
    const std::vector<double> codes = parameters.values("param.latent");
    latent.assign(codes.begin() + latent_begin(), codes.begin() + latent_begin() + std::ptrdiff_t(mapping.input_size()));
  }

  // dL/dlatent of all frames.
  std::vector<double> latent_gradient(const std::vector<double>& of_frame) const {
    std::vector<double> rows(parameters.values("param.latent").size(), 0.0);
    std::copy(of_frame.begin(), of_frame.end(), rows.begin() + latent_begin());
    return rows;
  }

 private:
  std::ptrdiff_t latent_begin() const {
    return std::ptrdiff_t(truth.integers("in.frame").at(0)) * std::ptrdiff_t(mapping.input_size());
  }
};

// The SIREN of the step's pose: φ = out + init a layer, [W row by row, b]; without modulation.
struct PosedSiren {
  PoseEncoderTape code;
  std::vector<HyperTape> trunks;
  Siren siren;

  explicit PosedSiren(const GoldenStep& step)
      : code(pose_encoder_forward(step.encoder, step.truth.values("in.R"), step.truth.values("in.J"))) {
    std::size_t inputs = 3;
    for (const GoldenHyper& hyper : step.hyper) {
      trunks.push_back(hyper_trunk_forward(hyper.trunk, code.code));
      std::vector<double> phi = dense_change(hyper.out_w, trunks.back().h());
      for (std::size_t i = 0; i < phi.size(); ++i) phi[i] += hyper.out_b[i] + hyper.start[i];
      const std::size_t outputs = phi.size() / (inputs + 1);
      const auto biases = phi.begin() + std::ptrdiff_t(inputs * outputs);
      siren.layers.push_back({inputs, outputs, transposed({phi.begin(), biases}, outputs, inputs), {biases, phi.end()}, {}, {}});
      inputs = outputs;
    }
  }

  // φ's weights, biases left out: what the parameter loss is of.
  std::vector<double> weights() const {
    std::vector<double> all;
    for (const SirenLayer& layer : siren.layers) all.insert(all.end(), layer.w.begin(), layer.w.end());
    return all;
  }

  // From the gradients of the generated parameters to those of hypernetwork and pose encoder.
  void backward(const GoldenStep& step, const Siren& d_siren, NamedTensors& gradients) const {
    std::vector<double> d_code(code.code.size(), 0.0);
    for (std::size_t l = 0; l < step.hyper.size(); ++l) {
      const SirenLayer& d_layer = d_siren.layers[l];
      std::vector<double> d_phi = transposed(d_layer.w, d_layer.inputs, d_layer.outputs);
      d_phi.insert(d_phi.end(), d_layer.b.begin(), d_layer.b.end());
      HyperTrunk d_trunk = step.hyper[l].trunk.zeros();
      std::vector<double> d_out(step.hyper[l].out_w.size(), 0.0);
      const std::vector<double> d_h = dense_change_backward(step.hyper[l].out_w, trunks[l].h(), d_phi, d_out);
      const std::vector<double> d = hyper_trunk_backward(step.hyper[l].trunk, trunks[l], d_h, &d_trunk);
      for (std::size_t i = 0; i < d.size(); ++i) d_code[i] += d[i];
      const std::string name = "hyper." + std::to_string(l) + ".";
      for (std::size_t i = 0; i < d_trunk.layers.size(); ++i) {
        const std::string n = std::to_string(i);
        gradients[name + "fc" + n + ".W"] = d_trunk.layers[i].w;
        gradients[name + "fc" + n + ".b"] = d_trunk.layers[i].b;
        gradients[name + "ln" + n + ".w"] = d_trunk.layers[i].scale;
        gradients[name + "ln" + n + ".b"] = d_trunk.layers[i].shift;
      }
      gradients[name + "out.W"] = d_out;
      gradients[name + "out.b"] = d_phi;
    }
    PoseEncoder d_encoder = step.encoder.zeros();
    pose_encoder_backward(step.encoder, step.truth.values("in.R"), step.truth.values("in.J"), code, d_code, &d_encoder);
    gradients["enc.global.W"] = d_encoder.global_w;
    gradients["enc.global.b"] = d_encoder.global_b;
    gradients["enc.l1.W"] = d_encoder.w1;
    gradients["enc.l1.b"] = d_encoder.b1;
    gradients["enc.l2.W"] = d_encoder.w2;
    gradients["enc.l2.b"] = d_encoder.b2;
  }
};

// The mapping network's scales and shifts, layer by layer, into the SIREN and out of its gradients.
inline void modulate(Siren& siren, const FilmModulation& film) {
  auto gamma = film.gamma.begin(), eta = film.eta.begin();
  for (std::size_t l = 0; l + 1 < siren.layers.size(); ++l) {
    const auto width = std::ptrdiff_t(siren.layers[l].outputs);
    siren.layers[l].gamma.assign(gamma, gamma + width), gamma += width;
    siren.layers[l].eta.assign(eta, eta + width), eta += width;
  }
}
inline FilmModulation modulation_of(const Siren& siren) {
  FilmModulation film;
  for (const SirenLayer& layer : siren.layers) {
    film.gamma.insert(film.gamma.end(), layer.gamma.begin(), layer.gamma.end());
    film.eta.insert(film.eta.end(), layer.eta.begin(), layer.eta.end());
  }
  return film;
}

inline void name_gradients(const std::string& prefix, const DenseNetwork& network, NamedTensors& gradients) {
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    const DenseLayer& layer = network.layers[l];
    const std::string name = prefix + "." + std::to_string(l) + ".";
    gradients[name + (layer.g.empty() ? "W" : "v")] = transposed(layer.v, layer.inputs, layer.outputs);
    if (!layer.g.empty()) gradients[name + "g"] = layer.g;
    gradients[name + "b"] = layer.b;
  }
}

}  // namespace arah::reference
