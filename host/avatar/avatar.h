// An avatar: what is modelled, the body that it is about, and everything learned.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/avatar/avatar_spec.h"
#include "host/avatar/grid_extent.h"
#include "host/avatar/parameter_layout.h"
#include "host/avatar/refined_poses.h"
#include "host/body/body_template.h"
#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "host/capture/capture.h"
#include "host/version.h"

namespace arah {

struct Avatar {
  AvatarSpec spec;
  BodyTemplate body;        // body.glb is never empty: the avatar's file carries it
  // [J] rest → canonical; with Skinning::none the one pose, so that every B_b is the identity. Of the body in the shape that
  // training began with: refining the shape moves the joints that poses turn about, not the space that the fields live in.
  CanonicalPose canonical;
  CubeNormalization cube;          // of the template's canonical vertices
  std::vector<int> latent_frames;  // frame numbers, one row of `latent` each; empty where the spec has no latent size
  GridExtent grid;                 // no levels where the spec has no grid
  ParameterLayout layout;
  std::vector<float> parameters;  // [layout.floats]
  RefinedPoses refined;           // of training frames

  uint64_t seed = 0;               // of the initial parameters and of training
  uint64_t steps = 0;              // trained so far
  std::string version = kVersion;  // of the program that made or last trained it
  std::string settings = "{}";     // how it was trained, JSON

  // The tensor of one slot. Throw std::out_of_range where the avatar has none of this name.
  std::span<float> tensor(const std::string& name);
  std::span<const float> tensor(const std::string& name) const;
};

// b of the Laplace density, metres, within the bounds that shaders/lib/density.glsl sets.
double density_scale(const Avatar& avatar);

// Largest side of the canonical body, metres: beyond, lengths that are made for people mean nothing (a search ends at 1e-5 m, a
// shell is 5 cm thick and must not slip between the 64 places where rays look for it, a surface is fitted from centimetres away).
inline constexpr double kLeastExtent = 0.05, kLargestExtent = 5;
// Throws InputError naming `where`, the size found and the unit that its lengths seem to be in.
void check_extent(const CubeNormalization& cube, const std::string& where);

// An untrained avatar with initial_parameters(). latent_frames: distinct; kept only where the spec has a latent size.
// only_pose: the pose that becomes canonical with Skinning::none, ignored otherwise. A template without GLB bytes is
// passed through its GLB form once, as saving and loading would. Throws InputError for a spec that is not valid, a body
// without extent or of one beyond the bounds above, or a grid that is too large; std::invalid_argument for frames or a pose that are missing.
Avatar make_avatar(const AvatarSpec& spec, BodyTemplate body, std::vector<int> latent_frames, uint64_t seed,
                   const Pose* only_pose = nullptr);

// The same from a capture: its template, its training frames and the first one's pose.
Avatar make_avatar(const AvatarSpec& spec, const Capture& capture, uint64_t seed);

// The row of `latent` for a frame; the last one for a frame outside training (ARAH.md section 1). Throws
// std::out_of_range where the avatar has no codes.
std::size_t latent_row(const Avatar& avatar, int frame);

// What a pose-conditioned SDF reads of a pose: each joint's rotation, row by row, the root's as the identity; then the rest
// joints in the cube, which carry the body's shape (ARAH.md section 1, "Pose input θ"): [joints][9], [joints][3]. Empty where
// the SDF does not follow the pose. Throws std::invalid_argument for a pose of another number of joints.
std::vector<float> pose_input(const Avatar& avatar, const Pose& pose);

// Throws std::runtime_error naming the first tensor and element that is NaN or infinite.
void check_finite(const Avatar& avatar);

// What the avatar is, in lines of text: parts, sizes, learned numbers of each group and the largest of all.
std::string describe(const Avatar& avatar);

}  // namespace arah
