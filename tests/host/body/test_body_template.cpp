#include <functional>
#include <glm/geometric.hpp>

#include "host/body/body_template.h"
#include "host/body/canonical.h"
#include "tests/host/body/glb_parts.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

TEST(BodyTemplate, ReadsBackWhatItWrote) {
  const TemporaryFolder folder;
  for (int joints : {1, 3, 64}) {
    const BodyTemplate body = tetrahedron(joints);
    write_body_template(folder / "body.glb", body);
    const BodyTemplate back = read_body_template(folder / "body.glb");
    EXPECT_EQ(back.skeleton.names, body.skeleton.names);
    EXPECT_EQ(back.skeleton.parents, body.skeleton.parents);
    EXPECT_EQ(back.vertices, body.vertices);
    EXPECT_EQ(back.normals, body.normals);
    EXPECT_EQ(back.triangles, body.triangles);
    EXPECT_EQ(back.joints, body.joints);
    EXPECT_EQ(back.weights, body.weights);
    EXPECT_EQ(back.glb, body_template_glb(body));
    for (std::size_t j = 0; j < body.skeleton.size(); ++j) {
      const glm::dvec3& joint = body.skeleton.rest_joints[j];  // stored in single precision
      EXPECT_LT(glm::length(back.skeleton.rest_joints[j] - joint), 1e-7 * glm::length(joint)) << j;
    }
  }
}

TEST(BodyTemplate, RefusesASixtyFifthJoint) {
  expect_input_error([] { body_template_glb(tetrahedron(65)); }, {"1 to 64 joints", "65"});
  Parts parts(tetrahedron(64));
  parts.head["nodes"].push_back({{"name", "one_more"}});
  parts.head["nodes"][0]["children"].push_back(65);
  parts.head["skins"][0]["joints"].push_back(65);
  expect_input_error([&] { read(parts); }, {"figure.glb", "1 to 64 joints", "65"});
}

TEST(BodyTemplate, PutsParentsBeforeChildren) {
  Parts parts(tetrahedron(4));
  // The skin lists the chain backwards, and each vertex' joint indices follow its list.
  parts.head["skins"][0]["joints"] = {3, 2, 1, 0};
  std::swap(parts.head["nodes"][1]["name"], parts.head["nodes"][2]["name"]);
  parts.head["skins"][0].erase("inverseBindMatrices");
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.skeleton.names, (std::vector<std::string>{"bone_0", "bone_2", "bone_1", "bone_3"}));
  EXPECT_EQ(body.skeleton.parents, (std::vector<int>{-1, 0, 1, 2}));
  EXPECT_EQ(body.joints[0].x, 3);  // slot 0 of the list is the last of the chain
}

TEST(BodyTemplate, AppliesTheArmaturesTurnAndScale) {
  // An armature node in centimetres that lies on its back, as many exporters write it.
  Parts parts(tetrahedron(3));
  const std::size_t armature = parts.head["nodes"].size();
  parts.head["nodes"].push_back({{"name", "Armature"},
                                 {"children", {0}},
                                 {"scale", {0.01, 0.01, 0.01}},
                                 {"rotation", {-std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)}}});
  parts.head["scenes"][0]["nodes"] = {armature, 3};
  const BodyTemplate plain = tetrahedron(3), body = read(parts);
  // −90° about x: (x, y, z) → (x, z, −y).
  for (std::size_t i = 0; i < plain.vertices.size(); ++i) {
    const glm::vec3 v = plain.vertices[i] * 0.01f;
    EXPECT_LT(glm::length(body.vertices[i] - glm::vec3(v.x, v.z, -v.y)), 1e-8f);
    EXPECT_NEAR(glm::length(body.normals[i]), 1.0f, 1e-6f);
  }
  const glm::dvec3 joint = plain.skeleton.rest_joints[2] * 0.01;
  EXPECT_LT(glm::length(body.skeleton.rest_joints[2] - glm::dvec3(joint.x, joint.z, -joint.y)), 1e-8);
  parts.head["nodes"][armature]["scale"] = {0.01, 0.02, 0.01};
  expect_input_error([&] { read(parts); }, {"armature", "evenly scaled"});
}

TEST(BodyTemplate, TakesThePositionsOfTurnedRestFrames) {
  // A joint frame turned by 90° about y at (−0.25, 2, 0.5), and its inverse [R | −R J], column by column.
  Parts parts(tetrahedron(1));
  parts.head["nodes"][0]["rotation"] = {0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)};
  parts.head["nodes"][0]["translation"] = {-0.25, 2.0, 0.5};
  parts.set_floats("unused", {0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0.5f, -2, 0.25f, 1}, "MAT4", 1);
  parts.head["skins"][0]["inverseBindMatrices"] = parts.head["accessors"].size() - 1;
  const BodyTemplate body = read(parts);
  EXPECT_LT(glm::length(body.skeleton.rest_joints[0] - glm::dvec3(-0.25, 2.0, 0.5)), 1e-12);
  EXPECT_EQ(body.vertices, tetrahedron(1).vertices);
}

TEST(BodyTemplate, TakesTheBindPoseWhateverPoseTheNodesStandIn) {
  Parts parts(tetrahedron(3));
  parts.head["nodes"][1]["rotation"] = {0.6, 0.0, 0.0, 0.8};
  parts.head["nodes"][0]["rotation"] = {0.0, 0.0, 1.0, 0.0};
  const BodyTemplate body = read(parts);
  EXPECT_EQ(body.vertices, tetrahedron(3).vertices);
  EXPECT_LT(glm::length(body.skeleton.rest_joints[2] - tetrahedron(3).skeleton.rest_joints[2]), 1e-7);
}

TEST(BodyTemplate, MergesPrimitivesNormalisesWeightsAndMakesNormals) {
  Parts parts(tetrahedron(3));
  parts.set_floats("WEIGHTS_0", {2, 0, 0, 0, 3, 1, 0, 0, 0.1f, 0.1f, 0, 0, 1, 0, 0, 0}, "VEC4", 4);
  parts.primitive()["attributes"].erase("NORMAL");
  parts.head["meshes"][0]["primitives"].push_back(parts.primitive());
  const BodyTemplate body = read(parts);
  ASSERT_EQ(body.vertices.size(), 8u);
  EXPECT_EQ(body.triangles[4], glm::uvec3(4, 6, 5));
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(body.weights[i], tetrahedron(3).weights[i % 4]);
  // Vertex 0 touches the three axis-parallel faces, of equal area.
  EXPECT_LT(glm::length(body.normals[0] + glm::vec3(std::sqrt(1.0f / 3.0f))), 1e-6f);
}

TEST(BodyTemplate, RefusesWhatItCannotTrust) {
  const std::vector<std::pair<std::function<void(Parts*)>, std::vector<std::string>>> cases = {
      {[](Parts* p) { p->head.erase("skins"); }, {"no skin", "armature"}},
      {[](Parts* p) { p->primitive()["attributes"].erase("JOINTS_0"); }, {"JOINTS_0"}},
      {[](Parts* p) { p->primitive()["attributes"]["JOINTS_1"] = 2; }, {"four"}},
      {[](Parts* p) { p->primitive()["mode"] = 5; }, {"triangles", "mode 5"}},
      {[](Parts* p) { p->set_floats("WEIGHTS_0", std::vector<float>(16, 0.0f), "VEC4", 4); },
       {"vertex 0", "no weight"}},
      {[](Parts* p) { p->set_floats("WEIGHTS_0", std::vector<float>(16, -1.0f), "VEC4", 4); }, {"vertex 0", "-1"}},
      {[](Parts* p) { p->set_floats("JOINTS_0", std::vector<float>(16, 9.0f), "VEC4", 4); }, {"3 joints", "joint 9"}},
      {[](Parts* p) { p->set_floats("POSITION", std::vector<float>(12, NAN), "VEC3", 4); }, {"finite position", "NaN"}},
      {[](Parts* p) { p->head["accessors"][0]["count"] = 1000000; }, {"POSITION", "ends before"}},
      {[](Parts* p) { p->head["bufferViews"][0]["byteOffset"] = 4000000000u; }, {"POSITION", "ends before"}},
      {[](Parts* p) { p->head["accessors"][0]["type"] = "VEC4"; }, {"POSITION", "elements of 3"}},
      {[](Parts* p) { p->head["accessors"][4]["count"] = 11; }, {"three indices a triangle", "11"}},
      {[](Parts* p) { p->buffer[p->head["bufferViews"][4]["byteOffset"].get<std::size_t>()] = 77; }, {"index 0", "77"}},
      {[](Parts* p) { p->head["nodes"][2]["children"] = {0}; }, {"figure.glb", "node"}},
      {[](Parts* p) { p->head["nodes"][0].erase("children"); }, {"one root joint", "bone_0", "bone_1"}},
      {[](Parts* p) { p->head["nodes"][1]["name"] = "bone_0"; }, {"bone_0", "twice"}},
      {[](Parts* p) { p->head["extensionsRequired"] = {"KHR_draco_mesh_compression"}; }, {"without compression"}},
      {[](Parts* p) { p->head["nodes"][3].erase("skin"); }, {"triangles that the skin moves", "none"}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    Parts parts(tetrahedron(3));
    cases[i].first(&parts);
    expect_input_error([&] { read(parts); }, cases[i].second);
  }
}

TEST(BodyTemplate, RefusesMissingEmptyAndTruncatedFiles) {
  const TemporaryFolder folder;
  expect_input_error([&] { read_body_template(folder / "none.glb"); }, {"none.glb", "none that can be opened"});
  expect_input_error([&] { read_body_template(folder.path()); }, {"none that can be opened"});
  expect_input_error([&] { read_body_template(folder.write("empty.glb", "")); }, {"empty.glb", "an empty one"});
  expect_input_error([&] { read_body_template(folder.write("text.glb", "hello")); }, {"text.glb", "a glTF 2.0 file"});
  const std::string whole = text_of(body_template_glb(tetrahedron(2)));
  for (std::size_t size = 4; size < whole.size(); size += 37) {
    EXPECT_THROW(read_body_template(folder.write("cut.glb", whole.substr(0, size))), InputError) << size;
  }
}

TEST(BodyTemplate, ReadsATextFileAndCarriesItAsOnePiece) {
  const TemporaryFolder folder;
  Parts parts(tetrahedron(3));
  parts.head["buffers"][0]["uri"] = "body.bin";
  parts.head["buffers"][0]["byteLength"] = parts.buffer.size();
  folder.write("body.bin", parts.buffer);
  const BodyTemplate body = read_body_template(folder.write("body.gltf", parts.head.dump()));
  EXPECT_EQ(body.vertices, tetrahedron(3).vertices);
  EXPECT_EQ(read_body_template_bytes(body.glb, "carried").joints, body.joints);
}

TEST(BodyTemplate, ReadsTheSubjectOfTheCaptures) {
  if (!std::filesystem::exists(subject_a())) GTEST_SKIP() << "no capture at " << subject_a();
  const BodyTemplate body = read_body_template(subject_a() / "template.glb");
  EXPECT_EQ(body.vertices.size(), 13380u);
  EXPECT_EQ(body.triangles.size(), 26756u);
  ASSERT_EQ(body.skeleton.size(), 24u);
  EXPECT_EQ(body.skeleton.names[23], "right_hand");
  EXPECT_LT(glm::length(body.skeleton.rest_joints[0] - glm::dvec3(0.0, 0.940653, 0.0)), 1e-6);
  // An A-pose: its thighs are turned until they stand 45° off the vertical.
  const CanonicalPose canonical = make_canonical_pose(body.skeleton);
  const glm::dvec3 thigh = body.skeleton.rest_joints[4] - body.skeleton.rest_joints[1];
  const glm::dvec3 turned = glm::dmat3(canonical.rest_to_canonical[4]) * thigh;
  EXPECT_NEAR(glm::degrees(std::acos(-turned.y / glm::length(turned))), 45.0, 1e-6);
}

}  // namespace
}  // namespace arah
