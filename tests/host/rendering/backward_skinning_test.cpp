// The ablation whose network gives the weights at posed points: correspondences without a search, and their gradient.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "host/rendering/root_finder.h"
#include "host/training/skinning_gradient.h"
#include "shaders/shared/skinning.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

using Points = std::vector<std::array<float, 4>>;

class BackwardSkinning : public DeviceTest {
 protected:
  BackwardSkinning() : avatar(made(device)), networks(device, avatar, true), body(device, avatar.body), finder(device, networks, 4096) {}

  static Avatar made(Device& device) {
    AvatarSpec spec = small_paper_spec();
    spec.skinning.kind = Skinning::backward;
    return capsule_avatar(device, spec);
  }

  // In posed space, without the root translation; w = 1.
  Points posed_template(const Pose& pose) const {
    const glm::dvec3 t = root_translation(avatar.body.skeleton, pose);
    Points points;
    for (const glm::vec3& p : posed_vertices(avatar.body, pose)) points.push_back({static_cast<float>(double{p.x} - t.x), static_cast<float>(double{p.y} - t.y), static_cast<float>(double{p.z} - t.z), 1});
    return points;
  }
  Buffer on_device(const char* name, Points points) {
    points.resize(padded_points(static_cast<uint32_t>(points.size())), {0, 0, 0, 0});
    return filled(name, points);
  }
  void pack(FrameOnDevice& frame) {
    networks.record_pose(commands, frame.joint_rotations());
    networks.record_pack(commands, 0, {});
  }
  Points solve(FrameOnDevice& frame, Buffer& targets, Buffer& canonical, uint32_t count) {
    pack(frame);
    finder.solve(commands, frame, count, targets.slice(), canonical.slice(), {});
    Points found = device.download<std::array<float, 4>>(canonical.slice());
    found.resize(count);
    return found;
  }

  Avatar avatar;
  AvatarNetworks networks;
  TemplateOnDevice body;
  PointRootFinder finder;
};

TEST_F(BackwardSkinning, BringsThePosedTemplateBackWhereverTheBodyStands) {
  const std::vector<glm::dvec3> canonical = canonical_vertices(avatar.body, avatar.canonical);
  Pose pose = bent_pose(avatar.body.skeleton);
  Points before;
  for (const bool turned : {false, true}) {
    if (turned) pose.theta[0] = {-1.1, 2.0, 0.4}, pose.root_position += glm::dvec3(3, -1, 2);
    FrameOnDevice frame(device, avatar, body, pose, {});
    const Points targets = posed_template(pose);
    const auto count = static_cast<uint32_t>(std::min<size_t>(targets.size(), finder.capacity()));
    Buffer target_buffer = on_device("targets", {targets.begin(), targets.begin() + count}), result = on_device("canonical", Points(count));
    const Points found = solve(frame, target_buffer, result, count);
    double error = 0, apart = 0;
    for (size_t p = 0; p < count; ++p) {
      ASSERT_EQ(found[p][3], 1);
      error += glm::distance(glm::dvec3(found[p][0], found[p][1], found[p][2]), canonical[p]) / count;
      if (turned) apart = std::max(apart, glm::distance(glm::dvec3(found[p][0], found[p][1], found[p][2]), glm::dvec3(before[p][0], before[p][1], before[p][2])));
    }
    std::printf("  %.1f mm from the canonical template in the mean, %.1e m from the pose before\n", 1000 * error, apart);
    EXPECT_LT(error, 0.02);
    EXPECT_LT(apart, 2e-5);
    before = found;

    // The blended transforms of any of them lead back to where they came from.
    std::vector<uint32_t> ids(padded_points(70), 0);
    Points rows(padded_points(70), {0, 0, 0, 0});
    for (uint32_t r = 0; r < 70; ++r) ids[r] = count - 1 - 3 * r, rows[r] = found[ids[r]];
    Buffer id_buffer = filled("ids", ids), row_buffer = filled("rows", rows);
    const BufferSlice transforms = finder.record_transforms(commands, frame, {{70, {}}, id_buffer.slice()}, row_buffer.slice());
    commands.submit_and_wait();
    const auto t = device.download<std::array<float, 12>>(transforms.sub(0, 70 * 48));
    for (size_t r = 0; r < 70; ++r)
      for (size_t i = 0; i < 3; ++i)
        EXPECT_NEAR(double{t[r][4 * i]} * rows[r][0] + double{t[r][4 * i + 1]} * rows[r][1] + double{t[r][4 * i + 2]} * rows[r][2] + double{t[r][4 * i + 3]}, targets[ids[r]][i], 5e-6);
  }
}

// L = Σ points x̂ · fixed random numbers, by the network's parameters; rows of a queue in another order than the targets.
TEST_F(BackwardSkinning, GradientsAgreeWithDifferences) {
  const Pose pose = bent_pose(avatar.body.skeleton);
  FrameOnDevice frame(device, avatar, body, pose, {});
  Points targets = posed_template(pose);
  constexpr uint32_t count = 131;
  std::shuffle(targets.begin(), targets.end(), generator);
  targets.resize(count);
  for (auto& point : targets)
    for (size_t i = 0; i < 3; ++i) point[i] += uniform(1, -0.03f, 0.03f)[0];
  Buffer target_buffer = on_device("targets", targets), canonical = on_device("canonical", Points(count));
  std::vector<uint32_t> samples(padded_points(count), 0);
  for (uint32_t r = 0; r < count; ++r) samples[r] = count - 1 - r;
  const std::vector<float> factors = uniform(3 * count);
  Points upstream(count);
  for (uint32_t r = 0; r < count; ++r) upstream[r] = {factors[3 * r], factors[3 * r + 1], factors[3 * r + 2], 0};
  Buffer sample_buffer = filled("samples", samples), upstream_buffer = on_device("upstream", upstream);
  const auto loss = [&](const std::vector<float>& parameters) {
    device.upload(networks.parameters(), parameters);
    const Points found = solve(frame, target_buffer, canonical, count);
    double sum = 0;
    for (uint32_t r = 0; r < count; ++r)
      for (size_t i = 0; i < 3; ++i) sum += double{factors[3 * r + i]} * found[samples[r]][i];
    return sum;
  };

  const std::vector<float> start = avatar.parameters;
  loss(start);
  const Points found = device.download<std::array<float, 4>>(canonical.slice());
  Points rows(count);
  for (uint32_t r = 0; r < count; ++r) rows[r] = found[samples[r]];
  Buffer row_buffer = on_device("rows", rows);
  Buffer counts = filled("counts", std::vector<shared::ImplicitCounts>(1));
  SkinningGradient gradient(device, networks, count, 64, counts.slice());
  Buffer scratch(device, "scratch", 4 * gradient.scratch_floats(), BufferPlace::device);
  commands.fill(networks.gradients(), 0);
  gradient.record_from_positions(commands, frame, count, row_buffer.slice(), upstream_buffer.slice(), false, scratch.slice(), {.targets = target_buffer.slice(), .samples = sample_buffer.slice()});
  networks.record_unpack(commands, 0, {false, true, false}, scratch.slice());
  commands.submit_and_wait();
  const auto analytic = device.download<float>(networks.gradients());

  std::normal_distribution<double> normal;
  size_t tensors = 0;
  for (const TensorSlot& slot : avatar.layout.slots) {
    if (!slot.name.starts_with("skinning")) continue;
    tensors += 1;
    double squares = 0;
    for (uint64_t i = 0; i < slot.count; ++i) squares += std::pow(double{analytic[slot.offset + i]}, 2);
    const double length = std::sqrt(squares);
    ASSERT_GT(length, 0) << slot.name;
    // Along the gradient with as much at random: the change must not drown in float32's rounding of the points.
    std::vector<double> along(slot.count);
    double expected = 0;
    for (uint64_t i = 0; i < slot.count; ++i) {
      along[i] = analytic[slot.offset + i] / length + normal(generator) / std::sqrt(double(slot.count));
      expected += along[i] * double{analytic[slot.offset + i]};
    }
    const auto at = [&](double distance) {
      std::vector<float> moved = start;
      for (uint64_t i = 0; i < slot.count; ++i) moved[slot.offset + i] = static_cast<float>(start[slot.offset + i] + distance * along[i]);
      return loss(moved);
    };
    const double step = std::min(1e-2, 4e-3 / length);  // rounding of the points leaves an error of some 1e-6 / step
    const double numeric = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step);
    std::printf("  %-14s differences % .5e  gradient % .5e\n", slot.name.c_str(), numeric, expected);
    EXPECT_NEAR(numeric, expected, 0.01 * std::abs(expected)) << slot.name;
  }
  EXPECT_EQ(tensors, 9u);
}

}  // namespace
}  // namespace arah
