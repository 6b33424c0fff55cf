// The spec as data: presets against the released sizes, JSON both ways, and what is refused.
#include "host/avatar/avatar_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>

#include "host/input_error.h"
#include "host/version.h"
#include "tests/host/body/hostile_json.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Widths = std::vector<uint32_t>;

TEST(AvatarSpec, PaperPresetHasTheReleasedSizes) {
  const AvatarSpec spec = preset_spec("paper");
  EXPECT_THAT(sdf_widths(spec), ElementsAre(3, 256, 256, 256, 256, 256, 256, 1));
  EXPECT_THAT(mapping_widths(spec), ElementsAre(128, 256, 256, 256, 3072));
  EXPECT_THAT(pose_widths(spec, 24), ElementsAre(144, 256, 256));
  EXPECT_THAT(skinning_widths(spec, 25, 24), ElementsAre(3, 128, 128, 128, 128, 25));
  EXPECT_THAT(color_widths(spec), ElementsAre(417, 256, 256, 128, 256, 256, 3));
  EXPECT_EQ(spec.color.skip, 3);
}

TEST(AvatarSpec, ABackwardNetworkTakesThePoseToo) {
  AvatarSpec spec = preset_spec("paper");
  spec.skinning.kind = Skinning::backward;
  EXPECT_NO_THROW(validate_spec(spec, "spec"));
  EXPECT_THAT(skinning_widths(spec, 25, 24), ElementsAre(3 + 23 * 9, 128, 128, 128, 128, 25));
  EXPECT_EQ(spec_from_json(spec_to_json(spec), "spec"), spec);
}

TEST(AvatarSpec, TinyPresetIsTheRecipe) {
  const AvatarSpec spec = preset_spec("tiny");
  EXPECT_THAT(sdf_widths(spec), ElementsAre(3, 64, 64, 64, 64, 1));
  EXPECT_THAT(mapping_widths(spec), IsEmpty());
  EXPECT_THAT(skinning_widths(spec, 25, 24), ElementsAre(3, 64, 64, 25));
  // x 3, SDF feature 64, two grid levels of 4, latent 16.
  EXPECT_THAT(color_widths(spec), ElementsAre(3 + 64 + 8 + 16, 64, 64, 64, 3));
}

TEST(AvatarSpec, ColorInputCountsExactlyThePartsThatAreOn) {
  AvatarSpec spec = preset_spec("tiny");
  spec.color.feature = spec.color.latent = false;
  spec.latent_size = 0;
  spec.grid_cells.clear();
  EXPECT_EQ(color_widths(spec).front(), 3u);
  spec.color.view = true;
  EXPECT_EQ(color_widths(spec).front(), 30u);
  spec.color.normal = true;
  EXPECT_EQ(color_widths(spec).front(), 33u);
  spec.grid_cells = {0.1, 0.05, 0.03};
  EXPECT_EQ(color_widths(spec).front(), 45u);
}

TEST(AvatarSpec, EveryPresetIsValidAndSurvivesJson) {
  for (const std::string& name : preset_names()) {
    const AvatarSpec spec = preset_spec(name);
    EXPECT_NO_THROW(validate_spec(spec, name));
    EXPECT_EQ(spec_from_json(spec_to_json(spec), name), spec);
    EXPECT_EQ(spec.preset, name);
  }
  expect_input_error([] { preset_spec("huge"); }, {"tiny, compact, paper", "'huge'"});
}

TEST(AvatarSpec, OddSpecsSurviveJsonExactly) {
  AvatarSpec spec;
  spec.preset = "odd_1";
  spec.skinning = {Skinning::template_weights, 0, 0};
  spec.sdf = {37, 3, 29.7, SdfConditioning::latent, 11, 2, PoseConditioning::low_rank, 24, 3, FieldKind::density};
  spec.color = {53, 4, 2, 19, true, false, false, false, DirectionSpace::canonical};
  spec.latent_size = 7;
  spec.latent_init_std = 1.0 / 3.0;
  spec.b_init = 1e-6;
  spec.grid_cells = {0.1, 1.0 / 7.0};
  EXPECT_EQ(spec_from_json(spec_to_json(spec), "odd"), spec);
}

// Files from before the SDF could follow the pose do not mention it.
TEST(AvatarSpec, AbsentPoseFieldsMeanNone) {
  AvatarSpec spec = preset_spec("tiny");
  auto json = nlohmann::json::parse(spec_to_json(spec));
  for (const char* field : {"pose", "pose_width", "pose_hidden_layers"}) EXPECT_EQ(json["sdf"].erase(field), 1u);
  EXPECT_EQ(spec_from_json(json.dump(), "old"), spec);
}

TEST(AvatarSpec, PartialJsonChangesOnlyWhatItStates) {
  const AvatarSpec base = preset_spec("tiny");
  AvatarSpec expected = base;
  expected.sdf.width = 96;
  expected.grid_cells.clear();
  EXPECT_EQ(spec_with_json(base, R"({"sdf": {"width": 96}, "grid_cells": []})", "text"), expected);
  EXPECT_EQ(spec_with_json(base, "{}", "text"), base);
  expect_input_error([] { spec_from_json(R"({"preset": "tiny"})", "file"); }, {"file", "skinning", "none"});
  // A file of before there was a choice.
  auto before = nlohmann::json::parse(spec_to_json(preset_spec("paper")));
  EXPECT_EQ(before["color"].erase("directions"), 1u);
  EXPECT_EQ(before["sdf"].erase("kind"), 1u);
  EXPECT_EQ(spec_from_json(before.dump(), "file"), preset_spec("paper"));
}

TEST(AvatarSpec, RefusesDepth) {
  for (const std::string& deep : {nested_lists(10'000), nested_objects(10'000), "{\"preset\":" + nested_lists(1'000'000) + "}"}) {
    expect_input_error([&] { spec_from_json(deep, "file"); }, {"file", "nested at most 64 deep"});
    expect_input_error([&] { spec_with_json(preset_spec("tiny"), deep, "file"); }, {"file", "nested at most 64 deep"});
  }
}

TEST(AvatarSpec, RefusalsNameTheField) {
  const AvatarSpec base = preset_spec("tiny");
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases{
      {"", {"JSON"}},
      {"[]", {"an object"}},
      {R"({"hair": 1})", {"hair", "unknown field"}},
      {R"({"color": {"gloss": true}})", {"color.gloss", "unknown field"}},
      {R"({"sdf": 3})", {"sdf", "an object"}},
      {R"({"sdf": {"width": "64"}})", {"sdf.width", "integer"}},
      {R"({"sdf": {"width": 64.5}})", {"sdf.width", "64.5"}},
      {R"({"sdf": {"width": -1}})", {"sdf.width", "-1"}},
      {R"({"sdf": {"width": 0}})", {"sdf.width", "from 1 to"}},
      {R"({"sdf": {"width": 100000}})", {"sdf.width", "100000"}},
      {R"({"sdf": {"sine_layers": 17}})", {"sdf.sine_layers", "17"}},
      {R"({"sdf": {"omega": 0}})", {"sdf.omega", "above 0"}},
      {R"({"sdf": {"omega": 1e999}})", {"JSON"}},
      {R"({"sdf": {"pose": "magic"}})", {"sdf.pose", "none or low_rank or hypernetwork", "'magic'"}},
      {R"({"sdf": {"pose": "low_rank"}})", {"sdf.pose_width", "from 1 to"}},
      {R"({"sdf": {"pose": "low_rank", "pose_width": 12, "pose_hidden_layers": 1}})", {"sdf.pose_width", "a multiple of 8"}},
      {R"({"sdf": {"pose_hidden_layers": 1}})", {"sdf.pose_hidden_layers", "0 without sdf.pose"}},
      {R"({"sdf": {"conditioning": "magic"}})", {"sdf.conditioning", "'magic'"}},
      {R"({"sdf": {"kind": "occupancy"}})", {"sdf.kind", "sdf or density", "'occupancy'"}},
      {R"({"sdf": {"conditioning": "latent"}})", {"sdf.mapping_width", "from 1 to"}},
      {R"({"sdf": {"mapping_width": 8}})", {"sdf.mapping_width", "0 without conditioning"}},
      {R"({"skinning": {"kind": "grid"}})", {"skinning.kind", "not in this version"}},
      {R"({"skinning": {"kind": "none"}})", {"skinning.width", "0 without"}},
      {R"({"skinning": {"hidden_layers": 0}})", {"skinning.hidden_layers", "found 0"}},
      {R"({"color": {"view": 1}})", {"color.view", "true or false"}},
      {R"({"color": {"view": true, "directions": "world"}})", {"color.directions", "observation or canonical", "'world'"}},
      {R"({"color": {"directions": true}})", {"color.directions", "a text"}},
      {R"({"color": {"directions": "canonical"}})", {"color.directions", "without color.view and color.normal"}},
      {R"({"color": {"skip": 4}})", {"color.skip", "from 1 to 3"}},
      {R"({"color": {"skip": 0}})", {"color.skip", "found 0"}},
      {R"({"color": {"skip": 2}})", {"color.narrow", "found 0"}},
      {R"({"color": {"narrow": 2}})", {"color.narrow", "0 without a skip"}},
      {R"({"color": {"latent": false}})", {"latent_size", "0 without a reader"}},
      {R"({"latent_size": 0})", {"latent_size", "found 0"}},
      {R"({"b_init": 0})", {"b_init", "from 1e-6 to 1e6"}},
      {R"({"b_init": 9e-7})", {"b_init", "from 1e-6 to 1e6"}},
      {R"({"b_init": 2e6})", {"b_init", "from 1e-6 to 1e6"}},
      {R"({"latent_init_std": -0.1})", {"latent_init_std", "at least 0"}},
      {R"({"grid_cells": [0.04, 0]})", {"grid_cells", "above 0"}},
      {R"({"grid_cells": [1, 1, 1, 1, 1]})", {"grid_cells", "at most 4"}},
      {R"({"grid_cells": 0.04})", {"grid_cells", "a list"}},
      {R"({"preset": "a b"})", {"preset", "letters"}},
      {R"({"preset": null})", {"preset", "a text"}},
  };
  for (const auto& entry : cases) {
    const std::string& text = entry.first;
    SCOPED_TRACE(text);
    std::vector<std::string> all = entry.second;
    all.push_back("avatar.safetensors: spec");
    expect_input_error([&] { spec_with_json(base, text, "avatar.safetensors: spec"); }, all);
  }
}

TEST(AvatarSpec, DamagedJsonIsRefusedOrValid) {
  const std::string good = spec_to_json(preset_spec("paper"));
  std::mt19937_64 random(7);
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    std::string text = good;
    for (int k = 0; k < 1 + i % 3; ++k) text[random() % text.size()] = static_cast<char>(random() % 256);
    try {
      const AvatarSpec spec = spec_from_json(text, "damaged");
      EXPECT_NO_THROW(validate_spec(spec, "damaged"));
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(Version, IsThatOfTheBuild) {
  std::ifstream file(std::string(ARAH_SOURCE_DIR) + "/CMakeLists.txt");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_THAT(text, HasSubstr(std::string("project(arah VERSION ") + kVersion + " "));
}

}  // namespace
}  // namespace arah
