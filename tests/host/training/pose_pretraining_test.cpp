// The second stage of a prior: pose networks over the SDF that the first stage left.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>

#include "host/training/pretrain_tasks.h"
#include "host/training/pretraining.h"
#include "host/training/template_fit.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

const BodyFamily& clothed_family() {
  static const BodyFamily family = generated_family(2, 1);
  return family;
}

AvatarSpec posed_spec(PoseConditioning pose, uint32_t width = 16) {
  AvatarSpec spec = small_spec();
  spec.skinning = {Skinning::template_weights, 0, 0};
  spec.sdf.pose = pose;
  spec.sdf.pose_width = width;
  spec.sdf.pose_hidden_layers = 1;
  return spec;
}

// Five poses in batches of two: the last of a pass is one pose.
PretrainSettings two_stages() {
  PretrainSettings settings;
  settings.seed = 5;
  settings.bodies = 2;
  settings.poses = 5;
  settings.sdf = {.steps = 40, .tasks = 2, .inner_steps = 6, .inner_rate = 1e-3, .outer_rate = 2e-3};
  settings.pose = {.steps = 25, .tasks = 2, .inner_steps = 2, .inner_rate = 1e-4, .outer_rate = 1e-4};
  settings.pose_batch = 2;
  settings.surface_points = 200;  // no multiple of 64
  settings.volume_points = 130;
  return settings;
}

bool same_tensors(const SafetensorsFile& a, const SafetensorsFile& b) {
  if (a.tensors.size() != b.tensors.size()) return false;
  for (const auto& [name, tensor] : a.tensors)
    if (!b.tensors.contains(name) || tensor.data != b.tensors.at(name).data) return false;
  return true;
}

class PosePretraining : public DeviceTest, public testing::WithParamInterface<PoseConditioning> {
 protected:
  std::filesystem::path file(const std::string& name) const { return small_capture().path / (name + "_" + to_string(GetParam()) + ".safetensors"); }
  // After the first stage.
  std::unique_ptr<Pretraining> first_stage(const BodyFamily& family) {
    auto pretraining = std::make_unique<Pretraining>(device, posed_spec(GetParam()), family, two_stages());
    for (int step = 0; step < 40; ++step) pretraining->sdf_step();
    return pretraining;
  }
};

TEST_P(PosePretraining, LowersTheLossInPosesThatItDidNotSee) {
  const auto stages = first_stage(clothed_family());
  Pretraining& pretraining = *stages;
  const Pretraining::HeldOut start = pretraining.held_out();
  EXPECT_EQ(start.posed, start.shared) << "networks of zero change nothing, to the last bit";
  std::vector<double> losses;
  for (int step = 0; step < 25; ++step) losses.push_back(pretraining.pose_step());
  const Pretraining::HeldOut end = pretraining.held_out();
  std::printf("  held-out poses: %.3f with the pose, %.3f with the shared SDF; tasks %.3f at first, %.3f at last\n", end.posed, end.shared, losses.front(), losses.back());
  EXPECT_EQ(end.shared, start.shared) << "the first stage's SDF stays";
  EXPECT_LT(end.posed, 0.97 * end.shared);
  EXPECT_LT(losses.back(), losses.front());

  // An avatar starts with them, and the fit to its template goes through them.
  write_safetensors(file("learned"), pretraining.tensors());
  const Prior prior = read_prior(file("learned"));
  Avatar avatar = make_avatar(posed_spec(GetParam()), small_capture(), 3);
  EXPECT_THAT(start_from_prior(avatar, prior), testing::StartsWith("pose networks from the prior"));
  const std::string changing = GetParam() == PoseConditioning::low_rank ? "low_rank.1.U" : "hyper_last.1.W";
  const std::vector<float> kept(avatar.tensor(changing).begin(), avatar.tensor(changing).end());
  EXPECT_TRUE(std::ranges::any_of(kept, [](float w) { return w != 0; }));
  TrainingSettings settings = small_settings();
  settings.fit_steps = 250;
  const std::vector<Pose> poses = member_poses(clothed_family(), 0, 3, 0);
  const TemplateFit fit = fit_template(device, avatar, settings, {}, poses);
  std::printf("  fitted in poses: %.2f mm\n", 1e3 * fit.sdf_error);
  EXPECT_LT(fit.sdf_error, 0.006);
  EXPECT_TRUE(std::ranges::equal(avatar.tensor(changing), kept)) << "the fit moves the shared SDF alone";

  // Of other sizes they are left, in so many words; the SDF is taken.
  Avatar other = make_avatar(posed_spec(GetParam(), 8), small_capture(), 3);
  const std::vector<float> own = other.parameters;
  EXPECT_THAT(start_from_prior(other, prior), testing::AllOf(testing::StartsWith("pose networks not from the prior"), testing::HasSubstr("of width 8"), testing::HasSubstr("of width 16")));
  for (const ParameterGroup& group : other.layout.groups) {
    const auto begin = static_cast<std::ptrdiff_t>(group.begin), end_at = static_cast<std::ptrdiff_t>(group.end);
    EXPECT_EQ(std::equal(own.begin() + begin, own.begin() + end_at, other.parameters.begin() + begin), group.name != "sdf") << group.name;
  }
}

TEST_P(PosePretraining, ContinuesToTheSameBits) {
  Pretraining whole(device, posed_spec(GetParam()), clothed_family(), two_stages()), parts(device, posed_spec(GetParam()), clothed_family(), two_stages());
  std::vector<double> losses;
  for (int step = 0; step < 2; ++step) whole.sdf_step(), parts.sdf_step();
  for (int step = 0; step < 4; ++step) losses.push_back(whole.pose_step());
  for (std::size_t step = 0; step < 2; ++step) EXPECT_EQ(parts.pose_step(), losses[step]);
  parts.held_out();  // changes nothing
  write_safetensors(file("parts"), parts.tensors());
  Pretraining resumed(device, posed_spec(GetParam()), clothed_family(), two_stages());
  resumed.resume(read_safetensors(file("parts")));
  EXPECT_EQ(resumed.pose_steps(), 2u);
  for (std::size_t step = 2; step < 4; ++step) EXPECT_EQ(resumed.pose_step(), losses[step]);
  EXPECT_TRUE(same_tensors(resumed.tensors(), whole.tensors()));
}

// Bodies without clothes have one canonical surface in all poses, and the pose networks are to learn just that.
TEST_P(PosePretraining, BodiesThatOnlyFollowTheirJointsAreTakenInPoses) {
  BodyFamily naked = clothed_family();
  for (FamilyMember& member : naked.members) member.figure = undressed_rig(member.figure.body);
  const auto pretraining = first_stage(naked);
  for (int step = 0; step < 25; ++step) pretraining->pose_step();
  const Pretraining::HeldOut end = pretraining->held_out();
  std::printf("  at rest: %.3f with the pose, %.3f with the shared SDF\n", end.posed, end.shared);
  EXPECT_LT(end.posed, end.shared);  // the networks see the bodies' joints, and tell one body from the other
}

// An inner step's gradient against differences of the loss along it, group by group, from networks that are not zero.
TEST_P(PosePretraining, AnInnerStepFollowsTheGradient) {
  PretrainSettings settings = two_stages();
  settings.parameter_weight = 0;  // which the loss does not count
  Avatar avatar = make_avatar(prior_spec(posed_spec(GetParam())), clothed_family().members.front().figure.body, {}, 4);
  for (const TensorSlot& slot : avatar.layout.slots)
    if (slot.name.starts_with("hyper_last.") || (slot.name.starts_with("low_rank.") && !slot.name.ends_with(".V"))) {
      const std::vector<float> values = uniform(slot.count, -3e-3, 3e-3);
      std::ranges::copy(values, avatar.tensor(slot.name).begin());
    }
  AvatarNetworks networks(device, avatar, true, settings.pose_batch);
  ScanLoss loss(device, networks, settings);
  const std::vector<FamilyScan> scans = family_scans(clothed_family(), 2, 0);
  std::vector<ScanPoints> points;
  std::vector<std::vector<PosedScan>> bodies(1);
  for (std::size_t s = 0; s < 2; ++s) points.emplace_back(scans[s], avatar.cube), bodies[0].push_back({s, pose_input(avatar, scans[s].pose)});
  PoseTasks tasks(device, networks, loss, points, bodies, settings);
  EXPECT_EQ(tasks.inner_steps(), 2u);
  std::mt19937_64 random(1);
  tasks.draw(0, 0, random);
  const auto run = [&] {
    commands.fill(networks.gradients(), 0);
    tasks.clear_losses(commands);
    tasks.record(commands);
    commands.submit_and_wait();
    return tasks.loss();
  };
  run();
  ASSERT_EQ(tasks.frames(), 2u);

  std::map<std::string, std::vector<float>> gradients;  // of the whole buffer, 0 outside the group
  const auto written = device.download<float>(networks.gradients());
  for (const char* name : {"pose_code", "hyper", "low_rank"}) {
    const ParameterGroup& group = networks.layout().group(name);
    if (group.size() == 0) continue;
    std::vector<float>& gradient = gradients[name];
    gradient.assign(networks.layout().floats, 0.0F);
    std::copy_n(written.begin() + static_cast<std::ptrdiff_t>(group.begin), group.size(), gradient.begin() + static_cast<std::ptrdiff_t>(group.begin));
  }
  if (GetParam() == PoseConditioning::hypernetwork) {
    std::vector<float>& gradient = gradients["hyper_last"];
    gradient.assign(networks.layout().floats, 0.0F);
    for (const AvatarNetworks::LastGradient& part : networks.hyper_last_gradients(2)) {
      const OuterProduct& product = part.product;
      const auto a = device.download<float>(product.a), b = device.download<float>(product.b);
      for (uint32_t frame = 0; frame < 2; ++frame)
        for (uint32_t row = 0; row < product.rows; ++row)
          for (uint32_t column = 0; column < product.columns; ++column)
            gradient[part.slot.offset + row * product.columns + column] += a[frame * product.row_stride + row] * b[frame * product.column_stride + product.first_column + column];
    }
  }
  for (const auto& [name, gradient] : gradients) {
    double square = 0;
    for (const float g : gradient) square += double{g} * g;
    const double norm = std::sqrt(square), step = 0.05 / norm;  // the loss changes by 0.05 either way
    const auto loss_at = [&](double along) {
      std::vector<float> moved = avatar.parameters;
      for (std::size_t i = 0; i < moved.size(); ++i) moved[i] = static_cast<float>(moved[i] + along * gradient[i] / norm);
      device.upload(networks.parameters(), moved);
      return run();
    };
    const double slope = (loss_at(step) - loss_at(-step)) / (2 * step);
    std::printf("  %s: gradient's norm %.4f, by differences %.4f\n", name.c_str(), norm, slope);
    EXPECT_NEAR(slope, norm, 0.01 * norm) << name;
  }
}

// Distances in metres at canonical places, in a pose.
std::vector<double> distances(Device& device, const Avatar& avatar, const std::vector<glm::dvec3>& places, const Pose& pose) {
  AvatarNetworks networks(device, avatar, true);
  SirenTape tape(device, "test: sdf", networks.sdf_shape(), padded_points(static_cast<uint32_t>(places.size())), SirenTape::Holds::second_order);
  std::vector<float> input(size_t{tape.capacity()} * channel_padding);
  for (std::size_t i = 0; i < places.size(); ++i)
    for (int axis = 0; axis < 3; ++axis) input[i * channel_padding + static_cast<std::size_t>(axis)] = static_cast<float>(avatar.cube.to_cube(places[i])[axis]);
  device.upload(tape.input().slice, input);
  Commands commands(device);
  networks.record_pack(commands, 0, pose_input(avatar, pose));
  networks.sdf().record_forward(commands, tape, {static_cast<uint32_t>(places.size()), {}}, true);
  commands.submit_and_wait();
  const auto f = device.download<float>(tape.sdf().slice);
  std::vector<double> all;
  for (std::size_t i = 0; i < places.size(); ++i) all.push_back(double{f[i * channel_padding]} * avatar.cube.metres_per_unit());
  return all;
}

// Of layer 0 before its softplus.
std::vector<double> first_skinning_layer(const Avatar& avatar, const glm::dvec3& place) {
  const auto v = avatar.tensor("skinning.0.v"), g = avatar.tensor("skinning.0.g"), b = avatar.tensor("skinning.0.b");
  std::vector<double> all;
  for (std::size_t row = 0; row < g.size(); ++row) {
    const glm::dvec3 direction(v[3 * row], v[3 * row + 1], v[3 * row + 2]);
    all.push_back(double{g[row]} * glm::dot(direction, avatar.cube.to_cube(place)) / glm::length(direction) + double{b[row]});
  }
  return all;
}

// A mesh with other vertices has another cube, and the prior's networks say the same of the same places in it.
TEST_P(PosePretraining, AnAvatarOfAnotherCubeSeesTheSameFields) {
  AvatarSpec spec = posed_spec(GetParam());
  spec.skinning = small_spec().skinning;
  BodyTemplate body = small_capture().body_template;
  Avatar of_prior_cube = make_avatar(prior_spec(spec), body, {}, 4);
  for (const TensorSlot& slot : of_prior_cube.layout.slots)
    if (slot.name.starts_with("hyper_last.") || (slot.name.starts_with("low_rank.") && !slot.name.ends_with(".V"))) {
      const std::vector<float> values = uniform(slot.count, -3e-3, 3e-3);
      std::ranges::copy(values, of_prior_cube.tensor(slot.name).begin());
    }
  write_safetensors(file("moved"), prior_tensors(of_prior_cube, two_stages(), "{}", joint_places(of_prior_cube)));
  for (std::size_t i = 0, head = body.vertices.size() / 3; i < head; ++i) {  // vertices of no triangle
    body.vertices.emplace_back(0.3F, 2.4F, -0.2F);
    body.normals.push_back(body.normals[i]), body.joints.push_back(body.joints[i]), body.weights.push_back(body.weights[i]);
  }
  body.glb.clear();
  body.shape = {};  // of fewer vertices
  Avatar moved = make_avatar(spec, body, {0}, 4);
  ASSERT_GT(glm::length(moved.cube.center - of_prior_cube.cube.center), 0.1);
  ASSERT_GT(std::abs(moved.cube.metres_per_unit() - of_prior_cube.cube.metres_per_unit()), 0.02);
  start_from_prior(moved, read_prior(file("moved")));

  std::vector<glm::dvec3> places;
  std::uniform_real_distribution<double> unit(-0.8, 0.8);
  for (int i = 0; i < 100; ++i) places.emplace_back(unit(generator), 1 + unit(generator), unit(generator));
  const Pose pose = member_poses(clothed_family(), 0, 3, 0)[1];
  const std::vector<double> expected = distances(device, of_prior_cube, places, pose), shared = distances(device, of_prior_cube, places, rest_pose(body.skeleton)), found = distances(device, moved, places, pose);
  double change = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    EXPECT_NEAR(found[i], expected[i], 2e-5) << i;
    change = std::max(change, std::abs(expected[i] - shared[i]));
    const std::vector<double> skinning = first_skinning_layer(of_prior_cube, places[i]), skinning_found = first_skinning_layer(moved, places[i]);
    for (std::size_t row = 0; row < skinning.size(); ++row) ASSERT_NEAR(skinning_found[row], skinning[row], 1e-5);
  }
  EXPECT_GT(change, 1e-4) << "the pose must matter for this to say anything of its networks";
}

INSTANTIATE_TEST_SUITE_P(BothKinds, PosePretraining, testing::Values(PoseConditioning::low_rank, PoseConditioning::hypernetwork), [](const auto& kind) { return std::string(to_string(kind.param)); });

TEST(PosePretrainingMemory, TooLowACeilingIsRefusedAtOnceWithTheOneThatWouldDo) {
  DeviceOptions options = DeviceOptions::from_environment();
  options.memory_ceiling = 1 << 20;
  Device device(options);
  try {
    Pretraining(device, posed_spec(PoseConditioning::hypernetwork, 64), clothed_family(), two_stages());
    FAIL() << "nothing was refused";
  } catch (const MemoryCeilingError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("pre-training: asks for"), testing::HasSubstr("the memory ceiling is 1")));
  }
}

TEST(PosePretrainingSettings, AFileFromBeforeTheSecondStageReads) {
  PretrainSettings settings = two_stages();
  settings.pose = PretrainSettings().pose;
  settings.pose_batch = PretrainSettings().pose_batch;
  const std::string text = pretrain_settings_to_json(settings);
  std::string before = text;
  const std::size_t from = before.find("  \"pose\": {"), to = before.find("  \"surface_points\"");
  ASSERT_TRUE(from != std::string::npos && to != std::string::npos && from < to);
  before.erase(from, to - from);
  EXPECT_EQ(pretrain_settings_to_json(pretrain_settings_from_json(before, "here")), text);
  EXPECT_EQ(settings.pose.steps, 0u);
}

}  // namespace
}  // namespace arah
