// A prior of a small family: it repeats, continues, starts a fit ahead, and refuses an avatar that it does not fit.
#include "host/training/pretraining.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/training/template_fit.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

bool same_tensors(const SafetensorsFile& a, const SafetensorsFile& b) {
  if (a.tensors.size() != b.tensors.size()) return false;
  for (const auto& [name, tensor] : a.tensors)
    if (!b.tensors.contains(name) || tensor.data != b.tensors.at(name).data) return false;
  return true;
}

const BodyFamily& small_family() {
  static const BodyFamily family = generated_family(3, 1);
  return family;
}

PretrainSettings small_pretraining() {
  PretrainSettings settings;
  settings.seed = 5;
  settings.bodies = 3;
  settings.poses = 2;
  settings.sdf = {.steps = 40, .tasks = 2, .inner_steps = 6, .inner_rate = 1e-3, .outer_rate = 2e-3};
  settings.skinning = {.steps = 40, .tasks = 2, .inner_steps = 6, .inner_rate = 5e-3, .outer_rate = 1e-2};
  settings.surface_points = 200;  // no multiple of 64
  settings.volume_points = 130;
  settings.skinning_points = 200;
  return settings;
}

template <typename Action>
std::string refusal_of(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

class PretrainingTest : public DeviceTest {
 protected:
  std::filesystem::path file(const std::string& name) const { return small_capture().path / (name + ".safetensors"); }
  // Learned once for the whole program.
  const std::filesystem::path& learned() {
    static const std::filesystem::path path = [&] {
      Pretraining pretraining(device, small_spec(), small_family(), small_pretraining());
      EXPECT_TRUE(run_pretraining(pretraining, small_pretraining(), {file("learned")}));
      return file("learned");
    }();
    return path;
  }
};

TEST_F(PretrainingTest, AStartFromThePriorIsAheadOfARandomOne) {
  TrainingSettings settings = small_settings();
  settings.fit_steps = settings.fit_skinning_steps = 10;
  Avatar random = make_avatar(small_spec(), small_capture(), 3), ahead = random;
  const Prior prior = read_prior(learned());
  start_from_prior(ahead, prior);
  EXPECT_NE(random.parameters, ahead.parameters);
  for (const char* group : {"color", "grid", "latent", "deviation", "mapping"}) {
    const ParameterGroup& part = ahead.layout.group(group);
    EXPECT_TRUE(std::equal(&ahead.parameters[part.begin], &ahead.parameters[part.begin] + part.size(), &random.parameters[part.begin])) << group;
  }
  const TemplateFit from_random = fit_template(device, random, settings), from_prior = fit_template(device, ahead, settings);
  std::printf("  after 10 steps: SDF %.4f m from the prior, %.4f from random values; skinning %.3f and %.3f\n", from_prior.sdf_error, from_random.sdf_error, from_prior.skinning_error,
              from_random.skinning_error);
  EXPECT_LT(from_prior.sdf_error, 0.6 * from_random.sdf_error);
  EXPECT_LT(from_prior.skinning_error, 0.6 * from_random.skinning_error);
}

TEST_F(PretrainingTest, TheLossesFallAndTheSameSeedGivesTheSameBits) {
  PretrainSettings settings = small_pretraining();
  Pretraining whole(device, small_spec(), small_family(), settings), parts(device, small_spec(), small_family(), settings);
  std::vector<double> sdf, skinning;
  for (int i = 0; i < 6; ++i) sdf.push_back(whole.sdf_step()), skinning.push_back(whole.skinning_step());
  EXPECT_LT(sdf.back(), sdf.front());
  EXPECT_LT(skinning.back(), skinning.front());

  for (int i = 0; i < 3; ++i) EXPECT_EQ(parts.skinning_step(), skinning[static_cast<std::size_t>(i)]);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(parts.sdf_step(), sdf[static_cast<std::size_t>(i)]);
  write_safetensors(file("parts"), parts.tensors());
  Pretraining resumed(device, small_spec(), small_family(), settings);
  resumed.resume(read_safetensors(file("parts")));
  EXPECT_EQ(resumed.sdf_steps(), 2u);
  EXPECT_EQ(resumed.skinning_steps(), 3u);
  while (resumed.sdf_steps() < 6) resumed.sdf_step();
  while (resumed.skinning_steps() < 6) resumed.skinning_step();
  EXPECT_TRUE(same_tensors(resumed.tensors(), whole.tensors()));

  settings.seed = 6;
  Pretraining other(device, small_spec(), small_family(), settings);
  EXPECT_NE(other.sdf_step(), sdf[0]);
  EXPECT_THAT(refusal_of([&] { other.resume(read_safetensors(file("parts"))); }), testing::HasSubstr("settings/seed: expected what it began with, 5, found 6"));
}

TEST_F(PretrainingTest, StopsWithWhatThereIsAndGoesOn) {
  PretrainSettings settings = small_pretraining();
  settings.sdf.steps = settings.skinning.steps = 3;
  Pretraining first(device, small_spec(), small_family(), settings);
  int told = 0;
  EXPECT_FALSE(run_pretraining(first, settings, {file("stopped")}, [&](const PretrainEvent& event) {
    EXPECT_EQ(event.steps, 3u);
    EXPECT_LE(event.step, 3u);
    return ++told < 4;
  }));
  EXPECT_EQ(told, 4);
  EXPECT_EQ(first.skinning_steps(), 3u);
  EXPECT_EQ(first.sdf_steps(), 1u);
  Pretraining second(device, small_spec(), small_family(), settings);
  PretrainOptions options{file("stopped")};
  options.resume = true;
  EXPECT_TRUE(run_pretraining(second, settings, options));
  Pretraining whole(device, small_spec(), small_family(), settings);
  EXPECT_TRUE(run_pretraining(whole, settings, {file("whole")}));
  EXPECT_TRUE(same_tensors(read_safetensors(file("stopped")), read_safetensors(file("whole"))));
}

TEST_F(PretrainingTest, RefusesAnAvatarThatItDoesNotFit) {
  const Prior prior = read_prior(learned());
  EXPECT_EQ(prior.family, R"({"kind":"generated","bodies":3,"first_seed":1})");
  const auto refused = [&](const AvatarSpec& spec, BodyTemplate body) {
    Avatar avatar = make_avatar(spec, std::move(body), {0}, 0);
    return refusal_of([&] { start_from_prior(avatar, prior); });
  };
  const BodyTemplate& body = small_capture().body_template;
  AvatarSpec spec = small_spec();
  spec.sdf.width = 32;
  EXPECT_THAT(refused(spec, body), testing::HasSubstr("learned.safetensors: sdf.width: expected the avatar's 32, found 24"));
  spec = small_spec();
  spec.sdf.omega = 20;
  EXPECT_THAT(refused(spec, body), testing::HasSubstr("sdf.omega: expected the avatar's 20, found 30"));
  spec = small_spec();
  spec.skinning.hidden_layers = 3;
  EXPECT_THAT(refused(spec, body), testing::HasSubstr("skinning.hidden_layers: expected the avatar's 3, found 2"));
  BodyTemplate renamed = body;
  renamed.glb.clear();
  renamed.skeleton.names[5] = "elsewhere";
  EXPECT_THAT(refused(small_spec(), renamed), testing::HasSubstr("joint 5: expected the avatar's elsewhere, found right_knee"));
  renamed = body;
  renamed.glb.clear();
  renamed.skeleton.parents[23] = 20;
  EXPECT_THAT(refused(small_spec(), renamed), testing::HasSubstr("parent of joint 23 ('right_hand'): expected the avatar's 20, found 21"));
  // An avatar without a skinning network takes the SDF alone.
  spec = small_spec();
  spec.skinning = {Skinning::template_weights, 0, 0};
  EXPECT_EQ(refused(spec, body), "no InputError");

  SafetensorsFile spoiled = prior.file;
  spoiled.tensors.erase("sdf.1.W");
  write_safetensors(file("spoiled"), spoiled);
  Avatar avatar = make_avatar(small_spec(), small_capture(), 3);
  EXPECT_THAT(refusal_of([&] { start_from_prior(avatar, read_prior(file("spoiled"))); }), testing::HasSubstr("sdf.1.W"));
  write_safetensors(file("avatar"), avatar_tensors(avatar));
  EXPECT_THAT(refusal_of([&] { read_prior(file("avatar")); }), testing::HasSubstr("expected a prior"));
}

TEST(PretrainSettings, KeepEveryValueAndRefuseByName) {
  const PretrainSettings settings = small_pretraining();
  const std::string text = pretrain_settings_to_json(settings);
  EXPECT_EQ(pretrain_settings_to_json(pretrain_settings_from_json(text, "here")), text);
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    const std::size_t at = other.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    other.replace(at, from.size(), to);
    return refusal_of([&] { pretrain_settings_from_json(other, "here"); });
  };
  EXPECT_THAT(changed("\"inner_steps\": 6", "\"inner_steps\": 0"), testing::HasSubstr("here: sdf.inner_steps: expected at least 1, found 0"));
  EXPECT_THAT(changed("\"inner_rate\": 0.001", "\"inner_rate\": \"fast\""), testing::HasSubstr("here: sdf.inner_rate: expected a number of at least 0"));
  EXPECT_THAT(changed("\"tasks\"", "\"duties\""), testing::HasSubstr("here: sdf.duties: expected a setting of this version"));
  EXPECT_THAT(changed("\"bodies\": 3,", ""), testing::HasSubstr("here: bodies: expected a value, found no such field"));
  EXPECT_THAT(refusal_of([] { preset_pretrain_settings("huge"); }), testing::HasSubstr("tiny, compact or paper"));
  EXPECT_EQ(preset_pretrain_settings("paper").sdf.outer_rate, 1e-5);
}

}  // namespace
}  // namespace arah
