// Pictures of an avatar: rays → samples → field → compositing, in chunks of rays.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "host/rendering/distance_slice.h"
#include "host/rendering/inspection.h"
#include "host/rendering/ray_samples.h"
#include "host/rendering/render_settings.h"
#include "host/rendering/rendering_stopped.h"
#include "host/rendering/shaded_rays.h"
#include "host/rendering/skinning_weights.h"
#include "host/rendering/surface_mesh.h"

namespace arah {

// Row-major, top left first; black background.
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<float> color;   // [pixels][3], 0..1
  std::vector<float> alpha;   // [pixels], Σ w
  std::vector<float> depth;   // [pixels], metres along the ray, Σ w z / Σ w; 0 where alpha < 0.5
  std::vector<float> normal;  // [pixels][3], world axes, Σ w n; empty unless asked for
  std::optional<Inspection> inspection;  // with RenderSettings::inspect
};

// What there is of a picture while it is made.
struct PictureSoFar {
  double part = 0;         // done, 0..1
  const Picture& picture;  // with pixel_step s > 1 of every s-th row and column
  int rows = 0;            // of it, from the top, that are as they will be
};
// Returns whether to go on.
using RenderingProgress = std::function<bool(const PictureSoFar& so_far)>;

class Renderer {
 public:
  // The avatar's numbers are copied to the device. Throws InputError for settings that go with no avatar or that this device
  // cannot follow, MemoryCeilingError where not even 64 rays at a time fit below the device's memory ceiling.
  Renderer(Device& device, const Avatar& avatar, const RenderSettings& settings);

  // What belongs to the pose or the code alone (the posed template, its grid of roots, baked distances) is kept for the next
  // picture. Asks progress between the chunks of rays, or of what is made once for a pose or a code; throws RenderingStopped where it says so.
  Picture render(const Camera& camera, const Pose& pose, std::size_t latent_row, const RenderingProgress& progress = {});
  // The same in parts, for those who share it out: whole(render_rows(computed(camera), ...), camera). computed: of the picture whose every
  // pixel is computed, smaller where pixel_step > 1. render_rows: of its rows begin ... end - 1, which do not depend on what part they are
  // in; the others are 0. whole: with the pixels between.
  Camera computed(const Camera& camera) const;
  Picture render_rows(const Camera& computed, const Pose& pose, std::size_t latent_row, int begin, int end, const RenderingProgress& progress = {});
  Picture whole(Picture rows, const Camera& camera) const;
  const PointRootFinder& root_finder() const { return samples_->root_finder(); }

  // Signed distances on a plane; each point's canonical one by the paper's search and distances from the network, whatever the settings
  // give up there. Throws InputError for an avatar that has no distances. progress: as render's.
  DistanceSlice slice(const SlicePlane& plane, int width, int height, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress = {});
  // SkinningWeights::at in the pose of the last picture or slice. Throws std::logic_error before the first.
  std::vector<float> skinning_weights(std::span<const glm::vec3> points);

  // The next picture is made as if its pose were new.
  void forget_pose() { frame_.reset(); }

  // Work of the pictures since the last reset.
  struct Work {
    uint64_t rays = 0;     // that can meet the person
    uint64_t samples = 0;  // placed on them: rays times samples
    uint64_t shaded = 0;   // colours evaluated for them
    double baking_seconds = 0;
  };
  const Work& work() const { return work_; }
  void reset_work() {
    work_ = {};
    samples_->root_finder().reset_counts();
  }

 private:
  bool bakes() const { return settings_.baked_distances || draws_mesh(); }
  bool draws_mesh() const { return asks_for_surface(sampling_.mode) && sampling_.surface == SurfaceSource::mesh; }
  bool searches_surface() const { return asks_for_surface(sampling_.mode) && sampling_.surface == SurfaceSource::search; }
  uint32_t planned_rays();
  FrameOnDevice& packed(const Pose& pose, std::size_t latent_row, const std::function<void()>& between);
  FrameOnDevice& posed(const Pose& pose, const std::function<void()>& between);
  void bake(FrameOnDevice& frame, std::size_t latent_row, const std::function<void()>& between);
  SurfaceHits find_surface(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, const std::function<void(double)>& progress);
  std::vector<uint32_t> pixels_to_render(FrameOnDevice& frame, const Camera& camera, int begin, int end, const SurfaceHits& seen);
  void render_chunk(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, const SurfaceHits& seen, Picture& picture);

  Device& device_;
  const Avatar& avatar_;
  RenderSettings settings_;
  SamplingSettings sampling_;
  uint32_t rays_;  // at a time
  AvatarNetworks networks_;
  TemplateOnDevice body_;
  std::optional<SurfaceFinder> surface_finder_;
  std::optional<RaySamples> samples_;
  std::optional<ShadedRays> shaded_;
  std::optional<FrameOnDevice> frame_;
  Pose pose_;                                // of that frame
  std::optional<BakedDistances> baked_;      // where the settings want distances or the mesh from it
  std::optional<std::size_t> baked_row_;     // of latent codes: the one that it stands for
  std::optional<SurfaceMesh> mesh_;          // of these distances
  Work work_;
  RayInspector inspector_;
  std::optional<SkinningWeights> weights_;  // made when they are first asked for
  Commands commands_;
};

}  // namespace arah
