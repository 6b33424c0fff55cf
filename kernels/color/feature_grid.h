// Dense feature grids over an axis-aligned box, read by trilinear interpolation: an input of the colour network that
// holds detail which a small network cannot. Truth: kernels/reference/feature_grid.h.
#pragma once

#include <array>
#include <cstdint>

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// One to four resolutions side by side over the same box; each adds four channels. The first and last node of an axis
// lie on the faces of the box; outside, the value is that of the nearest point of the box; an axis with one node is
// constant.
struct FeatureGridShape {
  static constexpr uint32_t max_levels = 4;
  static constexpr uint32_t channels_a_level = 4;

  std::array<float, 3> lower{-1, -1, -1};  // the box, in the units of the points
  std::array<float, 3> upper{1, 1, 1};
  uint32_t levels = 0;
  std::array<std::array<uint32_t, 3>, max_levels> nodes{};  // along x, y, z

  uint32_t channels() const { return levels * channels_a_level; }
  uint64_t node_count() const;                                                // of all levels
  uint64_t feature_count() const { return node_count() * channels_a_level; }  // floats: [level][z][y][x][4]
};

struct FeatureGridForwardArgs {
  FeatureGridShape shape;
  uint32_t points = 0;
  BufferSlice positions;      // vec4 [padded points], units of the box; w unused. A NaN gives NaN features.
  BufferSlice features;       // float [feature_count()]
  Matrix rows;                // [points][…]: only the shape's own columns are written
  uint32_t first_column = 0;  // of the features, relative to rows.column; need not be a multiple of anything
};
// This and the functions below throw std::invalid_argument where the shape has no level, more than four, an empty level
// or box, more nodes than fit a signed 32-bit index of floats, or where the columns do not fit the row.
void record_feature_grid_forward(Commands& commands, const FeatureGridForwardArgs& args);

enum class PositionGradient { none, assign, add };

// Sums are kept in 32-bit fixed point, whose addition gives the same bits in any order. With
//   limit = min(floor((2^31 − 1) / max_contributions), 2^24)
// a contribution is clamp(dL/dy · scale, ±limit) · weight, rounded to an integer: no sum of max_contributions points
// wraps, gradients up to limit / scale a point are kept, and each contribution is off by at most 0.5 / scale. A loss
// that is a mean over R rays makes gradients of about 1 / R; scale = R · 2^12 suits 65,536 points (limit 32,767).
struct FeatureGridBackwardArgs {
  FeatureGridShape shape;
  uint32_t points = 0;             // exactly these contribute; padding rows do not
  uint32_t max_contributions = 0;  // points of all launches since the sums were zero
  float scale = 0;                 // > 0, finite; the same in all launches since the sums were zero
  BufferSlice positions;           // vec4 [padded points]
  BufferSlice features;            // float [feature_count()]
  Matrix d_rows;                   // [points][…]
  uint32_t first_column = 0;       // as in the forward pass
  BufferSlice sums;                // int32 [feature_count()], zero before the first launch; +=
  BufferSlice clamped;  // one uint32, +=: levels of points with a gradient above limit / scale, or a NaN (which adds 0)
  PositionGradient position_gradient = PositionGradient::none;
  BufferSlice d_position;     // vec4 [padded points]: position_factor · dL/dposition; may be empty for `none`
  float position_factor = 1;  // 1 / cube_scale turns a gradient per metre into one per cube unit
};
void record_feature_grid_backward(Commands& commands, const FeatureGridBackwardArgs& args);

}  // namespace arah
