// Alpha compositing (ARAH.md section 6; kernels/reference/compositing.h). One invocation walks one ray from near to far:
//   α = 1 − exp(−σδ),   w = α T,   T ← T (1 − α + 1e-7),   colour = Σ w c on black.
// Reads the samples' sdf, colour, depth, δ and validity; writes per ray (rgb, Σw clipped to 1) and Σ w z, per sample
// w and T (before the sample; the way back needs it). Invalid samples neither absorb nor count.
// Where δ are differences of depths, a first walk from far to near writes them: to the next valid sample, `last_delta`
// for the last one.
// Colours (the constant `shading`): one a row; or one a slot of the queue of shaded samples, black for those that are not
// in it; or one a slot for a group of samples, from the one that is in the queue to the next that is; or none yet: then the samples whose weight exceeds `least_weight` are
// flagged, to make that queue.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/density.glsl"
#include "lib/stable.glsl"
#include "shared/compositing.h"
#include "shared/empty_sample.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint deltas_are_differences = 0;
layout(constant_id = 1) const uint shading = SHADING_BY_ROW;
layout(constant_id = 2) const uint density_kind = DENSITY_LAPLACE;

layout(push_constant, scalar) uniform Constants { CompositeConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer sdf;
layout(binding = 1, rgba32f) uniform readonly imageBuffer rgb;
layout(binding = 2, rgba32f) uniform readonly imageBuffer points;  // w = 0: invalid; EMPTY: no density
layout(binding = 3, scalar) readonly buffer Depths { float depths[]; };
layout(binding = 4, scalar) buffer Deltas { float deltas[]; };
layout(binding = 5, scalar) readonly buffer Parameters { float parameters[]; };
layout(binding = 6, scalar) writeonly buffer Colors { vec4 colors[]; };
layout(binding = 7, scalar) writeonly buffer RayDepths { float ray_depths[]; };
layout(binding = 8, scalar) writeonly buffer Weights { float weights[]; };
layout(binding = 9, scalar) writeonly buffer Transmittances { float transmittances[]; };
layout(binding = 10, scalar) readonly buffer Slots { uint slots[]; };     // by row; NO_SLOT: not shaded
layout(binding = 11, scalar) writeonly buffer Flags { uint flags[]; };  // by row

void main() {
  uint ray = gl_GlobalInvocationID.x;
  bool real = ray < c.rays;
  uint samples = c.samples;
  uint first = min(ray, c.rays - 1u) * samples;
  uint sdf_stride = c.sdf_stride / 4u;
  uint sdf_column = c.sdf_column / 4u;
  uint rgb_stride = c.rgb_stride / 4u;
  uint rgb_column = c.rgb_column / 4u;
  float metres = c.metres_per_unit;
  float least_weight = c.least_weight;
  float b = laplace_scale(parameters[c.scale_index]);

  if (deltas_are_differences != 0u) {
    float last_delta = c.last_delta;
    bool is_last = true;
    float next = 0.0;
    for (uint k = samples; k > 0u; --k) {
      uint row = first + k - 1u;
      bool valid = imageLoad(points, int(row)).w != 0.0;
      float depth = depths[row];
      float delta = is_last ? last_delta : next - depth;
      if (real) deltas[row] = valid ? delta : 0.0;
      next = valid ? depth : next;
      is_last = is_last && !valid;
    }
  }

  float transmittance = 1.0;
  vec4 color = vec4(0.0);
  float ray_depth = 0.0;
  uint of_group = NO_SLOT;
  for (uint k = 0u; k < samples; ++k) {
    uint row = first + k;
    float state = imageLoad(points, int(row)).w;
    bool valid = state != 0.0;
    float value = metres * imageLoad(sdf, int(row * sdf_stride + sdf_column)).x;
    float optical_depth = state == EMPTY ? 0.0 : density_of(density_kind, value, b).value * deltas[row];
    float alpha = valid ? -stable_expm1(-optical_depth) : 0.0;
    float through = valid ? exp(-optical_depth) + 1e-7 : 1.0;
    float weight = alpha * transmittance;
    vec3 of_sample = vec3(0.0);
    if (shading == SHADING_BY_ROW) of_sample = imageLoad(rgb, int(row * rgb_stride + rgb_column)).xyz;
    if (shading == SHADING_BY_SLOT || shading == SHADING_BY_GROUP) {
      uint slot = slots[row];
      of_group = slot == NO_SLOT ? of_group : slot;
      slot = shading == SHADING_BY_GROUP ? of_group : slot;
      vec3 shaded = imageLoad(rgb, int((slot == NO_SLOT ? 0u : slot) * rgb_stride + rgb_column)).xyz;
      of_sample = slot == NO_SLOT ? vec3(0.0) : shaded;
    }
    color += valid ? weight * vec4(of_sample, 1.0) : vec4(0.0);
    ray_depth += valid ? weight * depths[row] : 0.0;
    if (real) {
      weights[row] = weight;
      transmittances[row] = transmittance;
      if (shading == SHADING_SELECTS) flags[row] = weight > least_weight ? 1u : 0u;
    }
    transmittance *= through;
  }
  colors[ray] = real ? vec4(color.xyz, clamped(color.w, 0.0, 1.0)) : vec4(0.0);
  ray_depths[ray] = real ? ray_depth : 0.0;
}
