// The device's memory of a root search by Broyden's method (kernels/reference/broyden.h; ARAH.md section 5).
// The host's loop: LBS (and for the joint search sdf, its gradient and the Jacobian) at the starts,
// record_broyden_start; then, at most 50 times, LBS (and sdf) at iterates() of the active rows, record_broyden_step,
// record_compact of `active`; at the end record_broyden_finish.
#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/linear/matrix.h"

namespace arah {

enum class Unknowns : uint32_t {
  point = 3,            // x with LBS(x) = a posed point
  point_and_depth = 4,  // (x, d) with f(x) = 0 and LBS(x) = c + d v − t
};

// Planes of one vec4 a point (shaders/lib/broyden.glsl), then three vec4 a point with the blended transforms.
struct BroydenState {
  BufferSlice slice;      // bytes(capacity, unknowns, keeps_transforms)
  uint32_t capacity = 0;  // points; a multiple of 64
  Unknowns unknowns = Unknowns::point;
  bool keeps_transforms = false;

  static uint32_t planes(Unknowns unknowns) { return 5 + static_cast<uint32_t>(unknowns); }
  static uint64_t bytes(uint32_t capacity, Unknowns unknowns, bool keeps_transforms) {
    return uint64_t(capacity) * 16 * (planes(unknowns) + (keeps_transforms ? 3 : 0));
  }
  // vec4 by point: the iterate whose residual record_broyden_step expects; w: its depth.
  BufferSlice iterates() const { return plane(0); }
  // vec4 by point: smallest |g| (metres), steps taken, status (0 never started, 1 active, 2 converged, 3 diverged,
  // 4 out of iterations), 0.
  BufferSlice status() const { return plane(4); }
  // Three vec4 by point, with keeps_transforms: Σ_b w_b B_b at the best iterate.
  BufferSlice transforms() const {
    return slice.sub(uint64_t(planes(unknowns)) * capacity * 16, uint64_t(capacity) * 48);
  }

 private:
  BufferSlice plane(uint32_t number) const {
    return slice.sub(uint64_t(number) * capacity * 16, uint64_t(capacity) * 16);
  }
};

// What the joint search reads besides: the rays, and the sdf at the rows' points.
struct RaySurface {
  BufferSlice rays;  // Ray by point (= by ray)
  Matrix sdf;        // by row, channel 0: f, cube units
};

}  // namespace arah
