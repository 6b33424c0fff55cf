// Motions in the files of others, as motions of this project: metres (where the file says them), a world with +Z up.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/body/motion.h"
#include "host/body/retarget.h"

namespace arah {

struct MotionFile {
  Motion motion;                   // of the file's own skeleton
  std::string format;              // "BVH", "AMASS", …
  std::vector<std::string> notes;  // what of it was left out, in sentences
  RetargetSettings settings;       // how its rest is to be taken
};

// Whether the file's name ends as one of these motions' does: .bvh, .npz, .pkl. Not .glb and .gltf, which may be bodies.
bool is_foreign_motion(const std::filesystem::path& path);

// By the file's ending and content:
//   .json  the native layout, as it is
//   .bvh   read_bvh; the axis along which it stands at rest becomes +Z. Its unit is not known: a retarget scales by the legs
//   .npz   AMASS: poses [N][3 J] axis-angles, J = 24 (SMPL), 52 (SMPL-H) or 55 (SMPL-X), trans [N][3] metres, mocap_framerate (or
//          mocap_frame_rate); +Z up already
//   .pkl   AIST++: smpl_poses [N][72], smpl_trans [N][3] in units of 1 / smpl_scaling m (of 1 cm where that is missing), 60
//          frames a second; +Y up, becomes +Z (x, −z, y)
//   .glb, .gltf   read_gltf_motion; +Y up, becomes +Z. `animation` is its name, `frames_per_second` the rate it is sampled at; both mean
//          nothing to other files
// AMASS and AIST++ files hold no skeleton. Their joints are the 22 that SMPL's bodies share, fingers and hands at rest, at the
// places of SMPL's mean male body, to the millimetre; since the body of the file had another shape, a rig that rests within 10 degrees
// of it rests alike (ARAH.md §8). Throws InputError naming file and field: none of these, damaged, numbers that are not finite or
// beyond 1e6, counts that disagree, no frames, a rate that is none.
MotionFile read_motion_file(const std::filesystem::path& path, const std::string& animation = "", double frames_per_second = 0);

}  // namespace arah
