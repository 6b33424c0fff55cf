// The mask loss of surface rendering (paper, appendix "Mask Loss", after IDR): a ray P_out that hits no surface, or that the
// mask says shows no person, learns from the least distance along it,
//   L = 1 / (α N) Σ_{P_out} BCE(mask, sigmoid(−α min_d f(x̂(d)))),
// f in cube units, the minimum over samples spread evenly over the ray's part in the body's box, the gradient that of f at
// this sample; through x̂ it reaches the skinning network too.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/rendering/field.h"
#include "host/rendering/ray_samples.h"
#include "host/training/skinning_gradient.h"
#include "host/training/training_settings.h"

namespace arah {

// α, above 0 per cube unit, with the moments of its Adam (decay 0.9 and 0.999, no weight decay). The loss falls with α
// throughout, so that α only grows.
class MaskSharpness {
 public:
  MaskSharpness(double start, double rate) : rate_(rate), alpha_(start) {}
  double alpha() const { return alpha_; }
  void learn(double gradient);
  void save(SafetensorsFile& file) const;
  void load(const SafetensorsFile& file);  // InputError where it is not there

 private:
  double rate_, alpha_, first_ = 0, second_ = 0, updates_ = 0;
};

class MaskLoss {
 public:
  // rays: at a time, a multiple of 64.
  MaskLoss(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, uint32_t rays);

  struct Rays {
    std::vector<uint32_t> pixels;  // column | row << 16
    std::vector<float> masks;      // 0 to 1
    std::vector<float> weights;    // of the rays' losses; empty: 1 each
    uint32_t first = 0;            // number of the first one among the picture's, where others are another rank's
  };
  // The loss of P_out and its effective weight gradients (+=) of the SDF and, where `skinning` is given, of the skinning
  // network. losses: the value and its derivative to α, unweighted, += at slot and slot + 1. Submits, and leaves the last
  // launches recorded.
  void record(Commands& commands, FrameOnDevice& frame, const Camera& camera, const Rays& rays, double alpha, uint32_t step, SkinningGradient* skinning, const BufferSlice& losses, uint32_t slot,
              const BufferSlice& scratch);
  uint64_t scratch_floats() const { return networks_.sdf().weight_gradient_scratch(rays_); }
  PointRootFinder& root_finder() { return samples_.root_finder(); }

  // For tests: vec4 by ray of the last ones that went together: canonical, w = 1 where a ray has a least distance.
  BufferSlice least() { return least_.slice(); }

 private:
  Device& device_;
  AvatarNetworks& networks_;
  const TrainingSettings& settings_;
  uint32_t rays_;
  RaySamples samples_;
  Field distances_;  // of samples alone
  SirenTape tape_;   // of the least ones
  Buffer least_, masks_, weights_, partials_, upstream_, no_other_path_;
};

}  // namespace arah
