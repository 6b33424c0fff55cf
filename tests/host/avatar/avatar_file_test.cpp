// Making avatars, and their file: bit-exact round trips and what a spoilt file is refused with.
#include "host/avatar/avatar_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "tests/host/body/hostile_json.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using ::testing::HasSubstr;

AvatarSpec full_spec() {
  AvatarSpec spec;
  spec.preset = "odd";
  spec.skinning = {Skinning::network, 9, 1};
  spec.sdf = {11, 2, 30.0, SdfConditioning::latent, 6, 1};
  spec.color = {10, 3, 2, 5, true, true, true, true};
  spec.latent_size = 3;
  spec.grid_cells = {0.3, 0.11};
  return spec;
}

AvatarSpec bare_spec() {
  AvatarSpec spec;
  spec.skinning = {Skinning::none, 0, 0};
  spec.sdf.width = 8;
  spec.sdf.sine_layers = 1;
  spec.color.width = 5;
  spec.color.hidden_layers = 1;
  return spec;
}

Avatar full_avatar() {
  Avatar avatar = make_avatar(full_spec(), tetrahedron(3), {12, 7, 30}, 0xfedcba9876543210u);
  avatar.steps = 1234;
  avatar.settings = R"({"rays": 256, "note": "é"})";
  avatar.tensor("sdf.0.W")[1] = std::numeric_limits<float>::denorm_min();
  avatar.tensor("sdf.0.W")[2] = -0.0f;
  return avatar;
}

void expect_same(const Avatar& a, const Avatar& b) {
  EXPECT_EQ(a.spec, b.spec);
  EXPECT_EQ(a.body.glb, b.body.glb);
  EXPECT_EQ(a.body.vertices, b.body.vertices);
  EXPECT_EQ(a.body.skeleton.parents, b.body.skeleton.parents);
  EXPECT_EQ(a.canonical.rest_to_canonical, b.canonical.rest_to_canonical);
  EXPECT_EQ(a.cube.center, b.cube.center);
  EXPECT_EQ(a.cube.cmin, b.cube.cmin);
  EXPECT_EQ(a.cube.cmax, b.cube.cmax);
  EXPECT_EQ(a.latent_frames, b.latent_frames);
  EXPECT_EQ(a.grid, b.grid);
  EXPECT_EQ(a.layout, b.layout);
  ASSERT_EQ(a.parameters.size(), b.parameters.size());
  EXPECT_EQ(std::memcmp(a.parameters.data(), b.parameters.data(), a.parameters.size() * sizeof(float)), 0);
  EXPECT_EQ(a.seed, b.seed);
  EXPECT_EQ(a.steps, b.steps);
  EXPECT_EQ(a.version, b.version);
  EXPECT_EQ(a.settings, b.settings);
}

TEST(AvatarFile, RoundTripIsExact) {
  const TemporaryFolder folder;
  Pose pose = rest_pose(tetrahedron(3).skeleton);
  pose.theta[0] = {0.3, -1.2, 0.4};
  pose.theta[2] = {3.1, 0.1, 0.2};
  const Avatar full = full_avatar(), bare = make_avatar(bare_spec(), tetrahedron(3), {4}, 1, &pose);
  for (const Avatar* avatar : {&full, &bare}) {
    save_avatar(folder / "a.safetensors", *avatar);
    expect_same(load_avatar(folder / "a.safetensors"), *avatar);
    save_avatar(folder / "b.safetensors", load_avatar(folder / "a.safetensors"));
    std::ifstream a(folder / "a.safetensors", std::ios::binary), b(folder / "b.safetensors", std::ios::binary);
    EXPECT_TRUE(std::equal(std::istreambuf_iterator<char>(a), {}, std::istreambuf_iterator<char>(b), {}));
  }
}

TEST(AvatarFile, AnySkinnedBodyFits) {
  const TemporaryFolder folder;
  for (int joints : {1, 2, 64}) {
    const Avatar avatar = make_avatar(full_spec(), tetrahedron(joints), {0}, 3);
    save_avatar(folder / "a.safetensors", avatar);
    expect_same(load_avatar(folder / "a.safetensors"), avatar);
  }
}

TEST(AvatarFile, TensorsHaveTheirNamesAndShapes) {
  const SafetensorsFile file = avatar_tensors(full_avatar());
  EXPECT_EQ(file.at("skinning.0.v").shape, (std::vector<int64_t>{9, 3}));
  EXPECT_EQ(file.at("latent").shape, (std::vector<int64_t>{3, 3}));
  EXPECT_EQ(file.at("b").shape, (std::vector<int64_t>{1}));
  EXPECT_EQ(file.at("grid.1").shape.back(), 4);
  EXPECT_EQ(file.at("template.glb").dtype, "U8");
  EXPECT_EQ(file.at("canonical.rest_to_canonical").shape, (std::vector<int64_t>{3, 4, 4}));
  EXPECT_EQ(file.metadata.at("version"), kVersion);
}

TEST(AvatarFile, OtherTensorsMayRideAlong) {
  SafetensorsFile file = avatar_tensors(full_avatar());
  file.tensors["optimizer.m"] = Tensor::from<float>({2}, {1.0f, NAN});
  file.metadata["optimizer"] = "adam";
  expect_same(avatar_from_tensors(file), full_avatar());
}

TEST(AvatarFile, RefusesWhatIsSpoilt) {
  const SafetensorsFile good = avatar_tensors(full_avatar());
  ASSERT_NO_THROW(avatar_from_tensors(good));
  const auto tensor = [](const char* name, std::size_t index, float value) {
    return [=](SafetensorsFile& file) {
      std::vector<float> values = file.at(name).as<float>();
      values.at(index) = value;
      file.tensors[name] = Tensor::from<float>(file.at(name).shape, values);
    };
  };
  const auto metadata = [](const char* key, const std::string& value) {
    return [=](SafetensorsFile& file) { file.metadata[key] = value; };
  };
  const auto without = [](const char* key) { return [=](SafetensorsFile& file) { file.metadata.erase(key); }; };
  const auto canonical = [](std::size_t index, double value) {
    return [=](SafetensorsFile& file) {
      Tensor& matrices = file.tensors["canonical.rest_to_canonical"];
      std::vector<double> values = matrices.as<double>();
      values.at(index) = value;
      matrices = Tensor::from<double>(matrices.shape, values);
    };
  };
  struct Case {
    std::function<void(SafetensorsFile&)> spoil;
    std::vector<std::string> parts;
  };
  const std::vector<Case> cases{
      {without("arah_avatar"), {"an avatar", "another kind"}},
      {metadata("arah_avatar", "2"), {"arah_avatar", "format 1", "'2'"}},
      {without("version"), {"version"}},
      {without("spec"), {"spec"}},
      {metadata("spec", "{"), {"spec", "JSON"}},
      {metadata("spec", "{}"), {"spec", "preset"}},
      {without("settings"), {"settings"}},
      {metadata("settings", "rays=3"), {"settings", "JSON"}},
      {metadata("settings", "[3]"), {"settings", "an object", "[3]"}},
      {metadata("settings", nested_objects(10'000)), {"settings", "nested at most 64 deep"}},
      {metadata("cube", nested_lists(10'000)), {"cube", "nested at most 64 deep"}},
      {metadata("grid", nested_lists(10'000)), {"grid", "nested at most 64 deep"}},
      {metadata("spec", nested_lists(10'000)), {"spec", "nested at most 64 deep"}},
      {metadata("seed", "-1"), {"seed", "'-1'"}},
      {metadata("seed", "18446744073709551616"), {"seed", "2^64"}},
      {metadata("steps", ""), {"steps"}},
      {metadata("steps", "1e3"), {"steps", "'1e3'"}},
      {metadata("latent_frames", "[1, 2, 1]"), {"latent_frames", "twice"}},
      {metadata("latent_frames", "[1, 2]"), {"tensor \"latent\": shape", "[2, 3]", "[3, 3]"}},
      {metadata("latent_frames", "[]"), {"latent_frames", "at least one"}},
      {metadata("latent_frames", "[1, 2.5, 3]"), {"latent_frames", "2.5"}},
      {metadata("latent_frames", "7"), {"latent_frames", "a list"}},
      {metadata("cube", "{\"center\": [0, 0, 0], \"cmin\": 1, \"cmax\": 1}"), {"cube", "cmin below cmax"}},
      {metadata("cube", "{\"center\": [0, 0], \"cmin\": 0, \"cmax\": 1}"), {"cube center", "3 values"}},
      {metadata("cube", "{\"cmin\": 0, \"cmax\": 1}"), {"cube center"}},
      {metadata("grid", "{}"), {"grid lower"}},
      {metadata("grid", R"({"lower": [0,0,0], "upper": [1,1,1], "nodes": [[2,2,2]]})"), {"grid nodes", "2 values"}},
      {metadata("grid", R"({"lower": [0,0,0], "upper": [1,1,1], "nodes": [[2,2,1],[2,2,2]]})"),
       {"grid nodes", "found 1"}},
      {metadata("grid", R"({"lower": [0,0,0], "upper": [1,0,1], "nodes": [[2,2,2],[2,2,2]]})"), {"grid", "axis 1"}},
      {metadata("grid", R"({"lower": [0,0,0], "upper": [1,1,1], "nodes": [[65536,65536,65536],[2,2,2]]})"),
       {"tensor \"grid.0\": shape", "[65536, 65536, 65536, 4]"}},
      {tensor("color.1.v", 13, NAN), {"tensor \"color.1.v\": element [1, 3] is nan"}},
      {tensor("grid.0", 0, -INFINITY), {"tensor \"grid.0\": element [0, 0, 0, 0] is -inf"}},
      {tensor("b", 0, 0.0f), {"tensor \"b\"", "above 0"}},
      {[](SafetensorsFile& file) { file.tensors.erase("sdf.1.b"); }, {"tensor \"sdf.1.b\"", "none"}},
      {[](SafetensorsFile& file) {
         file.tensors["sdf.0.W"].shape = {3, 11};
       },
       {"\"sdf.0.W\": shape", "[11, 3]", "[3, 11]"}},
      {[](SafetensorsFile& file) { file.tensors["b"] = Tensor::from<double>({1}, {1e-3}); }, {"\"b\": dtype", "F64"}},
      {[](SafetensorsFile& file) { file.tensors.erase("template.glb"); }, {"template.glb", "none"}},
      {[](SafetensorsFile& file) { file.tensors["template.glb"] = Tensor::from<float>({1}, {1.0f}); }, {"U8", "F32"}},
      {[](SafetensorsFile& file) { file.tensors["template.glb"].data[3] = std::byte{0}; }, {"template.glb"}},
      {canonical(0, 2.0), {"canonical.rest_to_canonical", "joint 0", "off by"}},
      {canonical(16, -1.0), {"canonical.rest_to_canonical", "joint 1", "off by"}},
      {canonical(35, std::nan("")), {"joint 2", "not finite"}},
      {canonical(47, 0.5), {"joint 2", "off by 0.5"}},
  };
  for (const Case& c : cases) {
    SafetensorsFile file = good;
    file.path = "person.safetensors";
    c.spoil(file);
    std::vector<std::string> parts = c.parts;
    parts.push_back("person.safetensors");
    SCOPED_TRACE(c.parts.front());
    expect_input_error([&] { avatar_from_tensors(file); }, parts);
  }
}

// As another program would write it: of a file of ours the checksum would be the one to refuse.
TEST(AvatarFile, DamagedBytesNeverGiveABadAvatar) {
  const TemporaryFolder folder;
  save_avatar(folder / "good.safetensors", full_avatar());
  std::ifstream stream(folder / "good.safetensors", std::ios::binary);
  std::string good{std::istreambuf_iterator<char>(stream), {}};
  good.replace(good.find("arah.crc32"), 10, "other.name");
  std::mt19937_64 random(5);
  int refused = 0;
  for (int i = 0; i < 300; ++i) {
    std::string bytes = good;
    if (i % 3 == 0) bytes.resize(random() % bytes.size());
    for (int k = 0; k < 3 && !bytes.empty(); ++k) {
      // Half of the blows fall on the header, where they can do most.
      const std::size_t range = k == 0 ? bytes.size() : std::min<std::size_t>(bytes.size(), 4000);
      bytes[random() % range] = static_cast<char>(random() % 256);
    }
    const std::filesystem::path path = folder.write("bad.safetensors", bytes);
    try {
      const Avatar avatar = load_avatar(path);
      EXPECT_NO_THROW(check_finite(avatar));
      EXPECT_EQ(avatar.parameters.size(), avatar.layout.floats);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("bad.safetensors"));
      ++refused;
    }
  }
  EXPECT_GT(refused, 200);
}

TEST(AvatarFile, AnAvatarThatIsNotFiniteIsNotWritten) {
  const TemporaryFolder folder;
  Avatar avatar = full_avatar();
  avatar.tensor("mapping.0.W")[7] = NAN;
  try {
    save_avatar(folder / "a.safetensors", avatar);
    FAIL() << "written";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("\"mapping.0.W\": element [2, 1] is nan"));
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "a.safetensors"));
}

TEST(Avatar, WithoutSkinningTheOnePoseIsCanonical) {
  const BodyTemplate body = tetrahedron(3);
  Pose pose = rest_pose(body.skeleton);
  pose.theta[1] = {0.5, 0.2, -0.7};
  pose.root_position = {1, 2, 3};
  const Avatar avatar = make_avatar(bare_spec(), body, {}, 0, &pose);
  for (const glm::dmat4& b : bone_transforms(avatar.body.skeleton, avatar.canonical, pose)) {
    for (int c = 0; c < 4; ++c) {
      for (int r = 0; r < 4; ++r) EXPECT_NEAR(b[c][r], c == r ? 1.0 : 0.0, 1e-12);
    }
  }
  EXPECT_THROW(make_avatar(bare_spec(), body, {}, 0), std::invalid_argument);
}

TEST(Avatar, UnseenFramesUseTheLastCode) {
  const Avatar avatar = full_avatar();
  EXPECT_EQ(latent_row(avatar, 12), 0u);
  EXPECT_EQ(latent_row(avatar, 7), 1u);
  EXPECT_EQ(latent_row(avatar, 30), 2u);
  EXPECT_EQ(latent_row(avatar, 8), 2u);
  Pose pose = rest_pose(tetrahedron(3).skeleton);
  EXPECT_THROW(latent_row(make_avatar(bare_spec(), tetrahedron(3), {5}, 0, &pose), 5), std::out_of_range);
}

TEST(Avatar, MakingOneRefusesContradictions) {
  EXPECT_THROW(make_avatar(full_spec(), tetrahedron(2), {3, 3}, 0), std::invalid_argument);
  AvatarSpec spec = full_spec();
  spec.latent_size = 0;
  expect_input_error([&] { make_avatar(spec, tetrahedron(2), {3}, 0); }, {"latent_size"});
}

TEST(Avatar, DescriptionStatesSizesAndCounts) {
  const Avatar avatar = full_avatar();
  const std::string text = describe(avatar);
  EXPECT_THAT(text, HasSubstr("1234 steps"));
  EXPECT_THAT(text, HasSubstr("SDF: 3-11-11-1"));
  EXPECT_THAT(text, HasSubstr("latent codes: 3 frames (7 to 30), 3 numbers each"));
  // Of the SDF: 3·11+11 + 11·11+11 + 11+1.
  EXPECT_THAT(text, HasSubstr("sdf 188,"));
}

TEST(Avatar, OfARealCapture) {
  if (!std::filesystem::is_directory(subject_a())) GTEST_SKIP() << "no capture at " << subject_a();
  const Capture capture = open_capture(subject_a());
  const Avatar avatar = make_avatar(preset_spec("tiny"), capture, 1);
  EXPECT_EQ(avatar.latent_frames.size(), 60u);
  EXPECT_EQ(avatar.latent_frames.back(), 59);
  EXPECT_EQ(avatar.layout.slot("skinning.2.v").shape.front(), 25);
  const TemporaryFolder folder;
  save_avatar(folder / "a.safetensors", avatar);
  expect_same(load_avatar(folder / "a.safetensors"), avatar);
}

}  // namespace
}  // namespace arah
