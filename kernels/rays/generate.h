// Rays through the centres of pixels, cut to an axis-aligned box (ARAH.md section 4).
#pragma once

#include <array>
#include <cstdint>

#include "kernels/vulkan/commands.h"

namespace arah {

// A pinhole camera without distortion; integer pixel coordinates are pixel centres.
struct RayCamera {
  std::array<float, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  // world → camera, row-major
  std::array<float, 3> origin{};                             // camera centre, world metres
  float fx = 1, fy = 1, cx = 0, cy = 0;                      // pixels
};

struct RayBox {
  std::array<float, 3> minimum{}, maximum{};  // world metres
};

struct PixelRectangle {
  uint32_t left = 0, top = 0;  // first pixel
  uint32_t width = 1;          // pixels in a row; the rows follow each other
};

struct GenerateRaysArgs {
  RayCamera camera;
  RayBox box;
  uint32_t count = 0;  // rays
  // [count] uint32, column | row << 16; empty: the pixels of `rectangle`, row by row.
  BufferSlice pixels;
  PixelRectangle rectangle;
  // out: [padded_points(count)] Ray (shaders/shared/ray.h), unit directions, 0 <= near < far in metres. A ray that
  // misses the box (slab test of reference::intersect_box) has near 0, far −1, and so has the padding.
  BufferSlice rays;
};

// Throws std::invalid_argument where a slice is too short or a rectangle has no width.
void record_generate_rays(Commands& commands, const GenerateRaysArgs& args);

}  // namespace arah
