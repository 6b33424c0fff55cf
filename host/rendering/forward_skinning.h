// Forward skinning of canonical points with its exact Jacobian, as searches of roots want it.
#pragma once

#include <array>

#include "host/rendering/avatar_networks.h"
#include "host/rendering/frame_on_device.h"
#include "kernels/tracing/rows.h"

namespace arah {

class ForwardSkinning {
 public:
  // Of an avatar with a skinning network. capacity: rows at a time, a multiple of 64. name: what the buffers are for, in plain words.
  ForwardSkinning(Device& device, AvatarNetworks& networks, uint32_t capacity, const std::string& name);

  // Of the rows' points among `at`, vec4 by point: posed(), and where the Jacobian is wanted transforms() and jacobians().
  void record(Commands& commands, FrameOnDevice& frame, const Rows& rows, const BufferSlice& at, bool jacobian);

  BufferSlice posed() { return posed_.slice(); }            // vec4 by row: x̄, posed space without the root translation
  BufferSlice transforms() { return transforms_.slice(); }  // three vec4 by row: Σ_b w_b B_b
  BufferSlice jacobians() { return jacobians_.slice(); }    // three vec4 by row: ∂x̄/∂x (kernels/skinning/jacobian.h)

 private:
  AvatarNetworks& networks_;
  DenseTape tape_;
  Buffer posed_, transforms_, jacobians_;
  std::array<Buffer, 3> gradients_;
};

}  // namespace arah
