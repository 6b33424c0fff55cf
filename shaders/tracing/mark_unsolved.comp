// Which wanted points (target.w > 0) have no root: one invocation serves one point.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer targets;
layout(binding = 1, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 2, scalar) restrict writeonly buffer Flags { uint flags[]; };

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  flags[point] = imageLoad(targets, point).w > 0.0 && imageLoad(canonical, point).w == 0.0 ? 1u : 0u;
}
