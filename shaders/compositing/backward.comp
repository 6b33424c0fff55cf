// The way back through alpha compositing (kernels/reference/compositing.h). One invocation walks one ray from far to
// near; without division by 1 − α, so that opaque rays have finite gradients:
//   dL/dα = T (g − A),   A ← g α + (1 − α + 1e-7) A,   g = dL/dw = dL/drgb · c + dL/dΣw (where the clip lets it pass).
// Writes (=) the gradients of sdf and colour, channels beyond theirs and padding rows as 0; leaves each workgroup's sum
// of dL/dparameter of b in `partials`. Where colours are by slot (shaders/compositing/forward.comp), so are the gradients;
// samples without a slot, black going forward, pass none on, but absorb and count for b as the others do.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/density.glsl"
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/compositing.h"
#include "shared/empty_sample.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint d_sdf_quads = 2;  // channels / 4 that are written
layout(constant_id = 1) const uint d_rgb_quads = 2;
layout(constant_id = 2) const uint shading = SHADING_BY_ROW;
layout(constant_id = 3) const uint density_kind = DENSITY_LAPLACE;

layout(push_constant, scalar) uniform Constants { CompositeBackwardConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer sdf;
layout(binding = 1, rgba32f) uniform readonly imageBuffer rgb;
layout(binding = 2, rgba32f) uniform readonly imageBuffer points;
layout(binding = 3, scalar) readonly buffer Deltas { float deltas[]; };
layout(binding = 4, scalar) readonly buffer Parameters { float parameters[]; };
layout(binding = 5, scalar) readonly buffer Transmittances { float transmittances[]; };
layout(binding = 6, scalar) readonly buffer Colors { vec4 colors[]; };
layout(binding = 7, scalar) readonly buffer DColors { vec4 d_colors[]; };
layout(binding = 8, scalar) writeonly buffer DSdf { vec4 d_sdf[]; };
layout(binding = 9, scalar) writeonly buffer DRgb { vec4 d_rgb[]; };
layout(binding = 10, scalar) writeonly buffer Partials { float partials[]; };
layout(binding = 11, scalar) readonly buffer Slots { uint slots[]; };

void main() {
  uint ray = gl_GlobalInvocationID.x;
  uint rays = c.forward.rays;
  bool real = ray < rays;
  uint of_ray = min(ray, rays - 1u);
  uint samples = c.forward.samples;
  uint sdf_stride = c.forward.sdf_stride / 4u;
  uint sdf_column = c.forward.sdf_column / 4u;
  uint rgb_stride = c.forward.rgb_stride / 4u;
  uint rgb_column = c.forward.rgb_column / 4u;
  uint d_sdf_stride = c.d_sdf_stride / 4u;
  uint d_sdf_column = c.d_sdf_column / 4u;
  uint d_rgb_stride = c.d_rgb_stride / 4u;
  uint d_rgb_column = c.d_rgb_column / 4u;
  uint rows = c.rows;
  float metres = c.forward.metres_per_unit;
  float parameter = parameters[c.forward.scale_index];
  float b = laplace_scale(parameter);
  vec4 upstream = d_colors[of_ray];
  float of_sum = colors[of_ray].w < 1.0 ? upstream.w : 0.0;

  float behind = 0.0;
  float d_b = 0.0;
  for (uint k = samples; k > 0u; --k) {
    uint read = of_ray * samples + k - 1u;
    float state = imageLoad(points, int(read)).w;
    bool valid = real && state != 0.0 && state != EMPTY;  // an empty one has nothing to teach, and takes 1e-7 of nothing away
    float delta = deltas[read];
    Density density = density_of(density_kind, metres * imageLoad(sdf, int(read * sdf_stride + sdf_column)).x, b);
    float optical_depth = density.value * delta;
    float passing = exp(-optical_depth);
    float alpha = -stable_expm1(-optical_depth);
    float transmittance = transmittances[read];
    uint row = shading == SHADING_BY_SLOT ? (real ? slots[read] : NO_SLOT) : ray * samples + k - 1u;
    uint colored = shading == SHADING_BY_SLOT ? (row == NO_SLOT ? 0u : row) : read;
    vec3 of_sample = imageLoad(rgb, int(colored * rgb_stride + rgb_column)).xyz;
    of_sample = row == NO_SLOT ? vec3(0.0) : of_sample;
    float of_weight = dot(upstream.xyz, of_sample) + of_sum;
    float of_density = transmittance * (of_weight - behind) * delta * passing;
    behind = valid ? of_weight * alpha + (passing + 1e-7) * behind : behind;
    d_b += valid ? of_density * density.d_b : 0.0;
    vec4 sdf_gradient = valid ? vec4(metres * of_density * density.d_sdf, 0.0, 0.0, 0.0) : vec4(0.0);
    vec4 rgb_gradient = valid ? vec4(alpha * transmittance * upstream.xyz, 0.0) : vec4(0.0);
    if (row < rows) {
      d_sdf[row * d_sdf_stride + d_sdf_column] = sdf_gradient;
      for (uint quad = 1u; quad < d_sdf_quads; ++quad) d_sdf[row * d_sdf_stride + d_sdf_column + quad] = vec4(0.0);
      d_rgb[row * d_rgb_stride + d_rgb_column] = rgb_gradient;
      for (uint quad = 1u; quad < d_rgb_quads; ++quad) d_rgb[row * d_rgb_stride + d_rgb_column + quad] = vec4(0.0);
    }
  }
  float sum = workgroup_sum(real ? d_b * laplace_scale_derivative(parameter) : 0.0);
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sum;
}
