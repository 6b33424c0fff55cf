// Training the paper's way: samples around the surface, normals and view as colour inputs, a step in one pass or several.
#include <cmath>

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

}  // namespace
}  // namespace arah
