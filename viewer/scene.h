// A person and what can be played, and what a state of the viewer makes of them.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/cli/motion_options.h"
#include "viewer/picture_worker.h"
#include "viewer/view_state.h"

namespace arah {

class Scene {
 public:
  // Throws as chosen_motion() does.
  Scene(std::shared_ptr<const Avatar> avatar, const MotionOptions& options);

  // A newer checkpoint of the same person. Throws InputError where its skeleton is another one.
  void set_avatar(std::shared_ptr<const Avatar> avatar);

  const Avatar& avatar() const { return *avatar_; }
  const std::shared_ptr<const Avatar>& shared_avatar() const { return avatar_; }
  const Motion& motion() const { return motion_; }  // at least one frame, joints in the avatar's order
  const std::vector<Camera>& cameras() const;       // of the capture; none without one
  bool posable() const { return avatar_->spec.skinning.kind != Skinning::none; }
  double seconds_of(const ViewState& state) const { return time_of(state.timeline, motion_); }

  // In front of the person in the motion's first pose.
  ViewState initial_state() const;
  Viewpoint front(const Pose& pose) const;
  // What of a state does not fit this scene becomes what the initial state has: joints, shapes, cameras, frames that are not there.
  ViewState fitting(ViewState state) const;

  // Of the timeline, blended with the other frame, without edits; and with them.
  Pose base_pose(const ViewState& state) const;
  Pose pose(const ViewState& state) const { return edited(base_pose(state), edits_of(state, motion_.skeleton, "the view")); }
  int frame_number(const ViewState& state) const;
  const Skeleton& skeleton(const ViewState& state) const { return body_in(state.shape).skeleton; }  // in the shape of the state
  std::vector<glm::vec3> vertices(const ViewState& state, const Pose& pose) const;  // of the template, world

  // Of a picture that fits so many pixels: the viewpoint's fills them; a capture's camera keeps its shape and is not enlarged.
  Camera camera(const ViewState& state, int width, int height) const;
  PictureOrder order(const ViewState& state, int width, int height) const;
  // Of the capture's camera and frame, so wide; null where there is none. Kept while camera and frame stay. Reading a file that is
  // not good is said in words().
  const Image* photograph(const ViewState& state, int width);
  const std::string& words() const { return words_; }

 private:
  std::shared_ptr<const Avatar> avatar_;
  MotionOptions options_;
  ChosenMotion chosen_;
  Motion motion_;
  mutable BodyTemplate shaped_;  // the body in the shape that was asked for last
  std::pair<std::string, int> photographs_of_;           // camera and frame
  std::map<int, std::optional<Image>> photographs_;      // of these, by width
  std::string words_;
  const BodyTemplate& body_in(const std::vector<double>& shape) const;
};

}  // namespace arah
