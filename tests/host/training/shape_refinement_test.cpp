// Refinement of the body's shape in training: its gradient against differences, a disturbed shape comes closer to the truth, the
// true one stays, a resumed run goes on bit for bit, and the avatar carries what was found.
#include "host/training/shape_refinement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <random>
#include <set>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/training/trainer.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

const std::vector<double> kTruth(4, 0.0);  // of the capture's body

class ShapeRefinementTest : public DeviceTest {
 protected:
  static TrainingSettings refining() {
    TrainingSettings settings = small_settings();
    settings.pose_refinement = settings.shape_refinement = true;
    settings.poses = settings.shape = {.rate = 2e-3};
    settings.end_fraction = 0.1;
    return settings;
  }
  static PoseImprovement improvement(Trainer& trainer) {
    const Avatar avatar = trainer.avatar();
    return pose_improvement(avatar.refined, avatar.body, small_capture().body_template.skeleton, motion_of(small_capture(), "train"));
  }
  static void freeze_networks(TrainingSettings& settings) {
    for (GroupSettings* group : {&settings.sdf, &settings.mapping, &settings.skinning, &settings.color, &settings.latent, &settings.deviation, &settings.grid}) group->freeze = 1u << 30;
  }
};

TEST(DisturbedShape, IsAsFarAsItSaysAndTheSameAgain) {
  double squares = 0;
  for (uint64_t seed = 0; seed < 500; ++seed) {
    const std::vector<double> other = disturbed_shape({1, 2}, 0.5, seed);
    EXPECT_EQ(other, disturbed_shape({1, 2}, 0.5, seed));
    squares += (std::pow(other[0] - 1, 2) + std::pow(other[1] - 2, 2)) / 1000;
  }
  EXPECT_NEAR(std::sqrt(squares), 0.5, 0.03);
  EXPECT_EQ(disturbed_shape({1, 2}, 0, 7), (std::vector<double>{1, 2}));
}

// A loss that is linear in the bone transforms, the root translation and what the SDF reads, in a shape that is not the base's:
// its slope along each number of β by differences of these themselves.
TEST(ShapeGradient, IsTheSlopeOfBonesTranslationAndPoseInput) {
  AvatarSpec spec = small_spec();
  spec.sdf.pose = PoseConditioning::low_rank;
  spec.sdf.pose_width = 8;
  spec.sdf.pose_hidden_layers = 1;
  Avatar avatar = make_avatar(spec, small_capture(), 3);
  const Pose pose = disturbed_pose(motion_of(small_capture(), "train").frames[1].pose, 30, 0.1, 1, 1);
  const size_t joints = avatar.body.skeleton.size();
  std::mt19937_64 generator(4);
  std::uniform_real_distribution<float> uniform(-1, 1);
  PoseGradients gradients{std::vector<float>(12 * joints), std::vector<float>(12 * joints)};
  for (std::vector<float>* values : {&gradients.bones, &gradients.input})
    for (float& value : *values) value = uniform(generator);
  const std::vector<double> start{0.3, -0.4, 0.2, 0.1};
  // The translation's gradient is what the bones' last columns sum to: t and the columns are added in posed space.
  const auto loss = [&](const std::vector<double>& beta) {
    set_shape(avatar.body, beta);
    const std::vector<glm::dmat4> bones = bone_transforms(avatar.body.skeleton, avatar.canonical, pose);
    const glm::dvec3 t = root_translation(avatar.body.skeleton, pose);
    double sum = 0;
    for (size_t b = 0; b < joints; ++b)
      for (int i = 0; i < 12; ++i) sum += double{gradients.bones[12 * b + size_t(i)]} * (bones[b][i % 4][i / 4] + (i % 4 == 3 ? t[i / 4] : 0));
    for (size_t j = 0; j < joints; ++j) {
      const glm::dvec3 n = avatar.cube.to_cube(avatar.body.skeleton.rest_joints[j]);
      for (int axis = 0; axis < 3; ++axis) sum += double{gradients.input[9 * joints + 3 * j + size_t(axis)]} * n[axis];
    }
    return sum;
  };
  set_shape(avatar.body, start);
  const std::vector<double> found = shape_gradient(avatar, pose, gradients);
  ASSERT_EQ(found.size(), 4u);
  double largest = 0;
  for (size_t b = 0; b < 4; ++b) {
    std::vector<double> more = start, less = start;
    more[b] += 1e-3, less[b] -= 1e-3;
    const double slope = (loss(more) - loss(less)) / 2e-3;
    EXPECT_NEAR(found[b], slope, 1e-9 * (1 + std::abs(slope))) << avatar.body.shape.names[b];
    largest = std::max(largest, std::abs(slope));
  }
  EXPECT_GT(largest, 0.01);
}

// The same of a training step: its loss in shapes to both sides, everything else as it was, against what Adam was given. The shell
// goes where the root translation does and takes the samples along, so the root follows its joint and the translation stays; the
// box, whose rays' bins they lie in, still follows the body, so that they must be so many that it does not matter where they are.
TEST_F(ShapeRefinementTest, AStepsGradientIsTheSlopeOfItsLoss) {
  TrainingSettings settings = refining();
  settings.sampling.root.tolerance = 1e-6f;
  settings.sampling.root.max_iterations = 40;
  settings.rays = 256;
  settings.sampling.samples = 256;
  settings.average_decay = 0;
  const Avatar start = well_fitted_avatar(device, small_spec());
  const size_t numbers = 3 * start.body.skeleton.size() + 3;
  Trainer trainer(device, small_capture(), start, settings);
  const SafetensorsFile saved = trainer.checkpoint();
  trainer.step(1);
  const SafetensorsFile after = trainer.checkpoint();
  // First moments are a tenth of the gradients.
  const std::vector<double> of_shape = after.at("optimizer.shape_first_moments").as<double>(), of_poses = after.at("optimizer.pose_first_moments").as<double>();
  glm::dvec3 of_root(0);
  for (size_t i = 0; i < of_poses.size(); ++i)
    if (i % numbers >= numbers - 3) of_root[static_cast<int>(i % numbers - (numbers - 3))] += 10 * of_poses[i];
  const auto loss = [&](size_t b, double width) {
    SafetensorsFile other = saved;
    std::vector<double> shape(4, 0.0), poses(of_poses.size(), 0.0);
    shape[b] = width;
    for (size_t i = 0; i < poses.size(); ++i)
      if (i % numbers >= numbers - 3) poses[i] = width * start.body.shape.joint_offsets[b][0][static_cast<int>(i % numbers - (numbers - 3))];
    other.tensors["optimizer.shape"] = Tensor::from<double>({4}, shape);
    other.tensors["optimizer.pose"] = Tensor::from<double>(saved.at("optimizer.pose").shape, poses);
    Trainer in_shape(device, small_capture(), start, settings);
    in_shape.resume(other);
    return in_shape.step(1).total;
  };
  double largest = 0;
  std::vector<double> found;
  for (size_t b = 0; b < 4; ++b) {
    found.push_back(10 * of_shape[b] + glm::dot(of_root, start.body.shape.joint_offsets[b][0]));
    largest = std::max(largest, std::abs(found[b]));
  }
  for (size_t b = 0; b < 4; ++b) {
    constexpr double width = 0.004;  // half a millimetre at the hands; over more, samples between the legs change sides
    const double slope = (loss(b, width) - loss(b, -width)) / (2 * width);
    std::printf("  %s: %.5f by differences, %.5f in the step (%.5f with the root where it was)\n", start.body.shape.names[b].c_str(), slope, found[b], 10 * of_shape[b]);
    EXPECT_NEAR(found[b], slope, 0.02 * largest) << start.body.shape.names[b];
  }
  EXPECT_GT(largest, 0.1);
}

TEST_F(ShapeRefinementTest, ContinuesBitForBitAndTheAvatarCarriesTheShape) {
  Avatar start = well_fitted_avatar(device, small_spec());
  set_shape(start.body, {0.2, -0.3, 0.1, 0.4});
  TrainingSettings settings = refining();
  settings.sampling.root.correspondence = Correspondence::search_from_grid;
  settings.ray_importance = 0.5;
  settings.grid_steps = 8;
  settings.shell_drift = 2e-4;  // so that shells follow within these steps
  settings.poses_every = 2;
  settings.shape.rate = 2e-2;
  const auto train = [](Trainer& trainer, uint64_t until) {
    while (trainer.steps_done() < until) trainer.step(20 - trainer.steps_done());
  };
  Trainer whole(device, small_capture(), start, settings);
  train(whole, 20);
  const std::filesystem::path path = small_capture().path / "shaped.safetensors";
  Trainer first(device, small_capture(), start, settings);
  train(first, 11);
  write_safetensors(path, first.checkpoint());
  const std::vector<double> shells = first.checkpoint().at("training.shell_shapes").as<double>();
  EXPECT_EQ(shells.size(), 16u);
  EXPECT_GT(std::set<double>(shells.begin(), shells.end()).size(), 4u) << "no shell has followed";
  // As a run takes it up: the avatar of the checkpoint, in the shape that it had come to.
  const SafetensorsFile saved = read_safetensors(path);
  Trainer second(device, small_capture(), avatar_from_tensors(saved), settings);
  second.resume(saved);
  train(second, 20);
  const SafetensorsFile a = whole.checkpoint(), b = second.checkpoint();
  ASSERT_EQ(a.tensors.size(), b.tensors.size());
  for (const auto& [name, tensor] : a.tensors) EXPECT_EQ(tensor.data, b.at(name).data) << name;

  const Avatar avatar = second.avatar();
  EXPECT_EQ(avatar.refined.start_shape, (std::vector<double>{0.2, -0.3, 0.1, 0.4}));
  EXPECT_NE(avatar.body.shape.beta, avatar.refined.start_shape);
  EXPECT_EQ(avatar.canonical.rest_to_canonical, start.canonical.rest_to_canonical);
  save_avatar(path, avatar);
  const Avatar loaded = load_avatar(path);
  EXPECT_EQ(loaded.refined, avatar.refined);
  EXPECT_EQ(loaded.body.shape.beta, avatar.body.shape.beta);
  EXPECT_EQ(loaded.body.vertices, avatar.body.vertices);
  EXPECT_EQ(loaded.body.skeleton.rest_joints, avatar.body.skeleton.rest_joints);
  EXPECT_EQ(loaded.canonical.rest_to_canonical, avatar.canonical.rest_to_canonical);
  EXPECT_EQ(read_body_template_bytes(body_template_glb(loaded.body), "exported").shape.beta, avatar.body.shape.beta);

  for (const char* name : {"template.shape", "refined.start_shape"}) {
    SafetensorsFile spoilt = avatar_tensors(avatar);
    spoilt.tensors[name] = Tensor::from<double>({4}, std::vector<double>{0, NAN, 0, 0});
    EXPECT_THROW(avatar_from_tensors(spoilt), InputError) << name;
    spoilt.tensors[name] = Tensor::from<double>({3}, std::vector<double>{0, 0, 0});
    EXPECT_THROW(avatar_from_tensors(spoilt), InputError) << name;
  }
}

TEST_F(ShapeRefinementTest, IsIdleWithoutPoseRefinementAndRefusedWithoutTargets) {
  TrainingSettings settings = refining();
  const Avatar avatar = make_avatar(small_spec(), small_capture(), 3);
  settings.pose_refinement = false;
  Trainer idle(device, small_capture(), avatar, settings);
  EXPECT_FALSE(idle.checkpoint().tensors.contains("optimizer.shape"));
  settings.pose_refinement = true;
  Avatar without = avatar;
  without.body.shape = {};
  EXPECT_THROW(Trainer(device, small_capture(), without, settings), InputError);
  without = avatar;
  for (auto& offsets : without.body.shape.joint_offsets) offsets.assign(offsets.size(), glm::dvec3(0));
  EXPECT_THROW(Trainer(device, small_capture(), without, settings), InputError);
}

// Networks are learned on the true poses and shape first. Then the shape is wrong, alone or with the poses, and is refined on the
// pictures; and so is the true one.
TEST_F(ShapeRefinementTest, ADisturbedShapeComesCloserAndTheTrueOneStays) {
  TrainingSettings settings = small_settings();
  settings.rays = 128;
  settings.sampling.samples = 12;
  settings.skinning_every = 0;
  Avatar avatar = well_fitted_avatar(device, small_spec());
  {
    Trainer trainer(device, small_capture(), avatar, settings);
    for (uint64_t step = 0; step < 150; ++step) trainer.step(150 - step);
    avatar = trainer.avatar();
  }
  settings.pose_refinement = settings.shape_refinement = true;
  freeze_networks(settings);
  const auto refine = [&](const std::vector<double>& beta, double degrees, double metres, double pose_rate, double shape_rate) {
    Avatar disturbed = avatar;
    set_shape(disturbed.body, beta);
    settings.poses = {.rate = pose_rate};
    settings.shape = {.rate = shape_rate};
    settings.disturb_degrees = degrees, settings.disturb_metres = metres;
    Trainer trainer(device, small_capture(), disturbed, settings);
    for (uint64_t step = 0; step < 200; ++step) trainer.step(200 - step);
    const PoseImprovement found = improvement(trainer);
    const std::vector<double> after = trainer.avatar().body.shape.beta;
    std::printf("  %s; shape %.2f %.2f %.2f %.2f, then %.2f %.2f %.2f %.2f\n", describe(found).c_str(), beta[0], beta[1], beta[2], beta[3], after[0], after[1], after[2], after[3]);
    return found;
  };
  const std::vector<double> wrong{0, 0.6, -0.6, 0.5};
  const PoseImprovement alone = refine(wrong, 0, 0, 0, 2e-2);
  EXPECT_LT(alone.after.joints, 0.5 * alone.before.joints);
  const PoseImprovement fixed = refine(wrong, 3, 0.01, 2e-3, 0), both = refine(wrong, 3, 0.01, 2e-3, 2e-2);
  EXPECT_LT(both.after.joints, 0.6 * both.before.joints);
  EXPECT_LT(both.after.joints, fixed.after.joints) << "poses alone do as well";
  const PoseImprovement exact = refine(kTruth, 0, 0, 0, 2e-3);
  EXPECT_EQ(exact.before.joints, 0);
  EXPECT_LT(exact.after.joints, 0.15 * alone.before.joints);
}

}  // namespace
}  // namespace arah
