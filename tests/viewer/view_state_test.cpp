#include "viewer/view_state.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/host/body/hostile_json.h"
#include "tests/host/body/rigs.h"
#include "tests/viewer/small_person.h"

namespace arah {
namespace {

// Nothing in it as in ViewState{}.
ViewState changed_state() {
  ViewState state;
  state.viewpoint = {{0.1, -2, 1.0 / 3}, UpAxis::z, 0.7, -0.2, 4.25, 0.9};
  state.camera = "cam_02";
  state.turntable = -0.5;
  state.split = "novel";
  state.timeline = {12.625, true, true, 0.25, Loop::there_and_back};
  state.blend_frame = 61;
  state.blend_weight = 0.75;
  state.turns = {{"left_elbow", {0.1, 0.2, -3}}, {"head", {0, 0.5, 0}}};
  state.shift = {0, 0.25, -1};
  state.latent_row = 7;
  state.shape = {0.5, -1.5, 0};
  state.layer = "skinning_weights";
  state.joint = "left_knee";
  state.slice = -0.125;
  state.skeleton = state.mesh = state.handles = true;
  state.comparison = {ComparisonMode::split, 0.3, 2.5, 8};
  state.quality = "fast";
  state.knobs = {{"samples", "24"}, {"sampling_mode", "uniform"}, {"surface", "mesh"}};
  state.compare_with_exact = true;
  state.window_width = 1920;
  state.window_height = 1081;
  state.hint_seen = true;
  return state;
}

// Every value in the file, by its path.
void collect(const nlohmann::json& json, const std::string& path, std::map<std::string, nlohmann::json>& values) {
  if (json.is_object() && !json.empty()) {
    for (const auto& [name, member] : json.items()) collect(member, path + "/" + name, values);
  } else {
    values[path] = json;
  }
}

TEST(ViewStateTest, IsReadAsItWasWritten) {
  const TemporaryFolder folder;
  for (const ViewState& state : {ViewState{}, changed_state()}) {
    write_view_state(folder / "view.json", state);
    EXPECT_EQ(read_view_state(folder / "view.json"), state);
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
  EXPECT_EQ(view_state_from_json(R"({"arah_view": 1})", "view"), ViewState{});
}

// A field that were written from one member and read into another, or forgotten, would show.
TEST(ViewStateTest, EveryFieldCounts) {
  const nlohmann::json changed = nlohmann::json::parse(view_state_json(changed_state())), plain = nlohmann::json::parse(view_state_json({}));
  std::map<std::string, nlohmann::json> values;
  collect(changed, "", values);
  EXPECT_EQ(values.size(), 1u + 6 + 2 + 6 + 2 + 3 + 2 + 3 + 3 + 4 + 5 + 2 + 1);
  for (const auto& [path, value] : values) {
    const nlohmann::json::json_pointer at(path);
    if (path == "/arah_view") continue;
    ASSERT_FALSE(plain.contains(at) && plain[at] == value) << path;
    nlohmann::json one = plain;
    one[at] = value;
    const ViewState state = view_state_from_json(one.dump(), "view");
    EXPECT_NE(state, ViewState{}) << path;
    EXPECT_EQ(nlohmann::json::parse(view_state_json(state)), one) << path;
  }
}

TEST(ViewStateTest, RefusesWhatItDoesNotKnow) {
  const nlohmann::json changed = nlohmann::json::parse(view_state_json(changed_state()));
  const auto refused = [&](const std::string& path, const nlohmann::json& value, const std::vector<std::string>& parts) {
    nlohmann::json one = changed;
    one[nlohmann::json::json_pointer(path)] = value;
    std::vector<std::string> all{"view.json"};
    all.insert(all.end(), parts.begin(), parts.end());
    SCOPED_TRACE(path + " = " + value.dump());
    expect_input_error([&] { view_state_from_json(one.dump(), "view.json"); }, all);
  };
  refused("/arah_view", 2, {"arah_view"});
  refused("/colour", 1, {"colour", "unknown field"});
  refused("/viewpoint/roll", 1, {"viewpoint.roll", "unknown field"});
  refused("/viewpoint/up", "x", {"viewpoint.up", "y, z"});
  refused("/viewpoint/distance", 0, {"viewpoint.distance", "0.05"});
  refused("/viewpoint/field_of_view", 3.2, {"viewpoint.field_of_view"});
  refused("/viewpoint/pitch", 1.56, {"viewpoint.pitch"});
  refused("/viewpoint/target", {1, 2}, {"viewpoint.target", "3 values"});
  refused("/viewpoint/target", {1, 2, 1e9}, {"viewpoint.target"});
  refused("/viewpoint", 4, {"viewpoint", "an object"});
  refused("/motion/loop", "twice", {"motion.loop", "there_and_back"});
  refused("/motion/speed", 40, {"motion.speed"});
  refused("/motion/place", -1, {"motion.place"});
  refused("/motion/playing", 1, {"motion.playing", "true or false"});
  refused("/blend/weight", 1.01, {"blend.weight"});
  refused("/blend/frame", 1.5, {"blend.frame"});
  refused("/edits/turns/head", {0, 0, 1000}, {"edits.turns.head"});
  refused("/edits/turns", {1}, {"edits.turns", "an object"});
  refused("/latent_row", -1, {"latent_row"});
  refused("/shape", nlohmann::json::array({"a"}), {"shape"});
  refused("/shape", std::vector<double>(65), {"shape", "at most 64"});
  refused("/layer/name", std::string(2000, 'a'), {"layer.name", "at most 1000"});
  refused("/layer/slice", 2.5, {"layer.slice"});
  refused("/overlays/mesh", nullptr, {"overlays.mesh"});
  refused("/comparison/mode", "wipe", {"comparison.mode", "error_map"});
  refused("/comparison/position", -0.1, {"comparison.position"});
  refused("/render/quality", "best", {"render.quality", "balanced"});
  refused("/render/knobs/sample", "3", {"render.knobs.sample", "no such knob"});
  refused("/render/knobs/samples", "many", {"render.knobs.samples", "many"});
  refused("/render/knobs/samples", 24, {"render.knobs.samples", "a text"});
  refused("/window/width", 3, {"window.width"});
  refused("/window/width", 1e300, {"window.width"});
  refused("/hint_seen", "no", {"hint_seen"});
  // A type that fits nowhere, everywhere.
  std::map<std::string, nlohmann::json> values;
  collect(changed, "", values);
  for (const auto& [path, value] : values) refused(path, {{"a", nlohmann::json::array({{}, "x"})}}, {});
}

TEST(ViewStateTest, HostileFilesAreRefused) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& text) { expect_input_error([&] { read_view_state(folder.write("view.json", text)); }, {"view.json"}); };
  for (const std::string text : {"", "{", "null", "[]", "7", "{\"arah_view\": NaN}", "{\"arah_view\": true}", "{\"arah_view\": 1, \"turntable\": 1e999}", "{\"arah_view\": \"1\"}"}) refused(text);
  refused(nested_lists(100'000));
  refused("{\"arah_view\": 1, \"edits\": {\"turns\": " + nested_objects(60) + "}}");
  refused("{\"arah_view\": 1, \"edits\": {\"turns\": " + list_of("0", 100'000) + "}}");
  refused("{\"arah_view\": 1, \"" + std::string(5000, 'x') + "\\n\\u001b\": 1}");
  refused("{\"arah_view\": 1, \"edits\": {\"turns\": {\"" + std::string(5000, 'x') + "\": [0, 0, 0]}}}");
  refused(std::string(kMostViewFile + 1, ' '));
  std::string joints;
  for (int j = 0; j < 65; ++j) joints += fmt::format("{}\"j{}\": [0, 0, 1]", j ? "," : "", j);
  refused("{\"arah_view\": 1, \"edits\": {\"turns\": {" + joints + "}}}");
  expect_input_error([&] { read_view_state(folder.path()); }, {"none that can be opened"});
  expect_input_error([&] { read_view_state(folder / "none.json"); }, {"none.json"});
  // Cut short anywhere, it is refused.
  const std::string whole = view_state_json(changed_state());
  for (std::size_t length = 0; length + 2 < whole.size(); length += 7) EXPECT_THROW(view_state_from_json(whole.substr(0, length), "view"), InputError) << length;
}

TEST(ViewStateTest, WhatCouldNotBeReadIsNotWritten) {
  const TemporaryFolder folder;
  write_view_state(folder / "view.json", changed_state());
  ViewState bad = changed_state();
  bad.viewpoint.yaw = std::nan("");
  expect_input_error([&] { write_view_state(folder / "view.json", bad); }, {"viewpoint.yaw"});
  EXPECT_EQ(read_view_state(folder / "view.json"), changed_state());
}

TEST(ViewStateTest, EditsGoByTheJointsNames) {
  const Skeleton person = smpl_person();
  ViewState state;
  PoseEdits edits{std::vector<glm::dvec3>(24), {1, 2, 3}};
  edits.turns[joint_named(person, "left_wrist")] = {0, 1, 0};
  set_edits(state, person, edits);
  EXPECT_EQ(state.turns.size(), 1u);
  EXPECT_EQ(edits_of(state, person, "view"), edits);
  set_edits(state, person, {});
  EXPECT_EQ(edits_of(state, person, "view"), PoseEdits{});
  state.turns["tail"] = {1, 0, 0};
  expect_input_error([&] { edits_of(state, person, "view.json"); }, {"view.json", "'tail'", "another avatar"});
}

TEST(ViewStateTest, KnobsAreSetInAnOrderThatKeepsThemAll) {
  const ViewState state = changed_state();
  const RenderSettings settings = render_settings_of(state, Avatar{});
  EXPECT_EQ(settings.sampling->mode, SamplingMode::uniform);
  EXPECT_EQ(settings.sampling->samples, 24u);  // the mode alone would set 64
  EXPECT_EQ(settings.color_groups, render_preset(Avatar{}, "fast").color_groups);
}

}  // namespace
}  // namespace arah
