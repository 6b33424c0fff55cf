// Rigs of 1 to 64 joints, none of SMPL's shape: an avatar is fitted, trained and rendered on each.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "host/body/canonical.h"
#include "host/rendering/renderer.h"
#include "host/training/trainer.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

// The small capture with another rig in the same body.
Capture with_body(BodyTemplate body, const std::function<Pose(const Pose&)>& pose_of) {
  Capture capture = small_capture();
  body.shape = {};  // of the other rig's joints
  body.glb = body_template_glb(body);
  capture.body_template = read_body_template_bytes(body.glb, "rig");
  for (auto& [split, motion] : capture.motions) {
    motion.skeleton = capture.body_template.skeleton;
    for (MotionFrame& frame : motion.frames) frame.pose = pose_of(frame.pose);
  }
  return capture;
}

// A statue: the root moves all of it.
Capture one_joint() {
  BodyTemplate body = small_capture().body_template;
  body.skeleton = {{"statue"}, {-1}, {body.skeleton.rest_joints[0]}};
  for (size_t v = 0; v < body.vertices.size(); ++v) body.joints[v] = glm::u8vec4(0), body.weights[v] = {1, 0, 0, 0};
  return with_body(std::move(body), [](const Pose& pose) { return Pose{{pose.theta[0]}, pose.root_position}; });
}

// Joints that never turn are put halfway along the bones until there are 64, under names of their own, and take over the vertices
// that are moved by one joint alone and are nearer to them; so every posed vertex stays where it was.
Capture sixty_four_joints() {
  BodyTemplate body = small_capture().body_template;
  Skeleton& skeleton = body.skeleton;
  const size_t before = skeleton.size();
  for (size_t j = 0; j < before; ++j) skeleton.names[j] = "bone_" + std::to_string(j);
  for (size_t j = 0; skeleton.size() < kMaxJoints; ++j) {
    const size_t at = 1 + j % (before - 1), round = j / (before - 1);
    const glm::dvec3 middle = glm::mix(skeleton.rest_joints[static_cast<size_t>(skeleton.parents[at])], skeleton.rest_joints[at], 0.5 - 0.2 * double(round));
    skeleton.names.push_back("helper_" + std::to_string(j));
    skeleton.parents.push_back(skeleton.parents[at]);
    skeleton.rest_joints.push_back(middle);
  }
  for (size_t v = 0; v < body.vertices.size(); ++v) {
    if (body.weights[v].x < 1) continue;
    const glm::dvec3 place(body.vertices[v]);
    size_t nearest = body.joints[v].x;
    for (size_t j = before; j < skeleton.size(); ++j)
      if (skeleton.parents[j] == body.joints[v].x && glm::distance(skeleton.rest_joints[j], place) < glm::distance(skeleton.rest_joints[nearest], place)) nearest = j;
    body.joints[v].x = static_cast<uint8_t>(nearest);
  }
  return with_body(std::move(body), [&](const Pose& pose) {
    Pose more = pose;
    more.theta.resize(kMaxJoints, glm::dvec3(0));
    return more;
  });
}

class AnyRig : public DeviceTest {
 protected:
  void train_and_render(const Capture& capture, const AvatarSpec& spec) {
    const TrainingSettings settings = small_settings();
    Avatar avatar = make_avatar(spec, capture, 3);
    fit_template(device, avatar, settings);
    Trainer trainer(device, capture, avatar, settings);
    double first = 0, last = 0, found = 0;
    constexpr int steps = 24;
    for (int i = 0; i < steps; ++i) {
      const StepReport report = trainer.step(static_cast<uint64_t>(steps - i));
      ASSERT_TRUE(std::isfinite(report.total));
      if (i < 8) first += report.color / 8;
      if (i >= steps - 8) last += report.color / 8;
      found += report.converged / steps;
    }
    std::printf("  %zu joints: colour loss %.3f to %.3f, %.4f of the correspondences found\n", capture.body_template.skeleton.size(), first, last, found);
    EXPECT_LT(last, first);
    EXPECT_GT(found, 0.98);
    const Avatar trained = trainer.avatar();
    const Camera camera = capture.cameras[0].scaled(32);
    const Picture picture = Renderer(device, trained, render_preset(trained, "paper")).render(camera, capture.motions.at("train").frames[1].pose, 0);
    EXPECT_TRUE(std::all_of(picture.color.begin(), picture.color.end(), [](float c) { return std::isfinite(c); }));
    EXPECT_GT(std::count_if(picture.alpha.begin(), picture.alpha.end(), [](float a) { return a > 0.5f; }), 30);
  }
};

TEST_F(AnyRig, AStatueOfOneJoint) {
  const Capture capture = one_joint();
  const CanonicalPose canonical = make_canonical_pose(capture.body_template.skeleton);
  EXPECT_EQ(canonical.rest_to_canonical.at(0), glm::dmat4(1));
  train_and_render(capture, small_spec());
  // What a network would say of one bone is known: the choice of parts leaves it out.
  AvatarSpec still = small_spec();
  still.skinning = {Skinning::template_weights, 0, 0};
  train_and_render(capture, still);
}

TEST_F(AnyRig, SixtyFourJointsThatFollowThePose) {
  const Capture capture = sixty_four_joints();
  ASSERT_EQ(capture.body_template.skeleton.size(), kMaxJoints);
  // The same body as before, whatever its rig.
  const Pose pose = small_capture().motions.at("train").frames[2].pose;
  const std::vector<glm::vec3> before = posed_vertices(small_capture().body_template, pose), after = posed_vertices(capture.body_template, capture.motions.at("train").frames[2].pose);
  ASSERT_EQ(before.size(), after.size());
  float apart = 0;
  for (size_t v = 0; v < before.size(); ++v) apart = std::max(apart, glm::distance(before[v], after[v]));
  EXPECT_LT(apart, 1e-5f);
  // Legs by other names are left as they rest.
  for (const glm::dmat4& bone : make_canonical_pose(capture.body_template.skeleton).rest_to_canonical) EXPECT_EQ(bone, glm::dmat4(1));
  for (const PoseConditioning by : {PoseConditioning::low_rank, PoseConditioning::hypernetwork}) {
    AvatarSpec spec = small_spec();
    spec.sdf.pose = by;
    spec.sdf.pose_width = 8;
    spec.sdf.pose_hidden_layers = 1;
    train_and_render(capture, spec);
  }
}

}  // namespace
}  // namespace arah
