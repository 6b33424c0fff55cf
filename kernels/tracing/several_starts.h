// Searches from several starts: those that the nearest bones give, and which of the roots is kept.
#pragma once

#include "kernels/tracing/rows.h"

namespace arah {

// x = B_j⁻¹ q for the bone j that is the rank-th nearest (from 0) to each row's point q (reference::bone_start).
struct BoneStartsArgs {
  Rows rows;
  BufferSlice frame;     // FrameConstants
  BufferSlice posed;     // vec4 by point: q, posed space without the root translation, metres
  BufferSlice segments;  // two vec4 a bone: its ends in canonical space, metres
  uint32_t bones = 0;
  uint32_t rank = 0;   // with fewer bones the farthest one's start
  BufferSlice starts;  // out, vec4 by point: x, metres
};
void record_bone_starts(Commands& commands, const BoneStartsArgs& args);

// Keeps the root with the least signed distance: the rows' points have a root in `found`.
struct KeepRootArgs {
  Rows rows;
  bool first = false;    // `found` is `kept`: the distances alone are noted
  Matrix sdf;            // by row, in its first channel: at the rows' roots
  BufferSlice found;     // vec4 by point
  BufferSlice kept;      // vec4 by point, read and written; w > 0: has a root
  BufferSlice kept_sdf;  // float by point, read and written
};
void record_keep_root(Commands& commands, const KeepRootArgs& args);

}  // namespace arah
