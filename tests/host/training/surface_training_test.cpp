// Training by surface rendering: one colour a ray where it hits the surface, and the mask loss of the rays that miss it or the
// person.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "host/input_error.h"
#include "host/training/trainer.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

class SurfaceTraining : public DeviceTest {
 protected:
  static TrainingSettings settings() {
    TrainingSettings s = small_settings();
    s.rendering = Rendering::surface;
    s.rays = 130;
    s.mask_samples = 30;
    s.skinning_every = 2;
    s.sdf = {.rate = 1e-4, .max_norm = 10};
    s.mapping.rate = 1e-6;
    s.fit_steps = s.fit_skinning_steps = 60;
    return s;
  }
  // The colour network takes a normal in one of them: then the field's gradient is there already.
  const Avatar& fitted(bool normal = false) {
    static std::map<bool, Avatar> avatars;
    const auto [found, made] = avatars.try_emplace(normal);
    if (made) {
      AvatarSpec spec = small_spec();
      spec.color.normal = normal;
      found->second = make_avatar(spec, small_capture(), 3);
      fit_template(device, found->second, settings());
    }
    return found->second;
  }
  static std::vector<StepReport> train(Trainer& trainer, uint64_t until, uint64_t steps) {
    std::vector<StepReport> reports;
    while (trainer.steps_done() < until) reports.push_back(trainer.step(steps - trainer.steps_done()));
    return reports;
  }
  static std::vector<float> parameters(Trainer& trainer) { return trainer.checkpoint().tensors.at("optimizer.parameters").as<float>(); }
};

TEST_F(SurfaceTraining, LearnsColoursAndOutline) {
  TrainingSettings s = settings();
  s.color.rate = 5e-3;
  s.sdf.rate = 3e-4;
  s.clothing = 0.04;  // so that the outline has something to learn
  Avatar wide = make_avatar(small_spec(), small_capture(), 3);
  fit_template(device, wide, s);
  Trainer trainer(device, small_capture(), std::move(wide), s);
  constexpr uint64_t steps = 60, some = 12;
  const std::vector<StepReport> reports = train(trainer, steps, steps);
  StepReport before, after;
  for (size_t i = 0; i < some; ++i) {
    before.color += reports[i].color / some, after.color += reports[steps - 1 - i].color / some;
    before.mask += reports[i].mask / some, after.mask += reports[steps - 1 - i].mask / some;
    before.shaded += reports[i].shaded / some, after.shaded += reports[steps - 1 - i].shaded / some;
  }
  std::printf("  colour loss %.4f, then %.4f; mask loss %.5f, then %.5f; alpha %.4f; %.2f of the rays hit the surface, then %.2f\n", before.color, after.color, before.mask, after.mask,
              reports.back().mask_alpha, before.shaded, after.shaded);
  EXPECT_LT(after.color, 0.9 * before.color);
  EXPECT_LT(after.mask, 0.9 * before.mask);
  EXPECT_GT(after.shaded, 0.5) << "those at the person do";
  EXPECT_GT(reports.back().mask_alpha, s.mask_alpha);
  EXPECT_EQ(reports.back().b, reports.front().b) << "no density, no scale of it";
  for (const StepReport& r : reports) EXPECT_EQ(r.alpha, 0);
}

TEST_F(SurfaceTraining, EveryNetworkLearns) {
  TrainingSettings s = settings();
  s.skinning_every = 1;
  s.skinning_weight = 0;  // the skinning network has nothing else to learn from than the implicit gradients
  Trainer trainer(device, small_capture(), fitted(), s);
  trainer.step(1);
  const std::vector<float> moments = trainer.checkpoint().tensors.at("optimizer.first_moments").as<float>();
  for (const ParameterGroup& group : fitted().layout.groups) {
    const bool learns = std::any_of(moments.begin() + static_cast<ptrdiff_t>(group.begin), moments.begin() + static_cast<ptrdiff_t>(group.end), [](float m) { return m != 0; });
    EXPECT_EQ(learns, group.size() > 0 && group.name != "deviation") << group.name;
  }
}

TEST_F(SurfaceTraining, RepeatsAndContinuesBitForBit) {
  const auto make = [&] { return Trainer(device, small_capture(), fitted(), settings()); };
  Trainer whole = make();
  const std::vector<StepReport> reports = train(whole, 8, 8);
  const std::filesystem::path path = small_capture().path / "surface.safetensors";
  Trainer first = make();
  train(first, 5, 8);
  write_safetensors(path, first.checkpoint());
  Trainer second = make();
  second.resume(read_safetensors(path));
  const std::vector<StepReport> continued = train(second, 8, 8);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(continued[i].color, reports[5 + i].color);
    EXPECT_EQ(continued[i].mask, reports[5 + i].mask);
    EXPECT_EQ(continued[i].mask_alpha, reports[5 + i].mask_alpha);
  }
  EXPECT_EQ(parameters(second), parameters(whole));
  EXPECT_EQ(second.checkpoint().at("training.mask_alpha").as<double>(), whole.checkpoint().at("training.mask_alpha").as<double>());

  TrainingSettings volume = settings();
  volume.rendering = Rendering::volume;
  Trainer other(device, small_capture(), fitted(), volume);
  EXPECT_FALSE(other.checkpoint().tensors.contains("training.mask_alpha")) << "nothing of it where it is not wanted";
  EXPECT_THROW(make().resume(other.checkpoint()), InputError);
}

// Three passes (64, 64 and 2 rays), and rays of the mask loss 64 at a time, are the same step up to rounding, with rays drawn by
// importance too.
TEST_F(SurfaceTraining, PassesAddUpToTheStep) {
  std::vector<StepReport> reports;
  std::vector<std::vector<float>> gradients;
  for (const uint32_t rays_at_a_time : {0u, 50u}) {
    TrainingSettings s = settings();
    s.skinning_every = 1;
    s.ray_importance = 0.3;
    s.rays_at_a_time = rays_at_a_time;
    Trainer trainer(device, small_capture(), fitted(true), s);
    reports.push_back(trainer.step(1));
    gradients.push_back(trainer.checkpoint().tensors.at("optimizer.first_moments").as<float>());
  }
  EXPECT_EQ(reports[0].passes, 1u);
  EXPECT_EQ(reports[1].passes, 3u);
  EXPECT_NEAR(reports[1].color, reports[0].color, 2e-6 * reports[0].color);
  EXPECT_NEAR(reports[1].mask, reports[0].mask, 2e-6 * reports[0].mask);
  double difference = 0, length = 0;
  for (size_t i = 0; i < gradients[0].size(); ++i) {
    difference += std::pow(double(gradients[0][i]) - gradients[1][i], 2);
    length += std::pow(double(gradients[0][i]), 2);
  }
  std::printf("  gradients differ by %.1e of their length\n", std::sqrt(difference / length));
  EXPECT_LT(std::sqrt(difference / length), 1e-5);
}

// Without a skinning network the nearest vertex moves a point.
TEST_F(SurfaceTraining, NeedsNoSkinningNetwork) {
  AvatarSpec spec = small_spec();
  spec.skinning = {Skinning::template_weights, 0, 0};
  Avatar avatar = make_avatar(spec, small_capture(), 3);
  fit_template(device, avatar, settings());
  Trainer trainer(device, small_capture(), std::move(avatar), settings());
  const std::vector<StepReport> reports = train(trainer, 4, 4);
  for (const StepReport& r : reports) {
    EXPECT_GT(r.color, 0);
    EXPECT_GT(r.mask, 0);
    EXPECT_GT(r.shaded, 0.2);
  }
}

// Of several roots the one with the least distance counts; where the body does not touch itself there is but one, and the step is
// the same to the searches' tolerance.
TEST_F(SurfaceTraining, SeveralStartsOfASearchMakeTheSameStep) {
  for (const Rendering rendering : {Rendering::volume, Rendering::surface}) {
    StepReport reports[2];
    for (const uint32_t starts : {1u, 3u}) {
      TrainingSettings s = settings();
      s.rendering = rendering;
      s.sampling.root.tolerance = 1e-5f;
      s.sampling.root.initialisations = starts;
      Trainer trainer(device, small_capture(), fitted(), s);
      reports[starts > 1] = trainer.step(1);
    }
    std::printf("  %s: colour %.6f and %.6f, mask %.6f and %.6f, found %.4f and %.4f\n", to_string(rendering), reports[0].color, reports[1].color, reports[0].mask, reports[1].mask,
                reports[0].converged, reports[1].converged);
    EXPECT_NEAR(reports[1].color, reports[0].color, 1e-2 * reports[0].color);
    EXPECT_NEAR(reports[1].mask, reports[0].mask, 1e-2 * reports[0].mask);
    EXPECT_GE(reports[1].converged, reports[0].converged);
  }
}

// The paper's other ablation: samples evenly over the ray's part in the box.
TEST_F(SurfaceTraining, UniformSamplesLearnTheColours) {
  TrainingSettings s = settings();
  s.rendering = Rendering::volume;
  s.sampling.mode = SamplingMode::uniform;
  s.sampling.samples = 64;
  s.color.rate = 5e-3;
  s.least_weight = 1e-3;
  Trainer trainer(device, small_capture(), fitted(), s);
  constexpr uint64_t steps = 60, some = 12;
  const std::vector<StepReport> reports = train(trainer, steps, steps);
  double before = 0, after = 0;
  for (size_t i = 0; i < some; ++i) before += reports[i].color / some, after += reports[steps - 1 - i].color / some;
  std::printf("  colour loss %.4f, then %.4f; %.3f of the samples shaded\n", before, after, reports.back().shaded);
  EXPECT_LT(after, 0.9 * before);
}

}  // namespace
}  // namespace arah
