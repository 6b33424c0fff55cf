// Trainings that must go wrong, or nearly: b at the lower end of what it may be, and learning rates a hundred and many times too large.
// Either every number stays finite, or training ends with an error that names the first that is not, before it is written anywhere.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "host/training/training_run.h"
#include "tests/host/body/rigs.h"
#include "tests/host/training/finite_run.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;

// Every rate of a training.
TrainingSettings with_rates_times(double factor, TrainingSettings settings = small_settings()) {
  for (GroupSettings* group : {&settings.sdf, &settings.mapping, &settings.skinning, &settings.color, &settings.latent, &settings.deviation, &settings.grid, &settings.pose_code, &settings.hyper, &settings.low_rank,
                               &settings.hyper_last, &settings.poses, &settings.shape})
    group->rate *= factor;
  settings.mask_alpha_rate *= factor;
  return settings;
}

TrainingSettings with_fit_rates_too(double factor) {
  TrainingSettings settings = with_rates_times(factor);
  settings.fit_rate *= factor;
  settings.fit_skinning_rate *= factor;
  return settings;
}

class ExtremeSettings : public DeviceTest {
 protected:
  // Trains with a checkpoint after every step, and looks through all of them.
  void expect_finite_or_named(const std::string& name, const AvatarSpec& spec, TrainingSettings settings, uint64_t steps) {
    SCOPED_TRACE(name);
    settings.steps = steps;
    settings.checkpoint_minutes = 1e-9;
    const TemporaryFolder folder;
    RunOptions options;
    options.folder = folder / "run";
    const RunFolder run(options.folder);
    uint64_t taken = 0, checkpoints = 0;
    double least_b = INFINITY, most = 0;
    std::string error;
    try {
      run_training(device, small_capture(), make_run_config(small_capture(), settings, spec), options, [&](const RunEvent& event) {
        if (event.kind == RunEvent::Kind::step) {
          taken = event.step.step;
          const StepReport& r = event.step;
          for (const double number : {r.color, r.alpha, r.mask, r.mask_alpha, r.eikonal, r.off_surface, r.inside, r.skinning, r.parameters, r.total, r.sdf_norm, r.b, r.converged, r.hits, r.shaded}) {
            EXPECT_TRUE(std::isfinite(number)) << "step " << taken;
            most = std::max(most, std::abs(number));
          }
          least_b = std::min(least_b, r.b);
        }
        if (event.kind == RunEvent::Kind::fitted) {
          EXPECT_TRUE(std::isfinite(event.fit.sdf_error) && std::isfinite(event.fit.skinning_error));
        }
        if (event.kind == RunEvent::Kind::checkpoint) {
          checkpoints += 1;
          EXPECT_THAT(tensors_not_finite(read_safetensors(event.file)), IsEmpty()) << event.file;
          EXPECT_THAT(tensors_not_finite(read_safetensors(run.avatar_file())), IsEmpty()) << "step " << taken;
        }
        return true;
      });
    } catch (const std::runtime_error& found) {
      error = found.what();
    }
    std::printf("  %-28s %2zu steps, %2zu checkpoints, least b %.3g m, largest number %.3g%s%s\n", name.c_str(), size_t(taken), size_t(checkpoints), least_b, most, error.empty() ? "" : ": ", error.c_str());
    std::fflush(stdout);
    if (fs::exists(run.events_file())) {
      EXPECT_THAT(events_not_finite(run), IsEmpty());
    }
    if (error.empty()) {
      EXPECT_EQ(taken, steps);
      EXPECT_EQ(checkpoints, steps + 1);
    } else {
      EXPECT_THAT(error, HasSubstr("stage '"));
    }
    if (taken == 0) return;
    const Avatar avatar = load_avatar(run.avatar_file());
    const Picture picture = Renderer(device, avatar, RenderSettings{}).render(small_capture().cameras[0].scaled(24), motion_of(small_capture(), "train").frames[0].pose, 0);
    for (const auto* layer : {&picture.color, &picture.alpha, &picture.depth}) {
      EXPECT_TRUE(std::ranges::all_of(*layer, [](float value) { return std::isfinite(value); })) << "a picture";
    }
  }
};

TEST_F(ExtremeSettings, BAtItsLowerBound) {
  AvatarSpec spec = small_spec();
  spec.b_init = 1e-6;
  for (const double factor : {1.0, 1e2}) expect_finite_or_named(fmt::format("b = 1e-6 m, rates x {}", factor), spec, with_rates_times(factor), 40);
}

TEST_F(ExtremeSettings, RatesManyTimesTooLarge) {
  for (const double factor : {1e2, 1e4}) expect_finite_or_named(fmt::format("rates x {}", factor), small_spec(), with_rates_times(factor), 40);
}

// Where one step could end beyond float32's numbers, training does not begin.
TEST_F(ExtremeSettings, RatesBeyondAllMeaningAreRefused) {
  const TemporaryFolder folder;
  const auto refusal = [&](const TrainingSettings& settings) {
    RunOptions options;
    options.folder = folder / "run";
    try {
      run_training(device, small_capture(), make_run_config(small_capture(), settings, small_spec()), options);
    } catch (const InputError& error) {
      EXPECT_FALSE(fs::exists(options.folder));
      return std::string(error.what());
    }
    return std::string("none");
  };
  for (const double factor : {1e8, 1e38, 1e300, -1.0, double{NAN}}) EXPECT_THAT(refusal(with_rates_times(factor)), HasSubstr("rate: expected a rate from 0 to 1000")) << factor;
  TrainingSettings settings = small_settings();
  settings.deviation = {.rate = 0.1, .weight_decay = 11};
  EXPECT_THAT(refusal(settings), HasSubstr("deviation.weight_decay: expected from 0 to 1 / rate"));
  settings = small_settings();
  settings.fit_rate = INFINITY;
  EXPECT_THAT(refusal(settings), HasSubstr("fit_rate"));
}

TEST_F(ExtremeSettings, RatesOfTheFitManyTimesTooLarge) {
  for (const double factor : {1e2, 1e4}) expect_finite_or_named(fmt::format("with the fit's x {}", factor), small_spec(), with_fit_rates_too(factor), 40);
  // By itself it says so too.
  for (const bool skinning : {false, true}) {
    TrainingSettings settings = small_settings();
    (skinning ? settings.fit_skinning_rate : settings.fit_rate) = 1e36;
    Avatar avatar = make_avatar(small_spec(), small_capture(), 3);
    std::string error = "none";
    try {
      fit_template(device, avatar, settings);
    } catch (const std::runtime_error& found) {
      error = found.what();
    }
    std::printf("  %s\n", error.c_str());
    EXPECT_THAT(error, HasSubstr(skinning ? "skinning network are NaN or infinite" : "SDF are NaN or infinite"));
    EXPECT_THAT(error, HasSubstr(skinning ? "fit_skinning_rate" : "fit_rate"));
  }
}

}  // namespace
}  // namespace arah
