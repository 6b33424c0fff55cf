// Settings as data: what is written reads back, what is not a setting is refused, and rates follow their schedule.
#include "host/training/training_settings.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "host/training/pretrain_settings.h"
#include "tests/host/body/hostile_json.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using nlohmann::json;

// Every value different from its default and from its neighbours': {"a": 0.5, "b": {"c": 1.5}} by the type that stands.
void fill_with_new_values(json& object, int& next) {
  for (auto& [name, value] : object.items()) {
    ++next;
    if (value.is_object()) fill_with_new_values(value, next);
    else if (value.is_boolean()) value = !value.get<bool>();
    else if (value.is_string()) value = "word" + std::to_string(next);
    else if (value.is_number_float()) value = next + 0.5;  // a float holds it exactly
    else value = next;
  }
}

TEST(TrainingSettingsTest, RefusesDepth) {
  std::string inside = settings_to_json(TrainingSettings{});
  inside.replace(inside.rfind('}'), 1, ",\"more\":" + nested_lists(10'000) + "}");
  for (const std::string& deep : {nested_lists(10'000), nested_objects(10'000), inside}) {
    expect_input_error([&] { settings_from_json(deep, "file"); }, {"file", "nested at most 64 deep"});
    expect_input_error([&] { pretrain_settings_from_json(deep, "file"); }, {"file", "nested at most 64 deep"});
  }
}

TEST(TrainingSettingsTest, EveryFieldReadsBackAsWritten) {
  json object = json::parse(settings_to_json(TrainingSettings{}));
  int next = 1000;
  fill_with_new_values(object, next);
  object["sampling_mode"] = "surface";  // one of two words; the default is the other
  object["root_correspondence"] = "grid";
  object["root_initialisations"] = 1;  // with a grid
  object["root_rescue_steps"] = 30;
  object["root_rescue_bones"] = 3;
  object["on_bad_value"] = "skip";
  object["rendering"] = "surface";
  object["mask_samples"] = 99;  // at most 1024
  object["ray_importance"] = 0.75;  // a share
  object["pose_noise_probability"] = 0.25;
  object["frames_per_step"] = 3;  // at most 8
  object["pictures_per_frame"] = 5;
  object["view_augmentation"] = 0.25;  // a probability
  object["around_surface"] = 19;  // odd, and with those before it no more than all
  object["before_surface"] = 18;
  ASSERT_GT(next, 1070) << "fields";
  const TrainingSettings settings = settings_from_json(object.dump(), "config.json");
  EXPECT_EQ(json::parse(settings_to_json(settings)), object);
  EXPECT_EQ(settings.rays, object["rays"]);
  EXPECT_EQ(settings.sdf.warm_up, object["sdf"]["warm_up"]);
  EXPECT_EQ(settings.sampling.root.tolerance, object["root_tolerance"]);
  object["root_initialisations"] = 3;
  object["root_correspondence"] = "search";
  EXPECT_EQ(json::parse(settings_to_json(settings_from_json(object.dump(), "config.json"))), object);
}

TEST(TrainingSettingsTest, EveryPresetReadsBackAsWritten) {
  for (const char* preset : {"tiny", "compact", "paper"}) {
    const std::string text = settings_to_json(preset_settings(preset));
    EXPECT_EQ(settings_to_json(settings_from_json(text, "config.json")), text);
    EXPECT_EQ(json::parse(text)["preset"], preset);
  }
  EXPECT_THROW(preset_settings("huge"), InputError);
}

// The message must name the file and the field.
void expect_refused(const json& object, const std::string& field) {
  try {
    settings_from_json(object.dump(), "config.json");
    ADD_FAILURE() << field << " was accepted";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("config.json"), std::string::npos) << message;
    EXPECT_NE(message.find(field), std::string::npos) << message;
  }
}

TEST(TrainingSettingsTest, RefusesWhatIsNoSetting) {
  const json whole = json::parse(settings_to_json(TrainingSettings{}));
  ASSERT_NO_THROW(settings_from_json(whole.dump(), "config.json"));
  auto with = [&](const char* pointer, const json& value) {
    json changed = whole;
    changed[json::json_pointer(pointer)] = value;
    return changed;
  };
  expect_refused(with("/brightness", 1), "brightness");
  expect_refused(with("/color/momentum", 0.9), "color.momentum");
  expect_refused(with("/rays", 12.5), "rays");
  expect_refused(with("/rays", -1), "rays");
  expect_refused(with("/rays", 0), "rays");
  expect_refused(with("/rays", 4294967297u * 2ull), "rays");
  expect_refused(with("/minutes", "ten"), "minutes");
  for (const double share : {-0.1, 0.95, 1e300}) expect_refused(with("/ray_importance", share), "ray_importance");
  for (const double probability : {-0.1, 1.1}) expect_refused(with("/view_augmentation", probability), "view_augmentation");
  expect_refused(with("/preset", 3), "preset");
  expect_refused(with("/sdf", 1e-4), "sdf");
  expect_refused(with("/sampling_mode", "anywhere"), "sampling_mode");
  expect_refused(with("/sampling_mode", "surface_only"), "sampling_mode");  // that is `rendering`
  expect_refused(with("/rendering", "points"), "rendering");
  for (const int samples : {0, 1025}) expect_refused(with("/mask_samples", samples), "mask_samples");
  for (const double alpha : {0.0, -1.0}) expect_refused(with("/mask_alpha", alpha), "mask_alpha");
  expect_refused(with("/mask_weight", -1), "mask_weight");
  for (const int starts : {0, 9}) expect_refused(with("/root_initialisations", starts), "root_initialisations");
  expect_refused(with("/root_rescue_bones", 9), "root_rescue_bones");
  expect_refused(with("/root_rescue_steps", 1001), "root_rescue_steps");
  json of_nodes = with("/root_initialisations", 3);
  of_nodes["root_correspondence"] = "grid_alone";
  expect_refused(of_nodes, "root_initialisations");
  expect_refused(with("/mask_alpha_rate", -1), "mask_alpha_rate");
  for (const char* field : {"seed", "skinning_every", "grid"}) {
    json shorter = whole;
    shorter.erase(field);
    expect_refused(shorter, field);
  }
  json shorter = whole;
  shorter["latent"].erase("rate");
  expect_refused(shorter, "latent.rate");
  EXPECT_THROW(settings_from_json("{", "config.json"), InputError);
  EXPECT_THROW(settings_from_json("[]", "config.json"), InputError);
}

TEST(TrainingSettingsTest, ADensityHasNoSurfaceToSampleAround) {
  AvatarSpec spec = preset_spec("paper");
  TrainingSettings settings = preset_settings("paper");
  EXPECT_NO_THROW(check_settings(settings, spec, "training"));
  spec.sdf.kind = FieldKind::density;
  try {
    check_settings(settings, spec, "training");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    for (const char* part : {"training", "sampling_mode", "density", "surface"}) EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
  }
  spec.sdf.kind = FieldKind::sdf;
  spec.skinning.kind = Skinning::backward;  // nor a way to one
  EXPECT_THROW(check_settings(settings, spec, "training"), InputError);
  settings.sampling.mode = SamplingMode::shell;
  EXPECT_NO_THROW(check_settings(settings, spec, "training"));
}

TEST(TrainingSettingsTest, RatesAreFrozenThenWarmedUpThenFallAlongACosine) {
  TrainingSettings settings;
  settings.end_fraction = 0.2;
  const GroupSettings group{.rate = 1, .freeze = 3, .warm_up = 4};
  EXPECT_EQ(rate_factor(group, settings, 0, 0), 0);
  EXPECT_EQ(rate_factor(group, settings, 2, 0), 0);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 3, 0), 0.25);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 5, 0), 0.75);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 6, 0), 1);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 1000, 0), 1);
  // 0.2 + 0.8 · (1 + cos π d) / 2: 0.6 half-way, 0.2 at the end and beyond
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 1000, 0.5), 0.6);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 1000, 1), 0.2);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 1000, 1.25), 0.2);
  EXPECT_DOUBLE_EQ(rate_factor(group, settings, 4, 0.5), 0.3) << "warm-up and cosine multiply";
  EXPECT_EQ(rate_factor(group, settings, 2, 0.5), 0);
  EXPECT_DOUBLE_EQ(rate_factor(GroupSettings{}, settings, 0, 0), 1) << "neither frozen nor warmed up";
}

TEST(TrainingSettingsTest, TheIntervalAroundTheSurfaceNarrowsInALine) {
  TrainingSettings settings;
  EXPECT_EQ(half_width(settings, 0), 0.05);
  settings.half_width_start = 0.15;
  settings.half_width_steps = 100;
  EXPECT_DOUBLE_EQ(half_width(settings, 0), 0.15);
  EXPECT_DOUBLE_EQ(half_width(settings, 50), 0.10);
  EXPECT_DOUBLE_EQ(half_width(settings, 100), 0.05);
  EXPECT_DOUBLE_EQ(half_width(settings, 1000), 0.05);
}

}  // namespace
}  // namespace arah
