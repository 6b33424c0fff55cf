// A number that is not what it should be stops training in the step where it first appears, by name and place; what is kept of the
// step repeats it; and where that is wanted, training goes on without such steps and counts them.
#include "host/training/bad_values.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/training/trainer.h"
#include "host/training/training_run.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

using testing::HasSubstr;

class BadValuesTest : public DeviceTest {
 protected:
  const Avatar& fitted() {
    static const Avatar avatar = [&] {
      Avatar made = make_avatar(small_spec(), small_capture(), 3);
      fit_template(device, made, small_settings());
      return made;
    }();
    return avatar;
  }
  Trainer trainer(const TrainingSettings& settings = small_settings()) { return Trainer(device, small_capture(), fitted(), settings); }

  // The checkpoint with these numbers of a tensor, all of them for `count` 0, set to `value`.
  SafetensorsFile poisoned(SafetensorsFile file, const std::string& tensor, uint64_t first, uint64_t count, float value) {
    std::vector<float> parameters = file.tensors.at("optimizer.parameters").as<float>();
    const TensorSlot& slot = fitted().layout.slot(tensor);
    for (uint64_t i = first; i < (count ? first + count : slot.count); ++i) parameters.at(slot.offset + i) = value;
    file.tensors["optimizer.parameters"] = Tensor::from<float>({static_cast<int64_t>(parameters.size())}, parameters);
    return file;
  }
  static std::vector<float> parameters(Trainer& trainer) { return trainer.checkpoint().tensors.at("optimizer.parameters").as<float>(); }
  static bool same_bits(const std::vector<float>& a, const std::vector<float>& b) { return a.size() == b.size() && std::memcmp(a.data(), b.data(), 4 * a.size()) == 0; }

  // Errors by cell that rays by importance go by, those of cells that were not seen yet apart.
  static std::vector<float> noted(Trainer& trainer) {
    std::vector<float> errors = trainer.checkpoint().tensors.at("training.ray_importance").as<float>();
    std::erase_if(errors, [](float error) { return error < 0; });
    return errors;
  }

  static std::optional<BadValues> failure_of(Trainer& trainer) {
    try {
      trainer.step(5);
    } catch (const BadValueError& error) {
      EXPECT_EQ(std::string(error.what()), describe(error.found()));
      return error.found();
    }
    return std::nullopt;
  }
};

TEST_F(BadValuesTest, TheFirstStageThatIsBadIsNamedAndWhatIsKeptRepeatsTheStep) {
  Trainer good = trainer();
  good.step(20);
  const SafetensorsFile start = good.checkpoint();
  struct Case {
    const char* tensor;
    float value;
    bool all;
    const char* stage;
    const char* found;
    const char* place;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const Case& c : {Case{"sdf.1.W", nan, false, "weights", "parameters", "number 0 of tensor 'sdf.1.W' of 24 x 24 in group 'sdf'"},
                        Case{"skinning.1.b", nan, false, "weights", "parameters", "tensor 'skinning.1.b'"},
                        Case{"sdf.2.b", 1e38f, false, "distances", "signed distances", "of ray"},
                        Case{"latent", 1e38f, true, "distances", "signed distances", "camera '"},
                        Case{"color.0.g", 3e38f, true, "shading", "colours", "channel"}}) {
    SCOPED_TRACE(c.tensor);
    const SafetensorsFile planted = poisoned(start, c.tensor, 0, c.all ? 0 : 1, c.value);
    Trainer broken = trainer();
    broken.resume(planted);
    const auto bad = failure_of(broken);
    ASSERT_TRUE(bad.has_value());
    std::printf("  %s\n", describe(*bad).c_str());
    EXPECT_EQ(bad->step, 2u);
    EXPECT_EQ(bad->tensors[0].stage, c.stage);
    EXPECT_EQ(bad->tensors[0].tensor, c.found);
    EXPECT_THAT(bad->tensors[0].place, HasSubstr(c.place));
    EXPECT_GT(bad->tensors[0].nan + bad->tensors[0].infinite + bad->tensors[0].beyond, 0u);
    EXPECT_EQ(bad->state, std::isnan(c.value));
    EXPECT_EQ(broken.steps_done(), 1u);
    const SafetensorsFile kept = broken.failure(*bad);
    EXPECT_TRUE(same_bits(kept.tensors.at("optimizer.parameters").as<float>(), planted.tensors.at("optimizer.parameters").as<float>())) << "the step was taken";
    for (const char* moments : {"optimizer.first_moments", "optimizer.second_moments", "optimizer.averages"})
      EXPECT_TRUE(same_bits(kept.tensors.at(moments).as<float>(), start.tensors.at(moments).as<float>())) << moments;

    const std::filesystem::path path = small_capture().path / "failure.safetensors";
    write_safetensors(path, kept);
    const SafetensorsFile read = read_safetensors(path);
    const auto again = bad_values_of(read);
    ASSERT_TRUE(again.has_value());
    EXPECT_EQ(describe(*again), describe(*bad));
    EXPECT_EQ(avatar_from_tensors(read).steps, 1u);
    EXPECT_THAT(bad_values_report(*again), HasSubstr("step 2"));
    EXPECT_THAT(bad_values_report(*again), HasSubstr(c.found));
    Trainer repeated = trainer();
    repeated.resume(read);
    const auto same = failure_of(repeated);
    ASSERT_TRUE(same.has_value());
    EXPECT_EQ(describe(*same), describe(*bad));
    EXPECT_EQ(same->searches, bad->searches);
  }
}

// Finite numbers whose gradient is too large for its norm: Adam would leave out the group without a word.
TEST_F(BadValuesTest, AGradientWhoseNormOverflowsIsBad) {
  TrainingSettings settings = small_settings();
  settings.eikonal_weight = 1e36;
  Trainer broken = trainer(settings);
  const std::vector<float> before = parameters(broken);
  const auto bad = failure_of(broken);
  ASSERT_TRUE(bad.has_value());
  std::printf("  %s\n", describe(*bad).c_str());
  EXPECT_EQ(bad->step, 1u);
  EXPECT_EQ(bad->tensors[0].stage, "optimiser");
  EXPECT_EQ(bad->tensors[0].tensor, "gradient of 'sdf'");
  EXPECT_THAT(bad->tensors[0].place, HasSubstr("in group 'sdf'"));
  EXPECT_GT(bad->tensors[0].beyond + bad->tensors[0].infinite + bad->tensors[0].nan, 0u);
  EXPECT_TRUE(same_bits(parameters(broken), before));
}

// A network that takes points well outside the body for points far inside, where e^(−100 f) has no float32.
TEST_F(BadValuesTest, APenaltyBeyondAllNumbersIsBad) {
  Trainer lost = trainer();
  lost.resume(poisoned(lost.checkpoint(), "sdf.2.b", 0, 1, -2.5f));
  const auto bad = failure_of(lost);
  ASSERT_TRUE(bad.has_value());
  std::printf("  %s\n", describe(*bad).c_str());
  EXPECT_EQ(bad->step, 1u);
  EXPECT_THAT(describe(*bad), HasSubstr("off_surface"));
}

// One frame's code is bad: its steps are left out, and the others' are taken.
TEST_F(BadValuesTest, SkippedStepsAreCountedAndChangeNothing) {
  TrainingSettings settings = small_settings();
  settings.on_bad_value = OnBadValue::skip;
  settings.ray_importance = 0.5;  // whose notes are part of what must not change
  Trainer training = trainer(settings);
  training.resume(poisoned(training.checkpoint(), "latent", 0, small_spec().latent_size, 1e38f));
  uint64_t skipped = 0, taken = 0;
  SafetensorsFile middle;
  std::vector<std::pair<uint64_t, bool>> fates, later;
  while (training.steps_done() < 14) {
    if (training.steps_done() == 7) middle = training.checkpoint();
    const std::vector<float> before = parameters(training), seen = noted(training);
    const StepReport report = training.step(20);
    fates.emplace_back(report.step, report.bad.has_value());
    (report.bad ? skipped : taken) += 1;
    EXPECT_EQ(report.step, training.steps_done());
    EXPECT_EQ(report.skipped, skipped);
    EXPECT_EQ(same_bits(parameters(training), before), report.bad.has_value());
    if (!report.bad) continue;
    EXPECT_EQ(report.bad->tensors[0].stage, "distances") << describe(*report.bad);
    EXPECT_EQ(noted(training), seen);
  }
  std::printf("  %u of 14 steps skipped\n", static_cast<unsigned>(skipped));
  EXPECT_GT(skipped, 0u);
  EXPECT_GT(taken, 0u);
  EXPECT_EQ(training.steps_skipped(), skipped);
  Trainer continued = trainer(settings);
  continued.resume(middle);
  while (continued.steps_done() < 14) {
    const StepReport report = continued.step(20);
    later.emplace_back(report.step, report.bad.has_value());
  }
  EXPECT_EQ(later, (std::vector<std::pair<uint64_t, bool>>(fates.begin() + 7, fates.end())));
  EXPECT_EQ(continued.steps_skipped(), skipped);
  EXPECT_TRUE(same_bits(parameters(continued), parameters(training)));
}

TEST_F(BadValuesTest, SkippingEndsWhereNoStepIsGood) {
  TrainingSettings settings = small_settings();
  settings.on_bad_value = OnBadValue::skip;
  Trainer lost = trainer(settings);
  lost.resume(poisoned(lost.checkpoint(), "sdf.2.b", 0, 1, 1e38f));
  uint64_t skipped = 0;
  EXPECT_THROW(for (;; ++skipped) lost.step(200), BadValueError);
  EXPECT_EQ(skipped, Trainer::most_skipped);
  Trainer hopeless = trainer(settings);
  hopeless.resume(poisoned(hopeless.checkpoint(), "sdf.1.W", 5, 1, std::numeric_limits<float>::infinity()));
  EXPECT_TRUE(failure_of(hopeless).has_value()) << "the state is bad: no step can be better";
}

// The same as a user meets it: a run's folder with the step that failed, which repeats it, or goes on without it.
TEST_F(BadValuesTest, ARunKeepsTheStepThatFailed) {
  RunConfig config = make_run_config(small_capture(), small_settings(), small_spec());
  config.settings.steps = 3;
  RunOptions options;
  options.folder = small_capture().path / "run";
  EXPECT_EQ(run_training(device, small_capture(), config, options).skipped, 0u);
  const RunFolder folder(options.folder);
  SafetensorsFile file = *folder.newest_checkpoint();
  folder.save_checkpoint(3, poisoned(file, "latent", 0, small_spec().latent_size, 1e38f));
  config.settings.steps = 24;
  options.resume = true;
  const auto message_of = [&] {
    try {
      run_training(device, small_capture(), config, options);
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const std::string message = message_of();
  EXPECT_THAT(message, HasSubstr("stage 'distances'"));
  EXPECT_THAT(message, HasSubstr("failure_"));
  uint64_t step = 4;
  while (step < 25 && !std::filesystem::exists(folder.failure_file(step))) ++step;
  ASSERT_LT(step, 25u) << message;
  const auto bad = bad_values_of(read_safetensors(folder.failure_file(step)));
  ASSERT_TRUE(bad.has_value());
  EXPECT_EQ(bad->step, step);
  EXPECT_THAT(message, HasSubstr(describe(*bad)));
  options.from = folder.failure_file(step);
  EXPECT_EQ(message_of(), message) << "repeated";

  config.settings.on_bad_value = OnBadValue::skip;
  const RunResult result = run_training(device, small_capture(), config, options);
  EXPECT_EQ(result.steps, 24u);
  EXPECT_GT(result.skipped, 0u);
  uint64_t told = 0;
  bool ended = false;
  std::ifstream events(folder.events_file());
  for (std::string line; std::getline(events, line);) {
    const nlohmann::json event = nlohmann::json::parse(line);
    if (event["event"] == "bad_values" && event.contains("skipped")) told = event["skipped"];
    if (event["event"] == "end" && event["step"] == 24) ended = event["skipped"] == result.skipped;
  }
  EXPECT_EQ(told, result.skipped);
  EXPECT_TRUE(ended);
}

TEST(BadValuesFile, MalformedReportsAreRefused) {
  SafetensorsFile file;
  EXPECT_FALSE(bad_values_of(file).has_value());
  put_bad_values(file, {4, {{"distances", "signed distances", 7, "sample 1 of ray 1", 1, 2, 3, 1e6}}, false, "3 of 4 found a root"});
  const std::string good = file.metadata.at("failure");
  EXPECT_EQ(describe(bad_values_of(file).value()), "training step 4: stage 'distances': 1 NaN, 2 infinite and 3 beyond 1e+06 of the signed distances, the first at index 7: sample 1 of ray 1");
  for (const char* field : {"step", "state", "searches", "tensors"}) {
    nlohmann::json json = nlohmann::json::parse(good);
    json[field] = nlohmann::json::object();
    file.metadata["failure"] = json.dump();
    EXPECT_THROW(bad_values_of(file), InputError) << field;
  }
  for (const char* field : {"stage", "tensor", "index", "place", "nan", "limit"}) {
    nlohmann::json json = nlohmann::json::parse(good);
    json["tensors"][0].erase(field);
    file.metadata["failure"] = json.dump();
    EXPECT_THROW(bad_values_of(file), InputError) << field;
  }
  file.metadata["failure"] = "{";
  EXPECT_THROW(bad_values_of(file), InputError);
}

TEST(BadValuesFile, TheSettingIsReadAndWritten) {
  TrainingSettings settings = preset_settings("tiny");
  EXPECT_EQ(settings.on_bad_value, OnBadValue::stop);
  settings.on_bad_value = OnBadValue::skip;
  EXPECT_EQ(settings_from_json(settings_to_json(settings), "here").on_bad_value, OnBadValue::skip);
  nlohmann::json json = nlohmann::json::parse(settings_to_json(settings));
  json["on_bad_value"] = "ignore";
  EXPECT_THROW(settings_from_json(json.dump(), "here"), InputError);
}

}  // namespace
}  // namespace arah
