// What surface rendering learns its shape from: a colour is taken where the ray hits the surface, (x̂, d) the root of
// [f(x̂); LBS(x̂) − (c + d v − t)], and through this root its gradient reaches SDF and skinning network by implicit
// differentiation (paper, appendix "Implicit Gradients for Joint Root-finding").
#pragma once

#include "host/rendering/shaded_rays.h"
#include "host/training/skinning_gradient.h"

namespace arah {

class SurfaceGradient {
 public:
  // rows: shaded at a time. skinning: with a skinning network, room for its rows; else the blended transform of a point is its
  // Jacobian, for what moves it is the nearest vertex or nothing. counts: shared::ImplicitCounts, +=; singular are rays that graze
  // the surface so that they teach nothing.
  SurfaceGradient(Device& device, AvatarNetworks& networks, uint32_t rows, SkinningGradient* skinning, const BufferSlice& counts);

  // After the field's own way back with Field::Backward::position, at the same rows, one a ray: effective weight gradients of
  // the SDF (+=) and where wanted of the skinning network (=, or += with accumulate).
  void record(Commands& commands, FrameOnDevice& frame, RaySamples& placed, ShadedRays& shaded, uint32_t rays, bool skinning_weights, bool accumulate, const BufferSlice& scratch);

 private:
  AvatarNetworks& networks_;
  SkinningGradient* skinning_;
  BufferSlice counts_;
  Buffer cotangents_;
};

}  // namespace arah
