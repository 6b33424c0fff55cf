// Pictures of an avatar: rays → samples → field → compositing, in chunks of rays.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "host/rendering/ray_samples.h"
#include "host/rendering/shaded_rays.h"

namespace arah {

// How pictures of an avatar are sampled: 64 samples in the paper's places where it was trained so (`sampling_mode` of its
// settings), else 32 in the template's shell.
SamplingSettings picture_sampling(const Avatar& avatar);

struct RenderSettings {
  std::optional<SamplingSettings> sampling;  // none: picture_sampling of the avatar
  double least_weight = 0;  // samples whose compositing weight is at most this stay black; 0: exact
  bool normals = false;
  uint64_t memory_bytes = 600'000'000;  // of activations: decides how many rays are rendered at a time
};

// Row-major, top left first; black background.
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<float> color;   // [pixels][3], 0..1
  std::vector<float> alpha;   // [pixels], Σ w
  std::vector<float> depth;   // [pixels], metres along the ray, Σ w z / Σ w; 0 where alpha < 0.5
  std::vector<float> normal;  // [pixels][3], world axes, Σ w n; empty unless asked for
};

class Renderer {
 public:
  // The avatar's numbers are copied to the device.
  Renderer(Device& device, const Avatar& avatar, const RenderSettings& settings);

  // progress: the part done, 0..1; return false to stop (throws std::runtime_error "stopped").
  Picture render(const Camera& camera, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress = {});
  const PointRootFinder& root_finder() const { return samples_->root_finder(); }

 private:
  void render_chunk(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, Picture& picture);

  Device& device_;
  const Avatar& avatar_;
  RenderSettings settings_;
  SamplingSettings sampling_;
  AvatarNetworks networks_;
  TemplateOnDevice body_;
  std::optional<RaySamples> samples_;
  std::optional<ShadedRays> shaded_;
  Commands commands_;
};

}  // namespace arah
