// Refinement of poses in training: disturbed poses come closer to the truth, exact ones stay, a resumed run goes on bit for
// bit, and the avatar carries what was found.
#include "host/training/pose_refinement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <glm/geometric.hpp>
#include <numbers>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/training/trainer.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

constexpr double degree = std::numbers::pi / 180;

class PoseRefinementTest : public DeviceTest {
 protected:
  static TrainingSettings refining() {
    TrainingSettings settings = small_settings();
    settings.pose_refinement = true;
    settings.poses = {.rate = 2e-3};
    settings.end_fraction = 0.1;
    return settings;
  }
  static const Motion& truth() { return motion_of(small_capture(), "train"); }
  static PoseImprovement improvement(Trainer& trainer) { 
    const Avatar avatar = trainer.avatar();
    return pose_improvement(avatar.refined, avatar.body, small_capture().body_template.skeleton, truth());
  }
};

TEST(DisturbedPose, IsAsFarAsItSaysAndTheSameAgain) {
  const Skeleton& skeleton = small_capture().body_template.skeleton;
  const Pose& pose = motion_of(small_capture(), "train").frames[1].pose;
  double squares = 0, root_squares = 0;
  constexpr int count = 400;
  for (int frame = 0; frame < count; ++frame) {
    const Pose other = disturbed_pose(pose, 3, 0.01, 7, frame);
    EXPECT_EQ(other, disturbed_pose(pose, 3, 0.01, 7, frame));
    for (size_t j = 0; j < skeleton.size(); ++j)
      squares += std::pow(glm::length(axis_angle_from_rotation(rotation_from_axis_angle(other.theta[j]) * glm::transpose(rotation_from_axis_angle(pose.theta[j])))), 2) / double(count * skeleton.size());
    root_squares += glm::dot(other.root_position - pose.root_position, other.root_position - pose.root_position) / (3 * count);
  }
  EXPECT_NEAR(std::sqrt(squares) / degree, 3, 0.15);
  EXPECT_NEAR(std::sqrt(root_squares), 0.01, 0.001);
  EXPECT_NE(disturbed_pose(pose, 3, 0.01, 7, 0), disturbed_pose(pose, 3, 0.01, 8, 0));
}

// Adam's first step is the rate, against the gradient's sign; numbers of the frame alone move.
TEST(PoseRefinementStep, MovesOneFrameAgainstItsGradient) {
  const Avatar avatar = make_avatar(small_spec(), small_capture(), 3);
  std::vector<Pose> starts;
  for (const MotionFrame& frame : motion_of(small_capture(), "train").frames) starts.push_back(frame.pose);
  PoseRefinement refinement(avatar, starts);
  std::vector<float> bones(12 * avatar.body.skeleton.size(), 0.0f);
  for (size_t b = 0; b < avatar.body.skeleton.size(); ++b) bones[12 * b + 3] = 1, bones[12 * b + 11] = -2;  // shift along x and z alone
  refinement.step(2, {bones, {}}, {.rate = 1e-3}, 0.5);
  for (size_t frame = 0; frame < starts.size(); ++frame) {
    if (frame == 2) continue;
    EXPECT_EQ(refinement.pose(frame), starts[frame]);
  }
  const glm::dvec3 moved = refinement.pose(2).root_position - starts[2].root_position;
  EXPECT_NEAR(moved.x, -5e-4, 1e-9);
  EXPECT_NEAR(moved.y, 0, 1e-12);
  EXPECT_NEAR(moved.z, 5e-4, 1e-9);
  const Pose before = refinement.pose(2);
  bones[0] = std::nanf("");
  EXPECT_THROW(refinement.step(2, {bones, {}}, {.rate = 1e-3}, 0.5), std::runtime_error);
  EXPECT_EQ(refinement.pose(2), before);
}

// What an SDF that follows the pose says of it: the first step goes against the slope of Σ gradient · pose_input, by differences.
TEST(PoseRefinementStep, FollowsWhatThePoseConditionedSdfReads) {
  AvatarSpec spec = small_spec();
  spec.sdf.pose = PoseConditioning::low_rank;
  spec.sdf.pose_width = 8;
  spec.sdf.pose_hidden_layers = 1;
  const Avatar avatar = make_avatar(spec, small_capture(), 3);
  const Pose start = motion_of(small_capture(), "train").frames[0].pose;
  const size_t joints = avatar.body.skeleton.size();
  std::mt19937_64 generator(4);
  std::uniform_real_distribution<float> uniform(-1, 1);
  std::vector<float> input(12 * joints);
  for (float& value : input) value = uniform(generator);
  PoseRefinement refinement(avatar, {start});
  refinement.step(0, {std::vector<float>(12 * joints, 0.0f), input}, {.rate = 1e-3}, 1);
  const Pose moved = refinement.pose(0);
  EXPECT_EQ(moved.theta[0], start.theta[0]) << "the SDF does not read the root";
  EXPECT_EQ(moved.root_position, start.root_position);
  const auto value = [&](const Pose& pose) {
    double sum = 0;
    const std::vector<float> read = pose_input(avatar, pose);
    for (size_t i = 0; i < read.size(); ++i) sum += double(input[i]) * read[i];
    return sum;
  };
  for (size_t j = 1; j < joints; ++j)
    for (int axis = 0; axis < 3; ++axis) {
      Pose more = start, less = start;
      more.theta[j][axis] += 1e-2, less.theta[j][axis] -= 1e-2;
      const double slope = (value(more) - value(less)) / 2e-2;
      if (std::abs(slope) > 0.02) {
        EXPECT_NEAR(moved.theta[j][axis] - start.theta[j][axis], slope > 0 ? -1e-3 : 1e-3, 1e-6) << j << ", " << axis;
      }
    }
}

TEST_F(PoseRefinementTest, ContinuesBitForBitAndTheAvatarCarriesThePoses) {
  const Avatar start = well_fitted_avatar(device, small_spec());
  TrainingSettings settings = refining();
  settings.sampling.root.correspondence = Correspondence::search_from_grid;
  settings.ray_importance = 0.5;
  settings.grid_steps = 8;
  settings.shell_drift = 1e-3;  // so that shells follow within these steps
  settings.disturb_degrees = 3, settings.disturb_metres = 0.01;
  const auto make = [&] { return Trainer(device, small_capture(), start, settings); };
  const auto train = [](Trainer& trainer, uint64_t until) {
    while (trainer.steps_done() < until) trainer.step(20 - trainer.steps_done());
  };
  Trainer whole = make();
  train(whole, 20);
  const std::filesystem::path path = small_capture().path / "refined.safetensors";
  Trainer first = make();
  train(first, 11);
  write_safetensors(path, first.checkpoint());
  EXPECT_NE(first.checkpoint().at("training.shell_poses").as<double>(), make().checkpoint().at("training.shell_poses").as<double>()) << "no shell has followed";
  Trainer second = make();
  second.resume(read_safetensors(path));
  train(second, 20);
  const SafetensorsFile a = whole.checkpoint(), b = second.checkpoint();
  ASSERT_EQ(a.tensors.size(), b.tensors.size());
  for (const auto& [name, tensor] : a.tensors) EXPECT_EQ(tensor.data, b.at(name).data) << name;

  const Avatar avatar = whole.avatar();
  ASSERT_EQ(avatar.refined.frames.size(), truth().frames.size());
  save_avatar(path, avatar);
  EXPECT_EQ(load_avatar(path).refined, avatar.refined);
  EXPECT_EQ(pose_to_render(avatar.refined, "train", truth().frames[1]), avatar.refined.poses[1]);
  EXPECT_EQ(pose_to_render(avatar.refined, "novel", truth().frames[1]), truth().frames[1].pose);
  MotionFrame other = truth().frames[1];
  other.number = 1000;
  EXPECT_EQ(pose_to_render(avatar.refined, "train", other), other.pose);

  SafetensorsFile spoilt = avatar_tensors(avatar);
  std::vector<double> theta = spoilt.at("refined.theta").as<double>();
  theta[4] = NAN;
  spoilt.tensors["refined.theta"] = Tensor::from<double>(spoilt.at("refined.theta").shape, theta);
  EXPECT_THROW(avatar_from_tensors(spoilt), InputError);
  spoilt = avatar_tensors(avatar);
  spoilt.tensors.erase("refined.start_root_position");
  EXPECT_THROW(avatar_from_tensors(spoilt), InputError);
}

TEST_F(PoseRefinementTest, RefusesGridsThatSeeOnePoseAlone) {
  TrainingSettings settings = refining();
  settings.sampling.root.correspondence = Correspondence::grid_alone;
  EXPECT_THROW(Trainer(device, small_capture(), make_avatar(small_spec(), small_capture(), 3), settings), InputError);
  search_for_refinement(settings);
  EXPECT_EQ(settings.sampling.root.correspondence, Correspondence::search_from_grid);
  settings.pose_refinement = false;
  settings.sampling.root.correspondence = Correspondence::grid_alone;
  search_for_refinement(settings);
  EXPECT_EQ(settings.sampling.root.correspondence, Correspondence::grid_alone) << "poses that stand still need no search";
}

// Colours are learned on the true poses first; then poses that are wrong by 3° and 1 cm are refined on the pictures, and so are
// the true ones, quickly and at the paper's rate. A turn of a limb about its own axis hardly shows in such small pictures:
// joints come closer, their rotations need not.
TEST_F(PoseRefinementTest, DisturbedPosesComeCloserAndExactOnesStay) {
  for (const Skinning skinning : {Skinning::network, Skinning::template_weights}) {
    AvatarSpec spec = small_spec();
    if (skinning == Skinning::template_weights) spec.skinning = {skinning, 0, 0};
    TrainingSettings settings = small_settings();
    settings.rays = 128;
    settings.sampling.samples = 12;
    settings.skinning_every = 0;
    Avatar avatar = well_fitted_avatar(device, spec);
    {
      Trainer trainer(device, small_capture(), avatar, settings);
      for (uint64_t step = 0; step < 150; ++step) trainer.step(150 - step);
      avatar = trainer.avatar();
    }
    settings.pose_refinement = true;
    for (GroupSettings* group : {&settings.sdf, &settings.mapping, &settings.color, &settings.latent, &settings.deviation, &settings.grid}) group->freeze = 1u << 30;
    const auto refine = [&](double rate, uint64_t steps, double degrees, double metres) {
      settings.poses = {.rate = rate};
      settings.disturb_degrees = degrees, settings.disturb_metres = metres;
      Trainer trainer(device, small_capture(), avatar, settings);
      for (uint64_t step = 0; step < steps; ++step) trainer.step(steps - step);
      const PoseImprovement found = improvement(trainer);
      std::printf("  %s\n", describe(found).c_str());
      return found;
    };
    const PoseImprovement disturbed = refine(2e-3, 200, 3, 0.01);
    EXPECT_LT(disturbed.after.joints, 0.5 * disturbed.before.joints);
    if (skinning == Skinning::template_weights) continue;
    const PoseImprovement exact = refine(2e-3, 200, 0, 0), slow = refine(1e-4, 120, 0, 0);
    EXPECT_EQ(exact.before.joints, 0);
    EXPECT_LT(exact.after.joints, 0.3 * disturbed.before.joints);
    EXPECT_LT(slow.after.rotations, 0.1 * degree);
  }
}

}  // namespace
}  // namespace arah
