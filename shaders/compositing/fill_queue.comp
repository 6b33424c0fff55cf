// The queue of shaded samples after compaction: one invocation serves one slot, whose sample the list `samples` names. Writes
// the slot's canonical point, and the slot at the sample's row. Slots from `count` on, to the next multiple of 64, belong to
// no sample: they repeat the first row's point with w = 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict readonly buffer Samples { uint samples[]; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer canonical;  // by sample
layout(binding = 2, scalar) restrict writeonly buffer Queued { vec4 queued[]; };
layout(binding = 3, scalar) restrict writeonly buffer Slots { uint slots[]; };
layout(push_constant, scalar) uniform Constants { uint count; };

void main() {
  const uint slot = gl_GlobalInvocationID.x;
  const uint sample_row = slot < count ? samples[slot] : 0u;
  const vec4 point = imageLoad(canonical, int(sample_row));
  queued[slot] = slot < count ? point : vec4(point.xyz, 0.0);
  if (slot < count) slots[sample_row] = slot;
}
