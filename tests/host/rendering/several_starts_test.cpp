// Searches from several starts: what one start finds is found, and where parts of the body meet, the part that is inside.
#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "kernels/tracing/normalise_inputs.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class SeveralStartsOfAvatars : public DeviceTest {
 protected:
  // Bent so far that its ends come near each other: some points have a root in both.
  static Pose folded_pose(const Skeleton& skeleton) {
    Pose pose = rest_pose(skeleton);
    pose.theta[1] = {0.0, 0.0, -1.3};
    pose.theta[2] = {0.0, 0.0, -1.3};
    return pose;
  }
};

TEST_F(SeveralStartsOfAvatars, FindAllThatOneFindsAndTheLeastDistance) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  AvatarNetworks networks(device, avatar, false);
  TemplateOnDevice body(device, avatar.body);
  const Pose pose = folded_pose(avatar.body.skeleton);
  FrameOnDevice frame(device, avatar, body, pose, {});
  networks.record_pack(commands, 0, {});
  constexpr uint32_t points = 3000;
  RootFindingSettings most;
  most.initialisations = 4;
  PointRootFinder finder(device, networks, points, most);
  // Over the posed body's box.
  std::vector<float> targets = uniform(4 * padded_points(points), 0, 1);
  for (uint32_t p = 0; p < padded_points(points); ++p) {
    for (size_t i = 0; i < 3; ++i) targets[4 * p + i] = frame.box().minimum[i] + targets[4 * p + i] * (frame.box().maximum[i] - frame.box().minimum[i]) - frame.root_translation()[i];
    targets[4 * p + 3] = p >= points || p % 7 == 3 ? 0.0f : p % 7 == 4 ? -1.0f : 1.0f;  // not wanted; EMPTY
  }
  Buffer wanted = filled("targets", targets), roots = empty("roots", targets.size() * 4);
  SirenTape tape(device, "sdf", networks.sdf_shape(), points, SirenTape::Holds::values);
  struct Result {
    std::vector<float> roots, sdf;
    RootFindingCounts counts;
  };
  const auto solve = [&](uint32_t starts) {
    RootFindingSettings settings;
    settings.initialisations = starts;
    finder.reset_counts();
    finder.solve(commands, frame, points, wanted.slice(), roots.slice(), settings);
    Result result{device.download<float>(roots.slice()), {}, finder.counts()};
    const Rows rows{{points, {}}, {}};
    record_normalise_inputs(commands, {rows, frame.constants(), roots.slice(), tape.input()});
    networks.sdf().record_forward(commands, tape, rows.range, false);
    commands.submit_and_wait();
    const Matrix sdf = tape.sdf();
    const std::vector<float> all = device.download<float>(sdf.slice);
    for (uint32_t p = 0; p < points; ++p) result.sdf.push_back(all[size_t(p) * sdf.stride + sdf.column]);
    return result;
  };
  const Result one = solve(1), three = solve(3), four = solve(4);
  uint32_t gained = 0, nearer = 0;
  for (uint32_t p = 0; p < points; ++p) {
    const float w = one.roots[4 * p + 3], w3 = three.roots[4 * p + 3];
    if (p % 7 == 3 || p % 7 == 4) {
      EXPECT_EQ(w, p % 7 == 3 ? 0.0f : -1.0f);
      EXPECT_EQ(w3, w) << "not searched, whatever the starts";
      continue;
    }
    EXPECT_GE(w3, w) << p;
    gained += w3 > w;
    if (w <= 0) continue;
    EXPECT_LE(three.sdf[p], one.sdf[p] + 1e-5f) << p;
    EXPECT_LE(four.sdf[p], three.sdf[p] + 1e-5f) << p;
    nearer += three.sdf[p] < one.sdf[p] - 1e-2f;
  }
  std::printf("  %llu of %llu points found from one start, %llu from three, %llu from four; %u lie on another part; %.1f, %.1f and %.1f steps a point\n",
              static_cast<unsigned long long>(one.counts.converged), static_cast<unsigned long long>(one.counts.points), static_cast<unsigned long long>(three.counts.converged),
              static_cast<unsigned long long>(four.counts.converged), nearer, double(one.counts.steps) / double(one.counts.points), double(three.counts.steps) / double(three.counts.points),
              double(four.counts.steps) / double(four.counts.points));
  EXPECT_EQ(three.counts.points, one.counts.points);
  EXPECT_EQ(three.counts.converged, one.counts.converged + gained);
  EXPECT_EQ(three.counts.points, three.counts.converged + three.counts.diverged + three.counts.exhausted);
  EXPECT_GT(nearer, 0u) << "or nothing was tested";
  EXPECT_EQ(solve(1).roots, one.roots);

  PointRootFinder of_one(device, networks, points);
  RootFindingSettings settings;
  settings.initialisations = 2;
  EXPECT_THROW(of_one.solve(commands, frame, points, wanted.slice(), roots.slice(), settings), std::invalid_argument);
}

// In a pose whose parts do not meet, a picture is the same (the paper: no noticeable change), to what another root within the
// tolerance of 1e-5 m can do in b = 2 mm.
TEST_F(SeveralStartsOfAvatars, ShowTheSamePictureOfABodyThatDoesNotTouchItself) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const auto picture = [&](const char* starts) {
    RenderSettings settings = render_preset(avatar, "paper");
    set_render_knob(settings, "root_initialisations", starts);
    Renderer renderer(device, avatar, settings);
    return renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
  };
  const Picture one = picture("1"), three = picture("3");
  double squares = 0;
  for (size_t i = 0; i < one.color.size(); ++i) squares += std::pow(double(one.color[i]) - three.color[i], 2);
  const double difference = std::sqrt(squares / double(one.color.size()));
  std::printf("  colours differ by %.2e in the mean of squares\n", difference);
  EXPECT_LT(difference, 2e-3);
  RenderSettings settings = render_preset(avatar, "paper");
  for (const char* starts : {"0", "9", "1.5", "many"}) EXPECT_THROW(set_render_knob(settings, "root_initialisations", starts), InputError) << starts;
}

}  // namespace
}  // namespace arah
