// Rays through pixel centres, cut to a box. One invocation makes one ray: reads its pixel, writes one Ray.
// Rays that miss the box, and the padding after the last ray, get far = −1 < near = 0.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/ray.h"
#include "shared/rays.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint pixels_listed = 1;  // 0: a rectangle, row by row; binding 0 is not read

layout(push_constant, scalar) uniform Constants { GenerateConstants c; };
layout(binding = 0, scalar) readonly buffer Pixels { uint pixels[]; };  // column | row << 16
layout(binding = 1, scalar) writeonly buffer Rays { Ray rays[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint of_list = min(index, c.count - 1u);
  uvec2 pixel;
  if (pixels_listed != 0u) {
    uint word = pixels[of_list];
    pixel = uvec2(word & 0xffffu, word >> 16u);
  } else {
    pixel = c.corner + uvec2(of_list % c.width, of_list / c.width);
  }

  vec2 on_plane = (vec2(pixel) - vec2(c.cx, c.cy)) / vec2(c.fx, c.fy);
  vec3 toward = on_plane.x * c.rotation_rows[0] + on_plane.y * c.rotation_rows[1] + c.rotation_rows[2];
  vec3 direction = toward / sqrt(dot(toward, toward));

  // A ray parallel to a face has finite depths: components below 1e-12 in size count as ±1e-12 (the paper's code has 1e-5,
  // with which a ray between two faces leaves a box of a metre before it arrives there from 10 km).
  vec3 at_least = mix(vec3(1e-12), vec3(-1e-12), lessThan(direction, vec3(0.0)));
  vec3 divisor = mix(direction, at_least, lessThan(abs(direction), vec3(1e-12)));
  vec3 to_minimum = (c.box_minimum - c.origin) / divisor;
  vec3 to_maximum = (c.box_maximum - c.origin) / divisor;
  vec3 enter = min(to_minimum, to_maximum);
  vec3 leave = max(to_minimum, to_maximum);
  float near = max(max(0.0, enter.x), max(enter.y, enter.z));
  float far = min(leave.x, min(leave.y, leave.z));
  bool finite = !any(isnan(to_minimum + to_maximum)) && !any(isinf(to_minimum)) && !any(isinf(to_maximum));
  bool hit = finite && near < far && index < c.count;
  rays[index] = Ray(c.origin, hit ? near : 0.0, direction, hit ? far : -1.0);
}
