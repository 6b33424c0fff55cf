// A body's shape from a file's morph targets: what is read, what β does, what comes back from writing, and what is refused.
#include "host/body/shape_space.h"

#include <functional>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "tests/host/body/glb_parts.h"
#include "tests/host/body/glb_reader.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

const std::vector<float> kLonger = {0, 0, 0, 0.1f, 0, 0, 0, 0.05f, 0, 0, 0, 0.2f}, kThicker = {0, 0, -0.01f, 0, 0, 0, 0.03f, 0, 0, 0, 0.02f, 0};

// The tetrahedron with two targets.
Parts with_targets(int joints) {
  Parts parts(tetrahedron(joints));
  parts.primitive()["targets"] = {{{"POSITION", parts.add_floats(kLonger, "VEC3", 4)}}, {{"POSITION", parts.add_floats(kThicker, "VEC3", 4)}}};
  parts.head["meshes"][0]["extras"] = {{"targetNames", {"longer", "thicker"}}};
  return parts;
}

TEST(ShapeSpace, IsEmptyWithoutTargets) {
  const BodyTemplate body = read(Parts(tetrahedron(3)));
  EXPECT_EQ(body.shape.size(), 0u);
  EXPECT_FALSE(body.shape.moves_joints());
  EXPECT_TRUE(body.shape.base_vertices.empty());
}

TEST(ShapeSpace, OpensTheBaseWhereWeightsAreZeroOrAbsent) {
  Parts parts = with_targets(3);
  for (const bool stated : {false, true}) {
    if (stated) parts.head["meshes"][0]["weights"] = {0, 0};
    const BodyTemplate body = read(parts);
    EXPECT_EQ(body.vertices, tetrahedron(3).vertices);
    EXPECT_EQ(body.normals, tetrahedron(3).normals);
    EXPECT_EQ(body.skeleton.rest_joints, read(Parts(tetrahedron(3))).skeleton.rest_joints);
    EXPECT_EQ(body.shape.names, (std::vector<std::string>{"longer", "thicker"}));
    EXPECT_EQ(body.shape.beta, (std::vector<double>{0, 0}));
    EXPECT_EQ(body.shape.vertex_offsets[0][3], glm::vec3(0, 0, 0.2f));
  }
}

TEST(ShapeSpace, OpensTheBodyThatTheWeightsStateAsViewersShowIt) {
  Parts parts = with_targets(3);
  parts.head["meshes"][0]["weights"] = {0.5, -2};
  const BodyTemplate body = read(parts), base = tetrahedron(3);
  for (size_t v = 0; v < 4; ++v)
    for (int axis = 0; axis < 3; ++axis) {
      const size_t i = 3 * v + static_cast<size_t>(axis);
      EXPECT_EQ(body.vertices[v][axis], static_cast<float>(double{base.vertices[v][axis]} + 0.5 * double{kLonger[i]} - 2 * double{kThicker[i]}));
    }
  EXPECT_EQ(body.shape.base_vertices, base.vertices);
  for (size_t j = 0; j < 3; ++j) EXPECT_EQ(body.skeleton.rest_joints[j], body.shape.base_joints[j] + 0.5 * body.shape.joint_offsets[0][j] - 2.0 * body.shape.joint_offsets[1][j]);
  // A node's weights go before its mesh's.
  parts.head["nodes"][3]["weights"] = {0, 0};
  EXPECT_EQ(read(parts).vertices, base.vertices);
}

TEST(ShapeSpace, ReturnsToTheBaseBitForBit) {
  Parts parts = with_targets(4);
  parts.set_floats("POSITION", {-0.0f, 1, 1e-30f, 0.3f, 1, -0.0f, 0, 1.3f, 0, 0, 1, 0.3f}, "VEC3", 4);
  BodyTemplate body = read(parts);
  const BodyTemplate base = body;
  const CanonicalPose canonical = make_canonical_pose(body.skeleton);
  Pose pose = rest_pose(body.skeleton);
  pose.theta[2] = {0.3, -0.2, 0.9};
  const std::vector<glm::dmat4> before = bone_transforms(body.skeleton, canonical, pose);
  set_shape(body, {1, 3});
  EXPECT_NE(body.vertices, base.vertices);
  EXPECT_NE(bone_transforms(body.skeleton, canonical, pose), before);
  {
    const InShape other(body, {-1, 0});
    EXPECT_EQ(body.shape.beta[0], -1);
  }
  EXPECT_EQ(body.shape.beta, (std::vector<double>{1, 3}));
  set_shape(body, {0, 0});
  EXPECT_EQ(std::memcmp(body.vertices.data(), base.vertices.data(), sizeof(glm::vec3) * 4), 0) << "signs of zeros too";
  EXPECT_EQ(body.skeleton.rest_joints, base.skeleton.rest_joints);
  EXPECT_EQ(bone_transforms(body.skeleton, canonical, pose), before);
  EXPECT_THROW(set_shape(body, {1}), std::invalid_argument);
}

TEST(ShapeSpace, ReadsBackWhatItWroteBitForBit) {
  Parts parts = with_targets(3);
  parts.head["meshes"][0]["extras"]["joint_shapedirs"] = {{{0, 0, 0}, {0.1, 1.0 / 3, 1e-9}, {0, -0.7, 0}}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}};
  parts.head["meshes"][0]["weights"] = {0.1, -1.0 / 7};
  const BodyTemplate body = read(parts), back = read_body_template_bytes(body_template_glb(body), "back.glb");
  EXPECT_EQ(back.shape.names, body.shape.names);
  EXPECT_EQ(back.shape.beta, body.shape.beta);
  EXPECT_EQ(back.shape.vertex_offsets, body.shape.vertex_offsets);
  EXPECT_EQ(back.shape.joint_offsets, body.shape.joint_offsets);
  EXPECT_EQ(back.shape.joint_offsets[0][1], glm::dvec3(0.1, 1.0 / 3, 1e-9));
  EXPECT_EQ(back.shape.base_vertices, body.shape.base_vertices);
  EXPECT_EQ(back.shape.base_joints, body.shape.base_joints);
  EXPECT_EQ(back.vertices, body.vertices);
  EXPECT_EQ(back.skeleton.rest_joints, body.skeleton.rest_joints);
  EXPECT_EQ(body_template_glb(back), body_template_glb(body));
  EXPECT_EQ(Parts(body).head["meshes"][0]["weights"], (nlohmann::json{0.1, -1.0 / 7}));
}

// Targets, their weights and the extras are what other programs open too.
TEST(ShapeSpace, SatisfiesTheKhronosValidator) {
  const TemporaryFolder folder;
  Parts parts = with_targets(3);
  parts.head["meshes"][0]["weights"] = {0.5, -2};
  write_body_template(folder / "shaped.glb", read(parts));
  const auto report = khronos_report(folder / "shaped.glb");
  if (!report) GTEST_SKIP() << "neither gltf_validator nor node's package gltf-validator is installed";
  EXPECT_EQ((*report)["issues"]["numErrors"], 0) << (*report)["issues"].dump(1);
  EXPECT_EQ((*report)["issues"]["numWarnings"], 0) << (*report)["issues"].dump(1);
  EXPECT_EQ((*report)["info"]["hasMorphTargets"], true);
}

TEST(ShapeSpace, TurnsAndScalesDisplacementsWithTheArmature) {
  Parts parts = with_targets(3);
  parts.head["meshes"][0]["extras"]["joint_shapedirs"] = {{{0, 0, 0}, {0, 0, 0}, {0, 1, 0}}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 2}}};
  const std::size_t armature = parts.head["nodes"].size();
  parts.head["nodes"].push_back({{"name", "Armature"}, {"children", {0}}, {"scale", {0.01, 0.01, 0.01}}, {"translation", {5, 6, 7}}, {"rotation", {-std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)}}});
  parts.head["scenes"][0]["nodes"] = {armature, 3};
  const BodyTemplate body = read(parts);
  // −90° about x: (x, y, z) → (x, z, −y).
  for (size_t v = 0; v < 4; ++v) {
    const glm::vec3 d = glm::vec3(kLonger[3 * v], kLonger[3 * v + 1], kLonger[3 * v + 2]) * 0.01f;
    EXPECT_LT(glm::length(body.shape.vertex_offsets[0][v] - glm::vec3(d.x, d.z, -d.y)), 1e-9f);
  }
  EXPECT_LT(glm::length(body.shape.joint_offsets[0][2] - glm::dvec3(0, 0, -0.01)), 1e-12);
  EXPECT_LT(glm::length(body.shape.joint_offsets[1][2] - glm::dvec3(0, 0.02, 0)), 1e-12);
}

// The skin's joints run backwards, so joint_shapedirs do too.
TEST(ShapeSpace, PutsStatedJointsWhereTheSkeletonHasThem) {
  Parts parts = with_targets(3);
  parts.head["skins"][0]["joints"] = {2, 1, 0};
  parts.head["skins"][0].erase("inverseBindMatrices");
  parts.head["meshes"][0]["extras"]["joint_shapedirs"] = {{{2, 0, 0}, {1, 0, 0}, {0.5, 0, 0}}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}};
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.shape.joint_offsets[0], (std::vector<glm::dvec3>{{0.5, 0, 0}, {1, 0, 0}, {2, 0, 0}}));
}

// Where the file states nothing: vertices 1 and 2 are of joints 1 (0.75, 0.5) and 0 (0.25, 0.5), 0 of joint 0, 3 of joint 1.
TEST(ShapeSpace, TakesJointsFromTheSeamBetweenBones) {
  const BodyTemplate two = read(with_targets(2));
  const glm::dvec3 d1(0.1f, 0, 0), d2(0, 0.05f, 0), d3(0, 0, 0.2f);
  EXPECT_LT(glm::length(two.shape.joint_offsets[0][0] - (0.25 * d1 + 0.5 * d2) / 1.75), 1e-12);
  EXPECT_LT(glm::length(two.shape.joint_offsets[0][1] - (0.75 * 0.25 * d1 + 0.25 * d2) / (0.75 * 0.25 + 0.25)), 1e-12);
  EXPECT_TRUE(two.shape.moves_joints());
  // Joint 3 shares no vertex with its parent, joint 2, which has none at all, as joint 1.
  const BodyTemplate four = read(with_targets(4));
  EXPECT_LT(glm::length(four.shape.joint_offsets[0][3] - (0.75 * d1 + 0.5 * d2 + d3) / 2.25), 1e-7);
  EXPECT_EQ(four.shape.joint_offsets[0][1], four.shape.joint_offsets[0][0]);
  EXPECT_EQ(four.shape.joint_offsets[0][2], four.shape.joint_offsets[0][0]);
}

TEST(ShapeSpace, ReadsSparseTargets) {
  Parts parts = with_targets(3);
  const std::size_t first = parts.head["accessors"].size();
  // Over nothing, and over dense data; indices of different sizes.
  const std::size_t indices16 = parts.add_view(std::vector<uint16_t>{1, 3}), indices8 = parts.add_view(std::vector<uint8_t>{2});
  const std::size_t values = parts.add_view(std::vector<float>{1, 2, 3, 4, 5, 6});
  parts.head["accessors"].push_back({{"componentType", 5126}, {"type", "VEC3"}, {"count", 4}, {"sparse", {{"count", 2}, {"indices", {{"bufferView", indices16}, {"componentType", 5123}}}, {"values", {{"bufferView", values}}}}}});
  nlohmann::json over = parts.head["accessors"][parts.primitive()["targets"][0]["POSITION"].get<size_t>()];
  over["sparse"] = {{"count", 1}, {"indices", {{"bufferView", indices8}, {"componentType", 5121}}}, {"values", {{"bufferView", values}, {"byteOffset", 12}}}};
  parts.head["accessors"].push_back(over);
  parts.primitive()["targets"] = {{{"POSITION", first}}, {{"POSITION", first + 1}}};
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.shape.vertex_offsets[0], (std::vector<glm::vec3>{{0, 0, 0}, {1, 2, 3}, {0, 0, 0}, {4, 5, 6}}));
  EXPECT_EQ(body.shape.vertex_offsets[1], (std::vector<glm::vec3>{{0, 0, 0}, {0.1f, 0, 0}, {4, 5, 6}, {0, 0, 0.2f}}));

  const std::vector<std::pair<std::function<void(nlohmann::json&)>, std::vector<std::string>>> cases = {
      {[](auto& a) { a["count"] = 1000000000; }, {"4 elements", "1000000000"}},
      {[](auto& a) { a["sparse"]["count"] = 5; }, {"0 to 4 sparse elements", "5"}},
      {[](auto& a) { a["sparse"]["count"] = -1; }, {"0 to 4 sparse elements"}},
      {[](auto& a) { a["sparse"]["indices"]["byteOffset"] = 2; }, {"ends before"}},
      {[](auto& a) { a["sparse"]["indices"]["componentType"] = 5126; }, {"unsigned sparse indices"}},
      {[](auto& a) { a["sparse"]["indices"]["bufferView"] = 99; }, {"buffer view"}},
      {[](auto& a) { a["sparse"]["values"]["byteOffset"] = 8; }, {"ends before"}},
  };
  for (size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    Parts bad = parts;
    cases[i].first(bad.head["accessors"][first]);
    expect_input_error([&] { read(bad); }, cases[i].second);
  }
  parts.buffer[parts.head["bufferViews"][indices16]["byteOffset"].get<size_t>()] = 4;
  expect_input_error([&] { read(parts); }, {"sparse elements below 4", "element 4"});
}

TEST(ShapeSpace, LeavesOutWhatSaysNothingOfTheShape) {
  Parts parts = with_targets(3);
  nlohmann::json& mesh = parts.head["meshes"][0];
  // A target of normals alone keeps its number among the weights.
  const nlohmann::json normals = nlohmann::json::object({{"NORMAL", parts.add_floats(kLonger, "VEC3", 4)}});
  parts.primitive()["targets"].insert(parts.primitive()["targets"].begin(), normals);
  mesh["extras"]["targetNames"] = {"shine", "longer", "thicker"};
  mesh["weights"] = {9, 1, 0};
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.shape.names, (std::vector<std::string>{"longer", "thicker"}));
  EXPECT_EQ(body.shape.beta, (std::vector<double>{1, 0}));
  // Names that are not there, or no names.
  mesh["extras"]["targetNames"] = {1, 2};
  EXPECT_EQ(read(parts).shape.names, (std::vector<std::string>{"shape_1", "shape_2"}));
  mesh["extras"] = "a text";
  EXPECT_EQ(read(parts).shape.names, (std::vector<std::string>{"shape_1", "shape_2"}));
}

TEST(ShapeSpace, OpensAMeshWithExpressionsOfAFaceAsItIs) {
  Parts parts = with_targets(3);
  const nlohmann::json one = parts.primitive()["targets"][0];
  parts.primitive()["targets"] = std::vector<nlohmann::json>(kMaxShapes, one);
  parts.head["meshes"][0]["weights"] = std::vector<double>(kMaxShapes, 1.0);
  EXPECT_EQ(read(parts).shape.size(), kMaxShapes);
  parts.primitive()["targets"].push_back(one);
  parts.head["meshes"][0]["weights"].push_back(1.0);
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.shape.size(), 0u);
  EXPECT_EQ(body.vertices, tetrahedron(3).vertices);
  EXPECT_THAT(body.shape.ignored, testing::HasSubstr("65 morph targets"));
}

// A body and its eyes, each a mesh: "longer" moves both, "blink" the eyes alone.
TEST(ShapeSpace, TakesTargetsOfOneNameInSeveralMeshesAsOne) {
  Parts parts = with_targets(3);
  nlohmann::json eyes = parts.head["meshes"][0];
  eyes["extras"]["targetNames"] = {"blink", "longer"};
  parts.head["meshes"].push_back(eyes);
  nlohmann::json node = parts.head["nodes"][3];
  node["mesh"] = 1;
  parts.head["nodes"].push_back(node);
  parts.head["scenes"][0]["nodes"].push_back(parts.head["nodes"].size() - 1);
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.shape.names, (std::vector<std::string>{"longer", "thicker", "blink"}));
  EXPECT_EQ(body.shape.vertex_offsets[0][1], glm::vec3(0.1f, 0, 0));
  EXPECT_EQ(body.shape.vertex_offsets[0][6], glm::vec3(0.03f, 0, 0)) << "the eyes' second target";
  EXPECT_EQ(body.shape.vertex_offsets[1][6], glm::vec3(0));
  EXPECT_EQ(body.shape.vertex_offsets[2][2], glm::vec3(0));
  EXPECT_EQ(body.shape.vertex_offsets[2][5], glm::vec3(0.1f, 0, 0));
  // In another shape the eyes' target cannot be the body's.
  parts.head["meshes"][1]["weights"] = {0, 0.5};
  EXPECT_EQ(read(parts).shape.names, (std::vector<std::string>{"longer", "thicker", "blink", "longer"}));
}

TEST(ShapeSpace, RefusesTargetsThatDoNotFit) {
  const std::vector<std::pair<std::function<void(Parts&)>, std::vector<std::string>>> cases = {
      {[](Parts& p) { p.primitive()["targets"][1]["POSITION"] = p.add_floats({0, 0, 0}, "VEC3", 1); }, {"target 1", "4 displacements", "1"}},
      {[](Parts& p) { p.primitive()["targets"][1]["POSITION"] = p.add_floats(std::vector<float>(12, INFINITY), "VEC3", 4); }, {"target 1", "vertex 0", "finite"}},
      {[](Parts& p) { p.primitive()["targets"][0]["POSITION"] = 999; }, {"target 0", "accessor 999"}},
      {[](Parts& p) { p.head["meshes"][0]["weights"] = {1}; }, {"weights", "2, one for each", "1"}},
      {[](Parts& p) {
         p.head["meshes"][0]["primitives"].push_back(p.primitive());
         p.head["meshes"][0]["primitives"][1].erase("targets");
       },
       {"2 morph targets in each primitive", "0"}},
      {[](Parts& p) { p.head["meshes"][0]["extras"]["joint_shapedirs"] = {1}; }, {"joint_shapedirs", "a list of 2", "1"}},
      {[](Parts& p) { p.head["meshes"][0]["extras"]["joint_shapedirs"] = {{{0, 0, 0}}, {{0, 0, 0}}}; }, {"joint_shapedirs[0]", "a list of 3", "1"}},
      {[](Parts& p) { p.head["meshes"][0]["extras"]["joint_shapedirs"] = {{{0, 0, 0}, {0, 0}, {0, 0, 0}}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}; }, {"joint_shapedirs[0][1]", "three finite numbers"}},
  };
  for (size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    Parts parts = with_targets(3);
    cases[i].first(parts);
    expect_input_error([&] { read(parts); }, cases[i].second);
  }
}

TEST(ShapeSpace, ReadsTheSubjectOfTheCaptures) {
  if (!std::filesystem::exists(subject_a())) GTEST_SKIP() << "no capture at " << subject_a();
  const BodyTemplate body = read_body_template(subject_a() / "template.glb");
  EXPECT_EQ(body.shape.names, (std::vector<std::string>{"weight+", "muscle+", "weight-", "muscle-"}));
  EXPECT_FALSE(body.shape.moves_joints()) << "the file states that its targets leave the joints where they are";
  EXPECT_EQ(body.vertices, body.shape.base_vertices);
}

}  // namespace
}  // namespace arah
