// Training the paper's way: samples around the surface, normals and view as colour inputs, a step in one pass or several.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/avatar/spec_choice.h"
#include "host/rendering/field.h"
#include "host/rendering/frame_on_device.h"
#include "host/training/trainer.h"
#include "tests/host/rendering/capsule_scene.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

class PaperTraining : public DeviceTest {
 protected:
  static TrainingSettings settings() {
    TrainingSettings s = small_settings();
    s.rays = 130;
    s.sampling.mode = SamplingMode::surface;
    s.sampling.samples = 37;
    s.skinning_every = 1;
    s.sdf = {.rate = 1e-4, .max_norm = 10};
    s.fit_steps = s.fit_skinning_steps = 60;
    return s;
  }
  const Avatar& fitted() {
    static const Avatar avatar = [&] {
      Avatar made = make_avatar(small_paper_spec(), small_capture(), 3);
      fit_template(device, made, settings());
      return made;
    }();
    return avatar;
  }
};

// Three passes (64, 64 and 2 rays), whether asked for or because more samples are shaded than there is room for, draw the same
// samples as one and add up to the same step, but for the order of sums.
TEST_F(PaperTraining, PassesAddUpToTheStep) {
  Avatar avatar = fitted();
  avatar.tensor("b")[0] = 0.1f;  // metres: all samples of a ray have weight
  std::vector<StepReport> reports;
  std::vector<std::vector<float>> gradients;
  for (const auto& [rays_at_a_time, shaded_at_a_time] : {std::pair{0u, 0u}, {50u, 0u}, {0u, 1u}}) {
    TrainingSettings s = settings();
    s.least_weight = 0;
    // So that most samples lie in the shell.
    s.mask_fraction = 1;
    s.sampling.around_surface = 31, s.sampling.before_surface = 6;
    s.rays_at_a_time = rays_at_a_time;
    s.shaded_at_a_time = shaded_at_a_time;
    Trainer trainer(device, small_capture(), avatar, s);
    reports.push_back(trainer.step(1));
    gradients.push_back(trainer.checkpoint().tensors.at("optimizer.first_moments").as<float>());
  }
  EXPECT_EQ(reports[0].passes, 1u);
  for (const size_t other : {1, 2}) {
    EXPECT_EQ(reports[other].passes, 3u);
    const auto near = [&](const char* what, double one, double three) {
      std::printf("  %-12s one pass %.7g, three %.7g\n", what, one, three);
      EXPECT_NEAR(one, three, 2e-6 * std::abs(one)) << what;
    };
    near("colour", reports[0].color, reports[other].color);
    near("alpha", reports[0].alpha, reports[other].alpha);
    near("total", reports[0].total, reports[other].total);
    EXPECT_EQ(reports[0].converged, reports[other].converged);
    EXPECT_EQ(reports[0].shaded, reports[other].shaded);
    EXPECT_GT(reports[0].converged, 0.8);
    // After the first step Adam's first moments are a tenth of the gradients.
    double difference = 0, length = 0;
    for (size_t i = 0; i < gradients[0].size(); ++i) {
      difference += std::pow(double(gradients[0][i]) - gradients[other][i], 2);
      length += std::pow(double(gradients[0][i]), 2);
    }
    std::printf("  gradients differ by %.1e of their length\n", std::sqrt(difference / length));
    EXPECT_GT(length, 0);
    EXPECT_LT(std::sqrt(difference / length), 1e-5);
  }
}

TEST_F(PaperTraining, LearnsTheColours) {
  TrainingSettings s = settings();
  s.color.rate = 5e-3;
  Trainer trainer(device, small_capture(), fitted(), s);
  constexpr uint64_t steps = 14;
  std::vector<double> colors;
  for (uint64_t step = 0; step < steps; ++step) colors.push_back(trainer.step(steps - step).color);
  double before = 0, after = 0;
  for (size_t i = 0; i < 4; ++i) before += colors[i] / 4, after += colors[steps - 4 + i] / 4;
  std::printf("  colour loss over the first four steps %.4f, over the last %.4f\n", before, after);
  EXPECT_LT(after, 0.9 * before);
}

// With the released sizes, 85.6 million numbers of the hypernetwork from zero, a few steps of Adam can break the surface (ARAH.md,
// its end; docs/decisions/pose-conditioning.md). In the first 100 steps that the shape learns in it may move the surface by millimetres:
// 1.3 and 1.7 mm at the presets' rate from two seeds, 11 mm at the released one, which is ten times as high. The pictures are small and the rays few, and
// colours learn alone for 100 steps before instead of 200.
TEST_F(PaperTraining, ThePapersHypernetworkKeepsTheSurface) {
  const AvatarSpec spec = choose_spec("paper", capture_facts(small_capture())).spec;
  ASSERT_EQ(spec.sdf.pose, PoseConditioning::hypernetwork);
  TrainingSettings s = preset_settings("paper");
  s.rays = 128;
  s.eikonal_points = s.off_surface_points = s.inside_points = s.skinning_points = 128;
  s.fit_steps = s.fit_skinning_steps = 120;
  s.fit_rate = 5e-4;
  Avatar avatar = make_avatar(spec, small_capture(), 3);
  const TemplateFit fit = fit_template(device, avatar, s);
  s.average_decay = 0;
  for (GroupSettings* group : {&s.sdf, &s.mapping, &s.deviation, &s.pose_code, &s.hyper, &s.hyper_last}) {
    ASSERT_EQ(group->freeze, 200u);
    group->freeze = 100;
  }
  // Of the rays of the same 25 steps, which learn nothing.
  const auto hits = [&](const Avatar& of) {
    TrainingSettings still = s;
    for (GroupSettings* group : {&still.sdf, &still.mapping, &still.skinning, &still.color, &still.latent, &still.deviation, &still.pose_code, &still.hyper, &still.hyper_last}) group->freeze = 1000;
    still.pose_noise = 0;
    Trainer measuring(device, small_capture(), of, still);
    double sum = 0;
    for (int step = 0; step < 25; ++step) sum += measuring.step(1000).hits / 25;
    return sum;
  };
  // In the pose of a frame, at the template's vertices, metres.
  const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  const Pose& pose = motion_of(small_capture(), "train").frames[0].pose;
  const auto distances = [&](const Avatar& of) {
    AvatarNetworks networks(device, of, false);
    TemplateOnDevice body(device, of.body);
    FrameOnDevice frame(device, of, body, pose, {});
    const auto count = static_cast<uint32_t>(vertices.size());
    Field field(device, networks, count, 1, {.capacity = point_padding}, false);
    networks.record_pack(commands, 0, pose_input(of, pose));
    std::vector<std::array<float, 4>> points(padded_points(count), {0, 0, 0, 0});
    for (uint32_t i = 0; i < count; ++i) points[i] = {static_cast<float>(vertices[i].x), static_cast<float>(vertices[i].y), static_cast<float>(vertices[i].z), 1};
    Buffer rows = filled("points", points);
    const Matrix answer = field.record_distances(commands, frame.constants(), rows.slice(), count, false);
    commands.submit_and_wait();
    const std::vector<float> values = device.download<float>(answer.slice.elements(0, uint64_t(count) * answer.stride));
    std::vector<double> metres(count);
    for (uint32_t i = 0; i < count; ++i) metres[i] = of.cube.metres_per_unit() * double{values[i * answer.stride + answer.column]};
    return metres;
  };
  const auto moved = [&](const Avatar& from, const Avatar& to) {
    const std::vector<double> a = distances(from), b = distances(to);
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += std::abs(b[i] - a[i]);
    return sum / double(a.size());
  };

  Trainer trainer(device, small_capture(), avatar, s);
  const auto train = [&] {
    for (int step = 0; step < 100; ++step) trainer.step(10000 - trainer.steps_done());
    return trainer.avatar();
  };
  const Avatar colored = train(), trained = train();
  Avatar alone = trained;  // the shape without what the hypernetwork has learned
  for (size_t layer = 0; alone.layout.has(fmt::format("hyper_last.{}.W", layer)); ++layer)
    for (const char* part : {"W", "b"}) std::ranges::fill(alone.tensor(fmt::format("hyper_last.{}.{}", layer, part)), 0.0f);
  const double by_all = moved(colored, trained), by_hypernetwork = moved(alone, trained), before = hits(colored), after = hits(trained);
  std::printf("  fitted: sdf %.2f mm; 100 steps of the shape move the surface by %.3f mm, the hypernetwork by %.3f; %.4f of the rays on the person hit it before, %.4f after\n", 1000 * fit.sdf_error, 1000 * by_all, 1000 * by_hypernetwork, before, after);
  EXPECT_GT(by_hypernetwork, 0) << "the hypernetwork learns from the start";
  EXPECT_LT(by_hypernetwork, 0.004);
  // A collapse leaves a third of them. So few rays move the whole surface by a centimetre, with which 7 in 100 were lost at the most and
  // a few found, from seed to seed and from one rounding of the losses to another.
  EXPECT_GT(before, 0.9) << "else there is little to lose";
  EXPECT_GT(after, before - 0.1);
}

}  // namespace
}  // namespace arah
