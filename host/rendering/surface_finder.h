// Where rays meet the posed surface: sphere tracing, then the joint search for canonical point and depth (paper, section
// "Joint Root-Finding"; ARAH.md §§4, 5). Loops that depend on how many rays are still searching are decided here, between
// submissions.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "host/rendering/avatar_networks.h"
#include "host/rendering/forward_skinning.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/root_finder.h"
#include "kernels/tracing/broyden_state.h"
#include "kernels/tracing/sphere_step.h"

namespace arah {

// Where rays hit the surface.
struct SurfaceHits {
  std::vector<std::array<float, 4>> points;  // by ray: canonical, metres, w = 1; zeros where there is nothing
  std::vector<float> depths;                 // metres along the ray
};

// What became of the rays since the last reset.
struct SurfaceFindingCounts {
  uint64_t rays = 0;     // that the joint search started from
  uint64_t steps = 0;    // of the joint search
  uint64_t hits = 0;     // converged within the ray's part in the box
};

class SurfaceFinder {
 public:
  // capacity: rays at a time.
  SurfaceFinder(Device& device, AvatarNetworks& networks, uint32_t capacity);

  // Which rays the joint search tries: in training all that meet the box, because a ray that sphere tracing led astray may
  // be rescued; in pictures only those that sphere tracing did not see leave the box.
  enum class Candidates { in_box, not_diverged };

  // ray_list: Ray by ray (near ≥ far: skipped). kept: uvec2 by ray, or empty: SphereTracing::kept. Afterwards surface_points() and surface_depths() hold the answer.
  // Records into commands and submits: on return all but the last launches are done, and these are recorded.
  // Without a skinning network the traced points are exact correspondences: the end of sphere tracing is the answer.
  void find(Commands& commands, FrameOnDevice& frame, uint32_t rays, const BufferSlice& ray_list, const BufferSlice& kept, Candidates candidates, const RootFindingSettings& settings);

  uint32_t capacity() const { return capacity_; }
  BufferSlice surface_points() { return canonical_.slice(); }  // vec4 by ray: canonical metres, w = 1 where the surface is hit
  BufferSlice surface_depths() { return depths_.slice(); }     // float by ray: metres, where it is hit

  SurfaceFindingCounts counts() const { return counts_; }
  void reset_counts() { counts_ = {}; }

 private:
  struct Queue {
    Buffer ids, count;
  };
  Rows rows_of(uint32_t rays, Queue& queue) const;
  uint32_t length(Queue& queue);
  void record_compaction(Commands& commands, const Rows& rows, Buffer& flags, Queue& to);
  void trace(Commands& commands, FrameOnDevice& frame, uint32_t rays, const SphereTracing& tracing, float tolerance);
  void record_sdf(Commands& commands, FrameOnDevice& frame, const Rows& rows, const BufferSlice& at, bool gradient);
  void search(Commands& commands, FrameOnDevice& frame, uint32_t rays, const BufferSlice& ray_list, Queue& start, const RootFindingSettings& settings);

  Device& device_;
  AvatarNetworks& networks_;
  uint32_t capacity_;
  SurfaceFindingCounts counts_;
  std::optional<SirenTape> sdf_tape_;
  std::optional<ForwardSkinning> skinning_;  // of the joint search
  BroydenState state_;
  Queue queues_[2], in_box_;
  Buffer trace_, posed_, candidates_, active_, scratch_, starts_, nearest_, canonical_, depths_;
  Buffer state_buffer_, search_counts_;  // of the joint search
};

}  // namespace arah
