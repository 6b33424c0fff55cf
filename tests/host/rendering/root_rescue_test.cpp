// What the rescue of points without a root finds are roots, each counted once.
#include "host/rendering/forward_skinning.h"
#include "host/rendering/root_finder.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class RootRescues : public DeviceTest {};

TEST_F(RootRescues, FindRootsWhereBroydenGivesUp) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  AvatarNetworks networks(device, avatar, false);
  TemplateOnDevice body(device, avatar.body);
  Pose pose = rest_pose(avatar.body.skeleton);
  pose.theta[1] = {0.0, 0.0, -1.9};  // folded: in the crease the search goes astray
  pose.theta[2] = {0.0, 0.0, -1.9};
  FrameOnDevice frame(device, avatar, body, pose, {});
  networks.record_pack(commands, 0, {});
  constexpr uint32_t points = 3000;
  RootFindingSettings settings;
  settings.rescue_steps = 30;
  PointRootFinder finder(device, networks, points, settings);
  std::vector<float> targets = uniform(4 * padded_points(points), 0, 1);
  for (uint32_t p = 0; p < padded_points(points); ++p) {
    for (size_t i = 0; i < 3; ++i) targets[4 * p + i] = frame.box().minimum[i] + targets[4 * p + i] * (frame.box().maximum[i] - frame.box().minimum[i]) - frame.root_translation()[i];
    targets[4 * p + 3] = p >= points || p % 7 == 3 ? 0.0f : 1.0f;
  }
  Buffer wanted = filled("targets", targets), roots = empty("roots", targets.size() * 4);
  const auto solve = [&](uint32_t steps) {
    settings.rescue_steps = steps;
    finder.reset_counts();
    finder.solve(commands, frame, points, wanted.slice(), roots.slice(), settings);
    return device.download<float>(roots.slice());
  };
  const std::vector<float> before = solve(0);
  const RootFindingCounts plain = finder.counts();
  const std::vector<float> after = solve(30);
  const RootFindingCounts counts = finder.counts();

  ForwardSkinning skinning(device, networks, padded_points(points), "test");
  skinning.record(commands, frame, {{points, {}}, {}}, roots.slice(), false);
  commands.submit_and_wait();
  const std::vector<float> posed = device.download<float>(skinning.posed());
  uint64_t rescued = 0;
  for (uint32_t p = 0; p < points; ++p) {
    if (before[4 * p + 3] > 0 || targets[4 * p + 3] == 0) {
      for (size_t k = 0; k < 4; ++k) EXPECT_EQ(after[4 * p + k], before[4 * p + k]) << "found already, or not wanted";
      continue;
    }
    if (after[4 * p + 3] <= 0) continue;
    ++rescued;
    EXPECT_LT(std::hypot(posed[4 * p] - targets[4 * p], posed[4 * p + 1] - targets[4 * p + 1], posed[4 * p + 2] - targets[4 * p + 2]), settings.tolerance * 1.1);
  }
  std::printf("  of %llu points %llu found without, %llu with a rescue: %llu from the best place, %llu from bones, %llu evaluations\n", static_cast<unsigned long long>(counts.points), static_cast<unsigned long long>(plain.converged),
              static_cast<unsigned long long>(counts.converged), static_cast<unsigned long long>(counts.newton), static_cast<unsigned long long>(counts.restarted), static_cast<unsigned long long>(counts.rescue_evaluations));
  EXPECT_GT(rescued, 10u);
  EXPECT_GT(counts.newton, 0u);
  EXPECT_GT(counts.restarted, 0u);
  EXPECT_EQ(counts.newton + counts.restarted, rescued);
  EXPECT_EQ(counts.converged, plain.converged + rescued);
  EXPECT_EQ(counts.points, plain.points);
  EXPECT_EQ(counts.points, counts.converged + counts.diverged + counts.exhausted);
  EXPECT_EQ(plain.newton + plain.restarted + plain.rescue_evaluations, 0u);
  EXPECT_EQ(solve(30), after) << "same bits";

  PointRootFinder without_room(device, networks, points);
  EXPECT_THROW(without_room.solve(commands, frame, points, wanted.slice(), roots.slice(), settings), std::invalid_argument);
}

}  // namespace
}  // namespace arah
