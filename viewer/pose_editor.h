// Poses by hand: what is changed of a pose that a motion gives, undone and redone, mirrored, and dragged in the picture.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <vector>

#include "host/body/inverse_kinematics.h"
#include "host/capture/camera.h"

namespace arah {

// Changes that stay while the pose below them plays on. turns[j], axis-angle in the joint's own axes, comes before the pose's own rotation:
// R_j rot(turns[j]); none: the pose's. shift: of the root, metres.
struct PoseEdits {
  std::vector<glm::dvec3> turns;  // [J], or empty: nothing is changed
  glm::dvec3 shift{0.0};

  bool operator==(const PoseEdits&) const = default;
};

// The pose with the changes; where a joint has none, with its own numbers. Throws std::invalid_argument for another number of joints.
Pose edited(const Pose& base, const PoseEdits& edits);
// The changes that make `wanted` of `base`; joints whose numbers are the same have none. Turns are the nearest to those of `near`, of all that are 2π apart.
PoseEdits edits_between(const Pose& base, const Pose& wanted, const PoseEdits& near = {});

PoseEdits without_edit(const PoseEdits& edits, int joint);  // of the root: its shift too

// Angles for three sliders, radians: R = R_z(z) R_y(y) R_x(x), y in [−π/2, π/2], the others in [−π, π]. Where y is ±π/2, and x and z turn about
// one axis, x is 0.
glm::dvec3 slider_angles(const glm::dvec3& axis_angle);
glm::dvec3 axis_angle_of_sliders(const glm::dvec3& angles);

// The joint of the other side by the names ("left_wrist", "mixamorig:RightHand", "thigh.L"), the joint itself where it has none, [J].
std::vector<int> other_side(const Skeleton& skeleton);
// The pose with the joint's rotation, and those of all that hangs from it, mirrored on the other side; joints in the middle have no other and
// stay. Left and right are those that the skeleton rests along (rest_axes).
Pose copied_across(const Skeleton& skeleton, const Pose& pose, int joint);

// Edits with their history. A change that goes on, as while a hand drags, is one entry: show() it as often as it moves, keep() it at its end.
class EditHistory {
 public:
  static constexpr std::size_t kMost = 200;  // entries; older ones are forgotten

  const PoseEdits& shown() const { return shown_; }
  void show(const PoseEdits& edits) { shown_ = edits; }
  void keep();    // what is shown becomes an entry, where it differs from the last; what had been undone is gone
  void change(const PoseEdits& edits) { show(edits), keep(); }

  bool can_undo() const { return at_ > 0 || shown_ != entries_[at_]; }
  bool can_redo() const { return at_ + 1 < entries_.size() && shown_ == entries_[at_]; }
  void undo();  // what is shown and not kept first
  void redo();

 private:
  std::vector<PoseEdits> entries_{PoseEdits{}};
  std::size_t at_ = 0;
  PoseEdits shown_;
};

// The joint that is seen nearest to the cursor, within so many pixels; of those at the same place the nearest to the camera. Joints behind the camera, or nearer to it than
// kNearPlane, are not seen. All in pixels of the camera's picture.
inline constexpr double kNearPlane = 0.01;  // metres
std::optional<int> joint_under(const Camera& camera, std::span<const glm::dvec3> joints, glm::dvec2 cursor, double pixels = 12);

// A joint that is held: it follows the cursor at the depth that it was taken at, and does not jump to it.
struct HeldJoint {
  int joint = 0;
  double depth = 1;           // metres
  glm::dvec2 offset{0.0};     // pixels from the cursor to the joint
};
// Throws std::invalid_argument for a joint that is not seen.
HeldJoint taken(const Camera& camera, std::span<const glm::dvec3> joints, int joint, glm::dvec2 cursor);
// Where it is wanted, world.
glm::dvec3 wanted_place(const Camera& camera, const HeldJoint& held, glm::dvec2 cursor);
// The pose after that, by dragged().
Pose pulled(const Camera& camera, const Skeleton& skeleton, const Pose& pose, const HeldJoint& held, glm::dvec2 cursor, int most_turning = 2);

}  // namespace arah
