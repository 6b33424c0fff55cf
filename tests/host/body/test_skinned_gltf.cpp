// The glTF file of a skinned mesh: valid, and what other readers make of it is what the formula says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <random>

#include "host/body/canonical.h"
#include "host/body/skinned_gltf.h"
#include "tests/host/body/glb_reader.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

// A strip of triangles along a chain of five joints, bound in a pose that is not the rest, two correctives, three key frames.
SkinnedModel strip() {
  std::mt19937 generator(3);
  const auto random = [&](double size) { return std::uniform_real_distribution<double>(-size, size)(generator); };
  SkinnedModel model;
  model.name = "strip";
  model.skeleton = chain_skeleton(5);
  const auto random_pose = [&](double angle) {
    Pose pose = rest_pose(model.skeleton);
    for (glm::dvec3& theta : pose.theta) theta = {random(angle), random(angle), random(angle)};
    pose.root_position += glm::dvec3(random(1), random(1), random(1));
    return pose;
  };
  model.rest_to_bind = rest_to_posed(model.skeleton, random_pose(0.8));
  for (int i = 0; i < 42; ++i) {
    model.vertices.emplace_back(0.01 * i, 1 + 0.05 * (i % 2), random(0.05));
    model.normals.push_back(glm::normalize(glm::vec3(random(1), random(1), 2)));
    std::vector<std::pair<uint32_t, float>> influences;
    for (uint32_t j = 0; j < 5; ++j) influences.emplace_back(j, static_cast<float>(std::exp(3 * random(1))));
    const FourInfluences four = greatest_four(influences);
    model.joints.push_back(four.joints);
    model.weights.push_back(i % 5 == 0 ? glm::vec4(1, 0, 0, 0) : four.weights);
    model.uvs.emplace_back(i / 42.0, i % 2);
    if (i >= 2) model.triangles.emplace_back(i - 2 + i % 2, i - 1 - i % 2, i);
  }
  model.texture_png = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  for (const char* name : {"wide", "long"}) {
    model.correctives.push_back({name, {}, {}});
    for (int i = 0; i < 42; ++i) model.correctives.back().offsets.emplace_back(random(0.02), random(0.02), random(0.02));
    if (model.correctives.size() == 2)  // one with normals, one without
      for (int i = 0; i < 42; ++i) model.correctives.back().normal_offsets.emplace_back(random(0.1), random(0.1), random(0.1));
  }
  model.motion = "wave";
  model.frames_per_second = 20;
  for (int f = 0; f < 3; ++f) {
    model.poses.push_back(random_pose(f == 2 ? 3.0 : 1.0));
    model.corrective_weights.push_back({static_cast<float>(random(1)), static_cast<float>(random(1))});
  }
  return model;
}

glm::dvec3 by_formula(const SkinnedModel& model, const CanonicalPose& bind, const Pose& pose, size_t v, const glm::dvec3& vertex) {
  const std::vector<glm::dmat4> bones = bone_transforms(model.skeleton, bind, pose);
  glm::dvec4 sum(0.0);
  for (int k = 0; k < 4; ++k) sum += double{model.weights[v][k]} * (bones[model.joints[v][k]] * glm::dvec4(vertex, 1.0));
  return glm::dvec3(sum) + root_translation(model.skeleton, pose);
}

TEST(SkinnedGltfTest, IsValidAndMovesAsTheFormulaSays) {
  const SkinnedModel model = strip();
  const GlbReader file(skinned_glb(model));
  EXPECT_THAT(file.complaints(), testing::IsEmpty());
  EXPECT_EQ(file.json["nodes"][2]["name"], "bone_2");
  EXPECT_EQ(file.json["meshes"][0]["extras"]["targetNames"], nlohmann::json({"wide", "long"}));
  EXPECT_EQ(file.json["animations"][0]["name"], "wave");
  EXPECT_FALSE(file.primitive()["targets"][0].contains("NORMAL"));
  EXPECT_EQ(file.vectors(file.primitive()["targets"][1]["NORMAL"])[7], glm::dvec3(model.correctives[1].normal_offsets[7]));

  const CanonicalPose bind{model.rest_to_bind};
  double worst = 0;
  for (size_t f = 0; f < model.poses.size(); ++f) {
    const std::vector<glm::dvec3> posed = file.posed(double(f) / 20);
    for (size_t v = 0; v < posed.size(); ++v) {
      glm::dvec3 vertex(model.vertices[v]);
      for (size_t k = 0; k < 2; ++k) vertex += double{model.corrective_weights[f][k]} * glm::dvec3(model.correctives[k].offsets[v]);
      worst = std::max(worst, glm::distance(posed[v], by_formula(model, bind, model.poses[f], v, vertex)));
    }
  }
  const std::vector<glm::dvec3> rest = file.posed({});
  for (size_t v = 0; v < rest.size(); ++v) worst = std::max(worst, glm::distance(rest[v], by_formula(model, bind, rest_pose(model.skeleton), v, glm::dvec3(model.vertices[v]))));
  std::printf("  off the formula by %.1e m at most\n", worst);
  EXPECT_LT(worst, 2e-6);  // float32 numbers of a metre
}

// Our own reader takes the bind pose for the rest: the bones then go from there.
TEST(SkinnedGltfTest, ReadsBackAsATemplateThatRestsInTheBindPose) {
  const TemporaryFolder folder;
  const SkinnedModel model = strip();
  const std::vector<std::uint8_t> bytes = skinned_glb(model);
  const BodyTemplate body = read_body_template(folder.write("strip.glb", {bytes.begin(), bytes.end()}));
  ASSERT_EQ(body.vertices.size(), model.vertices.size());
  EXPECT_EQ(body.skeleton.names, model.skeleton.names);
  EXPECT_EQ(body.skeleton.parents, model.skeleton.parents);
  double worst = 0;
  for (const Pose& pose : model.poses) {
    const CanonicalPose bind{model.rest_to_bind};
    const std::vector<glm::dvec3> posed = skinned_vertices(body, bone_transforms(model.skeleton, bind, pose));
    for (size_t v = 0; v < posed.size(); ++v) worst = std::max(worst, glm::distance(posed[v] + root_translation(model.skeleton, pose), by_formula(model, bind, pose, v, glm::dvec3(model.vertices[v]))));
  }
  EXPECT_LT(worst, 1e-6);
  for (size_t j = 0; j < 5; ++j) EXPECT_LT(glm::distance(body.skeleton.rest_joints[j], glm::dvec3(model.rest_to_bind[j] * glm::dvec4(model.skeleton.rest_joints[j], 1.0))), 1e-6);
}

TEST(SkinnedGltfTest, KeepsTheGreatestFourInfluences) {
  const FourInfluences four = greatest_four({{7, 0.1f}, {3, 0.3f}, {9, 0.05f}, {1, 0.25f}, {4, 0.2f}, {2, 0.1f}});
  EXPECT_EQ(four.joints, glm::u8vec4(3, 1, 4, 7));
  EXPECT_NEAR(four.lost, 0.15, 1e-7);
  EXPECT_NEAR(four.weights.x, 0.3 / 0.85, 1e-7);
  EXPECT_NEAR(four.weights.x + four.weights.y + four.weights.z + four.weights.w, 1, 1e-6);
  EXPECT_EQ(greatest_four({{5, 0.5f}}).weights, glm::vec4(1, 0, 0, 0));
  EXPECT_THROW(greatest_four({}), std::invalid_argument);
}

TEST(SkinnedGltfTest, HoldsAMeshThatDoesNotMove) {
  SkinnedModel model = strip();
  model.skeleton = {};
  model.rest_to_bind.clear(), model.joints.clear(), model.weights.clear(), model.poses.clear(), model.corrective_weights.clear(), model.correctives.clear();
  model.texture_png.clear(), model.uvs.clear();
  model.colors.assign(model.vertices.size(), glm::vec3(0.5f, 1.0f, 0.02f));
  const GlbReader file(skinned_glb(model));
  EXPECT_THAT(file.complaints(), testing::IsEmpty());
  EXPECT_FALSE(file.json.contains("skins"));
  EXPECT_NEAR(file.attribute("COLOR_0")[0].x, 0.21404114, 1e-6);  // linear light of sRGB's 0.5
  EXPECT_NEAR(file.attribute("COLOR_0")[0].z, 0.02 / 12.92, 1e-6);
  EXPECT_EQ(file.posed({})[5], glm::dvec3(model.vertices[5]));
  model.normals.pop_back();
  EXPECT_THROW(skinned_glb(model), std::invalid_argument);
}

// What the reader of this test would overlook, the authors of the format do not.
TEST(SkinnedGltfTest, SatisfiesTheKhronosValidator) {
  const TemporaryFolder folder;
  SkinnedModel model = strip();
  model.texture_png.clear(), model.uvs.clear();
  const std::vector<std::uint8_t> bytes = skinned_glb(model);
  const auto report = khronos_report(folder.write("strip.glb", {bytes.begin(), bytes.end()}));
  if (!report) GTEST_SKIP() << "neither gltf_validator nor node's package gltf-validator is installed";
  EXPECT_EQ((*report)["issues"]["numErrors"], 0) << (*report)["issues"].dump(1);
  EXPECT_EQ((*report)["issues"]["numWarnings"], 0) << (*report)["issues"].dump(1);
}

// The file's checker notices what it is there for.
TEST(SkinnedGltfTest, ABrokenFileIsNoticed) {
  const auto broken = [](const auto& change) {
    GlbReader file(skinned_glb(strip()));
    change(file);
    return file.complaints();
  };
  const auto first_of = [](GlbReader& file, size_t accessor) { return file.json["bufferViews"][file.json["accessors"][accessor]["bufferView"].get<size_t>()].value("byteOffset", size_t{0}); };
  const auto attribute = [](GlbReader& file, const char* name) { return file.primitive()["attributes"][name].template get<size_t>(); };
  EXPECT_THAT(broken([](GlbReader&) {}), testing::IsEmpty());
  EXPECT_THAT(broken([&](GlbReader& file) { file.json["accessors"][attribute(file, "POSITION")]["max"][0] = 9; }), testing::Contains(testing::HasSubstr("max of component 0")));
  EXPECT_THAT(broken([&](GlbReader& file) { file.binary[first_of(file, attribute(file, "JOINTS_0"))] = 200; }), testing::Contains(testing::HasSubstr("joints that there are")));
  EXPECT_THAT(broken([&](GlbReader& file) { file.binary[first_of(file, attribute(file, "WEIGHTS_0")) + 3] ^= 1; }), testing::Contains(testing::HasSubstr("sum to")));
  EXPECT_THAT(broken([&](GlbReader& file) { file.binary[first_of(file, file.primitive()["indices"]) + 2] = 1; }), testing::Contains("indices in range"));
  EXPECT_THAT(broken([&](GlbReader& file) { file.json["accessors"][attribute(file, "NORMAL")]["count"] = 400; }), testing::Contains(testing::HasSubstr("within its view")));
  EXPECT_THAT(broken([&](GlbReader& file) { file.binary[first_of(file, file.json["animations"][0]["samplers"][1]["output"]) + 3] ^= 1; }), testing::Contains("unit quaternions"));
}

}  // namespace
}  // namespace arah
