#include "viewer/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "host/body/pose_blend.h"
#include "host/evaluation/layers.h"
#include "host/input_error.h"

namespace arah {

Scene::Scene(std::shared_ptr<const Avatar> avatar, const MotionOptions& options) : avatar_(std::move(avatar)), options_(options), chosen_(chosen_motion(options, *avatar_)), shaped_(avatar_->body) {
  motion_.split = options.split;
  motion_.skeleton = avatar_->body.skeleton;
  motion_.frames = chosen_.frames;
  motion_.frames_per_second = chosen_.frames_per_second;
}

void Scene::set_avatar(std::shared_ptr<const Avatar> avatar) {
  if (avatar->body.skeleton.names != avatar_->body.skeleton.names) throw InputError("the new checkpoint", "", "the skeleton of the one before", "another one");
  *this = Scene(std::move(avatar), options_);
}

const std::vector<Camera>& Scene::cameras() const {
  static const std::vector<Camera> none;
  return chosen_.capture ? chosen_.capture->cameras : none;
}

const BodyTemplate& Scene::body_in(const std::vector<double>& shape) const {
  const std::vector<double>& wanted = shape.empty() ? avatar_->body.shape.beta : shape;
  if (shaped_.shape.beta != wanted) set_shape(shaped_, wanted);
  return shaped_;
}

Viewpoint Scene::front(const Pose& pose) const {
  Viewpoint viewpoint = viewpoint_around(posed_vertices(avatar_->body, pose), chosen_.up);
  // Where the body's front, +Z at rest, points now, seen from above; as it is at 0 where the person lies on it.
  const glm::dvec3 up = chosen_.up == UpAxis::y ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  const glm::dvec3 front = chosen_.up == UpAxis::y ? glm::dvec3(0, 0, 1) : glm::dvec3(0, -1, 0);
  const glm::dvec3 faces = rotation_from_axis_angle(pose.theta[0]) * glm::dvec3(0, 0, 1);
  const glm::dvec3 level = faces - glm::dot(faces, up) * up;
  if (glm::length(level) > 0.3) viewpoint.yaw = std::atan2(glm::dot(glm::cross(up, front), level), glm::dot(front, level));
  return viewpoint;
}

ViewState Scene::initial_state() const {
  ViewState state;
  state.split = chosen_.capture ? options_.split : "";
  state.joint = motion_.skeleton.names.front();
  state.viewpoint = front(motion_.frames.front().pose);
  return state;
}

ViewState Scene::fitting(ViewState state) const {
  const ViewState initial = initial_state();
  const std::vector<std::string>& names = motion_.skeleton.names;
  std::erase_if(state.turns, [&](const auto& turn) { return std::find(names.begin(), names.end(), turn.first) == names.end(); });
  if (!posable()) state.turns.clear(), state.shift = glm::dvec3(0), state.blend_frame.reset();
  if (std::find(names.begin(), names.end(), state.joint) == names.end()) state.joint = names.front();
  if (!state.shape.empty() && state.shape.size() != avatar_->body.shape.size()) state.shape.clear();
  if (state.latent_row && static_cast<size_t>(*state.latent_row) >= avatar_->latent_frames.size()) state.latent_row.reset();
  if (state.blend_frame && !find_frame(motion_, *state.blend_frame)) state.blend_frame.reset();
  if (std::none_of(cameras().begin(), cameras().end(), [&](const Camera& camera) { return camera.name == state.camera; })) state.camera.clear();
  state.timeline = scrubbed(state.timeline, motion_, state.timeline.place);
  if (state.viewpoint.up != initial.viewpoint.up) state.viewpoint = initial.viewpoint;
  const auto& layers = all_layers();
  if (std::none_of(layers.begin(), layers.end(), [&](PictureLayer layer) { return to_string(layer) == state.layer; })) state.layer = initial.layer;
  const std::vector<Quality> possible = qualities(*avatar_);
  if (std::find(possible.begin(), possible.end(), Quality{state.quality, 1}) == possible.end()) state.quality = initial.quality, state.knobs.clear();
  return state;
}

Pose Scene::base_pose(const ViewState& state) const {
  const Pose played = pose_at(state.timeline, motion_);
  const MotionFrame* other = state.blend_frame ? find_frame(motion_, *state.blend_frame) : nullptr;
  return other && state.blend_weight > 0 ? blended(played, other->pose, state.blend_weight) : played;
}

int Scene::frame_number(const ViewState& state) const { return motion_.frames[frame_at(state.timeline, motion_)].number; }

std::vector<glm::vec3> Scene::vertices(const ViewState& state, const Pose& pose) const { return posed_vertices(body_in(state.shape), pose); }

Camera Scene::camera(const ViewState& state, int width, int height) const {
  for (const Camera& camera : cameras()) {
    if (camera.name != state.camera) continue;
    const double fit = std::min({1.0, double(width) / camera.width, double(height) / camera.height});
    return camera.scaled(std::max(1, static_cast<int>(std::floor(fit * camera.width))));
  }
  return camera_at(state.viewpoint, width, height);
}

PictureOrder Scene::order(const ViewState& state, int width, int height) const {
  PictureOrder order;
  order.camera = camera(state, width, height);
  order.pose = pose(state);
  order.latent_row = state.latent_row ? static_cast<size_t>(*state.latent_row) : latent_row_of(chosen_, *avatar_, frame_number(state));
  order.shape = state.shape;
  order.finest = state.quality;
  order.knobs = state.knobs;
  order.compare_with_exact = state.compare_with_exact;
  order.layer = layer_named(state.layer);
  if (order.layer == PictureLayer::weights) order.joint = find_joint(motion_.skeleton, state.joint);
  if (order.layer == PictureLayer::slice) order.slice = state.slice;
  return order;
}

const Image* Scene::photograph(const ViewState& state, int width) {
  if (!chosen_.capture || state.camera.empty()) return nullptr;
  const std::pair<std::string, int> wanted{state.camera, frame_number(state)};
  if (photographs_of_ != wanted) photographs_.clear();
  photographs_of_ = wanted;
  if (const auto known = photographs_.find(width); known != photographs_.end()) return known->second ? &*known->second : nullptr;
  words_.clear();
  std::optional<Image>& photograph = photographs_[width];
  try {
    photograph = load_image(*chosen_.capture, options_.split, camera_index(*chosen_.capture, state.camera), frame_number(state), width);
  } catch (const InputError& error) {
    words_ = error.what();
  }
  return photograph ? &*photograph : nullptr;
}

}  // namespace arah
