// Motion capture in BVH files (Biovision's HIERARCHY and MOTION).
#pragma once

#include <filesystem>

#include "host/body/motion.h"

namespace arah {

inline constexpr std::size_t kMostBvhJoints = 256;

// The motion on the file's own skeleton, which may have more joints than a rig (kMostBvhJoints); frames are numbered from 0.
// Rest joints are sums of OFFSETs, times `metres_per_unit` (0.01 for centimetres), in the file's own axes; rest frames are
// world-aligned, so a joint's rotation is that of its channels, R = R_first R_second R_third in the order in which the file
// lists them, degrees. Position channels replace the OFFSET, as in Blender; those of joints below the root are ignored, but
// for a root that carries nothing else than a joint with such channels ("Reference" above "Hips"): the two become one joint,
// with the child's name. End Sites are ignored. A rate within 0.05 % of a whole number is that number: Frame Time is rounded.
// Throws InputError naming file and line: truncated, another keyword than the format has there, channels unknown or twice, joints
// nested deeper than 64, more than kMostBvhJoints, two of one name, numbers missing, left over, not finite or beyond 1e9, no frames.
Motion read_bvh(const std::filesystem::path& path, double metres_per_unit = 1.0);

}  // namespace arah
