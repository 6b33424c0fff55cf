// Stratified samples over each ray's kept bins (kernels/reference/sampling.h, shell_samples). One invocation makes one
// sample, row = ray · samples + sample: writes its depth, its δ (the bins' length / samples) and its posed point.
// Samples of rays without bins, and the padding after the last row: depth 0, δ 0, point (0, 0, 0, 0).
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/random.glsl"
#include "shared/sampling.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { ShellSamplesConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer rays;  // two texels a Ray: origin and near, direction and far
layout(binding = 1, scalar) readonly buffer Kept { uvec2 kept[]; };
layout(binding = 2, scalar) writeonly buffer Depths { float depths[]; };
layout(binding = 3, scalar) writeonly buffer Deltas { float deltas[]; };
layout(binding = 4, scalar) writeonly buffer Points { vec4 points[]; };

// Position of the n-th set bit (from 0) of 64; n is below their number.
uint set_bit(uvec2 bits, uint n) {
  uint in_low = uint(bitCount(bits.x));
  bool high = n >= in_low;
  uint word = high ? bits.y : bits.x;
  uint position = high ? 32u : 0u;
  n -= high ? in_low : 0u;
  for (uint width = 16u; width > 0u; width >>= 1u) {
    uint below = uint(bitCount(word & ((1u << width) - 1u)));
    bool up = n >= below;
    n -= up ? below : 0u;
    word = up ? word >> width : word;
    position += up ? width : 0u;
  }
  return position;
}

void main() {
  uint row = gl_GlobalInvocationID.x;
  uint of_ray = min(row, c.rays * c.samples - 1u);
  uint ray_index = of_ray / c.samples;
  uint sample_index = of_ray - ray_index * c.samples;
  vec4 from = imageLoad(rays, 2 * int(ray_index));
  vec4 along = imageLoad(rays, 2 * int(ray_index) + 1);
  float near = from.w;
  float far = along.w;
  uvec2 bits = kept[ray_index];
  uint bins = uint(bitCount(bits.x) + bitCount(bits.y));
  bool valid = bins > 0u && near < far && row < c.rays * c.samples;

  float random = random_unit(c.seed, c.step_index, c.first_ray + ray_index, sample_index);
  float fraction = c.jitter != 0u ? random : 0.5;
  float position = (float(sample_index) + fraction) * float(bins) / float(c.samples);  // in bins along the union
  uint n = min(uint(position), max(bins, 1u) - 1u);
  float width = (far - near) * (1.0 / 64.0);
  float depth = near + (float(set_bit(bits, n)) + (position - float(n))) * width;
  vec3 posed = from.xyz + depth * along.xyz - c.root_translation;

  depths[row] = valid ? depth : 0.0;
  deltas[row] = valid ? width * float(bins) / float(c.samples) : 0.0;
  points[row] = valid ? vec4(posed, 1.0) : vec4(0.0);
}
