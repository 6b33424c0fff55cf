// The ablation without a surface: a canonical density learns colours and masks, needs no terms that keep a distance, and what
// asks for a surface is refused.
#include <gmock/gmock.h>

#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "host/training/trainer.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

class DensityField : public DeviceTest {
 protected:
  static AvatarSpec spec() {
    AvatarSpec spec = small_spec();
    spec.sdf.kind = FieldKind::density;
    spec.color.normal = true;
    return spec;
  }
};

TEST_F(DensityField, LearnsPicturesWithoutASurface) {
  Avatar avatar = make_avatar(spec(), small_capture(), 3);
  TrainingSettings settings = small_settings();
  settings.rays = 128;
  settings.sampling.samples = 16;
  settings.sdf = {.rate = 5e-4};
  settings.color = {.rate = 5e-3};
  settings.fit_steps = 100;
  settings.skinning_every = 0;
  settings.deviation = {};
  settings.end_fraction = 1;
  fit_template(device, avatar, settings);
  Trainer trainer(device, small_capture(), avatar, settings);
  constexpr int steps = 120, part = 30;
  double first_color = 0, last_color = 0, first_alpha = 0, last_alpha = 0;
  for (int step = 0; step < steps; ++step) {
    const StepReport report = trainer.step(static_cast<uint64_t>(steps - step));
    ASSERT_EQ(report.eikonal, 0);
    ASSERT_EQ(report.off_surface, 0);
    ASSERT_EQ(report.inside, 0);
    ASSERT_DOUBLE_EQ(report.total, settings.color_weight * report.color + settings.alpha_weight * report.alpha);
    if (step < part) first_color += report.color / part, first_alpha += report.alpha / part;
    if (step >= steps - part) last_color += report.color / part, last_alpha += report.alpha / part;
  }
  std::printf("  colour %.4f to %.4f, mask %.4f to %.4f\n", first_color, last_color, first_alpha, last_alpha);
  // By a fifth in as many steps, as with distances in this scene; the mean of 30 steps varies by some 3 %.
  EXPECT_LT(last_color, 0.87 * first_color);
  EXPECT_LT(last_alpha, 0.87 * first_alpha);

  // It is drawn from the shell, exactly and with the approximations that need no surface; the others say what they lack.
  const Avatar trained = trainer.avatar();
  const Camera camera = small_capture().cameras[0].scaled(32);
  const MotionFrame& frame = motion_of(small_capture(), "train").frames.front();
  const auto picture = [&](const RenderSettings& render) { return Renderer(device, trained, render).render(camera, frame.pose, 0); };
  const Picture exact = picture(render_preset(trained, "paper")), balanced = picture(render_preset(trained, "balanced"));
  double shown = 0, apart = 0;
  for (size_t i = 0; i < exact.alpha.size(); ++i) shown = std::max(shown, double{exact.alpha[i]}), apart += std::abs(double{exact.alpha[i]} - double{balanced.alpha[i]}) / double(exact.alpha.size());
  EXPECT_GT(shown, 0.9);
  EXPECT_LT(apart, 0.02);
  const auto refused = [&](const RenderSettings& render) {
    try {
      picture(render);
      ADD_FAILURE() << "drawn: " << render_settings_json(render);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("sdf.kind density"));
    }
  };
  refused(render_preset(trained, "preview"));
  RenderSettings render = render_preset(trained, "paper");
  set_render_knob(render, "distances", "baked");
  refused(render);
  render = render_preset(trained, "paper");
  set_render_knob(render, "samples", "64");
  set_render_knob(render, "sampling_mode", "surface");
  refused(render);
}

TEST_F(DensityField, IsNotSampledAroundSurfaces) {
  TrainingSettings settings = small_settings();
  settings.sampling.mode = SamplingMode::surface;
  settings.sampling.samples = 40;
  const Avatar avatar = make_avatar(spec(), small_capture(), 3);
  try {
    Trainer(device, small_capture(), avatar, settings);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("density"));
  }
}

}  // namespace
}  // namespace arah
