// Animations of glTF files as motions.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/body/motion.h"

namespace arah {

inline constexpr std::size_t kMostGltfJoints = 256;

// The names of the file's animations, in order; "animation_N" for one without a name. Throws InputError for what is no glTF file.
std::vector<std::string> gltf_animation_names(const std::filesystem::path& path);

struct GltfMotion {
  Motion motion;                   // +Y up, metres, as glTF is
  std::string animation;           // its name
  std::vector<std::string> notes;  // what was left out, in sentences
};

// One animation, by name (the first one where `animation` is empty), sampled from its first key frame to its last at frames_per_second;
// 0: at the rate of its key frames where the channel with the most has them evenly spaced, else at 30. A rate within 0.05 % of a whole
// number is that number.
// The skeleton is the joints of the first skin that the animation turns, else the animated nodes and all below them; of several roots the one
// with the most joints. It rests as the nodes stand without the animation, in the world, whatever frames they have there: with W and P the
// rotations of a node in the world at rest and in a frame, the rotation of its joint from the rest is P W⁻¹. Nodes above the root count.
// Times before a channel's first key frame and after its last have that one's value. LINEAR rotations are spherical (the shorter way), CUBICSPLINE
// ones normalised. Scales, weights of morph targets and translations of joints other than the root are left out.
// Throws InputError naming file and channel: no animation, none of this name, none that turns a node, indices out of range, types that
// channels do not have, key frames without order, numbers that are not finite, rotations of length 0, mirrored nodes, more than
// kMostGltfJoints joints, more than 4 million joints' rotations in all (or four times the key frames' numbers).
GltfMotion read_gltf_motion(const std::filesystem::path& path, const std::string& animation = "", double frames_per_second = 0);

}  // namespace arah
