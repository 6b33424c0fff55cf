// Pose encoders and hypernetworks to test with: random ones, and those of the golden cases.
#pragma once

#include <string>
#include <vector>

#include "kernels/reference/hypernetwork.h"
#include "kernels/reference/pose_encoder.h"
#include "tests/golden.h"
#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {

inline PoseEncoder random_pose_encoder(const std::vector<int>& parents, unsigned seed) {
  const std::size_t n = parents.size();
  return {parents,
          random_values(kPoseFeatures * kPoseChannels * n, 0.3, seed + 1),
          random_values(kPoseFeatures, 0.3, seed + 2),
          random_values(n * kPoseHidden * kPoseHidden, 0.3, seed + 3),
          random_values(n * kPoseHidden, 0.3, seed + 4),
          random_values(n * kPoseFeatures * kPoseHidden, 0.3, seed + 5),
          random_values(n * kPoseFeatures, 0.3, seed + 6)};
}

// widths: of the code, then of each layer.
inline HyperTrunk random_trunk(const std::vector<std::size_t>& widths, unsigned seed) {
  HyperTrunk trunk;
  for (std::size_t l = 0; l + 1 < widths.size(); ++l) {
    const unsigned own = seed + 10 * static_cast<unsigned>(l);
    HyperLayer layer{widths[l], widths[l + 1], random_values(widths[l] * widths[l + 1], 1, own + 1), random_values(widths[l + 1], 1, own + 2),
                     random_values(widths[l + 1], 0.5, own + 3), random_values(widths[l + 1], 0.5, own + 4)};
    for (double& scale : layer.scale) scale += 1;
    trunk.layers.push_back(std::move(layer));
  }
  return trunk;
}

inline PoseEncoder golden_pose_encoder(const golden::Case& truth) {
  return {smpl_parents(),
          truth.values("param.enc.global.W"), truth.values("param.enc.global.b"),
          truth.values("param.enc.l1.W"), truth.values("param.enc.l1.b"),
          truth.values("param.enc.l2.W"), truth.values("param.enc.l2.b")};
}

// One SIREN layer's network; out_* its last linear layer, start the constant parameters that it adds to.
struct GoldenHyper {
  HyperTrunk trunk;
  std::vector<double> out_w, out_b, start;
};

inline GoldenHyper golden_hyper(const golden::Case& truth, std::size_t layer) {
  const std::string name = "param.hyper." + std::to_string(layer) + ".";
  GoldenHyper hyper;
  for (int i = 0; i < 2; ++i) {
    const std::string fc = name + "fc" + std::to_string(i), ln = name + "ln" + std::to_string(i);
    hyper.trunk.layers.push_back({static_cast<std::size_t>(truth.extent(fc + ".W", 1)), static_cast<std::size_t>(truth.extent(fc + ".W", 0)),
                                  truth.values(fc + ".W"), truth.values(fc + ".b"), truth.values(ln + ".w"), truth.values(ln + ".b")});
  }
  hyper.out_w = truth.values(name + "out.W");
  hyper.out_b = truth.values(name + "out.b");
  hyper.start = truth.values(name + "init");
  return hyper;
}

}  // namespace arah::reference
