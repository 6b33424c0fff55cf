// What Broyden's search leaves without a root is searched again, by damped Newton with the exact Jacobian and from other starts
// (kernels/reference/damped_newton.h). The paper drops such samples.
#pragma once

#include "host/rendering/forward_skinning.h"

namespace arah {

struct RescueCounts {
  uint64_t searched = 0;                // points without a root
  uint64_t newton = 0, restarted = 0;   // found from the best iterate so far, and from a bone's start
  uint64_t evaluations = 0;             // of the skinning network's value and Jacobian
};

class RootRescue {
 public:
  // capacity: of the searches whose points come here.
  RootRescue(Device& device, AvatarNetworks& networks, uint32_t capacity);

  // steps: damped Newton steps from each start; bone_starts: after the best iterate so far, what the nearest so many bones alone would make of
  // the point. targets, canonical: of PointRootFinder::solve, after its search. Submits.
  void solve(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, uint32_t steps, uint32_t bone_starts, float tolerance);

  RescueCounts counts;

 private:
  Device& device_;
  AvatarNetworks& networks_;
  ForwardSkinning skinning_;
  Buffer unsolved_, ids_, count_, scratch_, starts_, bone_segments_, state_, trials_, search_counts_;
};

}  // namespace arah
