// Where no network skins, the points that sphere tracing visits are exact correspondences, so that its end is the surface
// point. One invocation serves one ray: the last canonical point with w = 1 and its depth where the sdf came within the
// tolerance, zeros elsewhere and in the padding.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "lib/finite.glsl"
#include "lib/trace_status.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer traces;  // depth, sdf, evaluations, status
layout(binding = 1, rgba32f) uniform readonly imageBuffer ends;
layout(binding = 2, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };
layout(binding = 3, scalar) restrict writeonly buffer Depths { float depths[]; };
layout(push_constant) uniform Constants { uint count; float tolerance; };  // rays; metres

void main() {
  const int ray = int(gl_GlobalInvocationID.x);
  const vec4 trace = imageLoad(traces, ray);
  const vec3 end = imageLoad(ends, ray).xyz;
  const bool hit = uint(ray) < count && trace.w != DIVERGED && abs(trace.y) <= tolerance && trace.z > 0.0 && is_finite(end);
  canonical[ray] = hit ? vec4(end, 1.0) : vec4(0.0);
  depths[ray] = hit ? trace.x : 0.0;
}
