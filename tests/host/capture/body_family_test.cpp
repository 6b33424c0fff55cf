// A family of bodies: what is in a folder must fit together, and surfaces in poses come back to the canonical pose.
#include "host/capture/body_family.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "host/capture/synthetic_motion.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

// A box of 4 cm with two joints, `height` tall.
BodyTemplate box_body(float height, const std::string& second_joint = "lid") {
  BodyTemplate box;
  box.skeleton = {{"base", second_joint}, {-1, 0}, {{0, 0, 0}, {0, 0.02, 0}}};
  for (int corner = 0; corner < 8; ++corner) {
    const glm::vec3 place(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    box.vertices.push_back(glm::vec3(0.04f, height, 0.04f) * place - glm::vec3(0.02f, 0, 0.02f));
    box.normals.push_back(glm::normalize(place - 0.5f));
    box.joints.emplace_back(place.y > 0 ? 1 : 0, 0, 0, 0);
    box.weights.emplace_back(1, 0, 0, 0);
  }
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return box;
}

class BodyFamilyTest : public testing::Test {
 protected:
  BodyFamilyTest() { fs::create_directories(folder); }
  ~BodyFamilyTest() override { fs::remove_all(folder); }
  void write(const std::string& name, const BodyTemplate& body) const { write_body_template(folder / name, body); }
  std::string refusal() const {
    try {
      family_from_folder(folder);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no InputError";
  }
  fs::path folder = fs::temp_directory_path() / ("arah_family_" + std::to_string(getpid()));
};

TEST_F(BodyFamilyTest, AFolderGivesItsBodiesInOrder) {
  write("b.glb", box_body(0.08f));
  write("a.glb", box_body(0.04f));
  std::ofstream(folder / "notes.txt") << "not a body";
  const BodyFamily family = family_from_folder(folder);
  ASSERT_EQ(family.members.size(), 2u);
  EXPECT_EQ(family.members[0].name, (folder / "a.glb").string());
  EXPECT_EQ(family.description, R"({"kind":"folder","files":["a.glb","b.glb"]})");
  // Without clothes there is nothing that the pose changes: one scan each, the template itself.
  const auto scans = family_scans(family, 5, 0);
  ASSERT_EQ(scans.size(), 2u);
  EXPECT_EQ(scans[1].member, 1u);
  EXPECT_EQ(scans[1].surface.triangles.size(), 12u);
  EXPECT_NEAR(scans[1].surface.vertices[2].y, 0.08, 1e-7);
}

TEST(RestingArmsTest, GeneratedPeopleRestAsTold) {
  const double down = glm::radians(50.0);
  RestingArms arms;
  for (std::size_t side = 0; side < 2; ++side) {
    const double outward = side == 0 ? 1 : -1;
    arms.bones[side] = {glm::dvec3(outward * std::cos(down), -std::sin(down), 0), glm::normalize(glm::dvec3(outward * 0.5, -0.5, 0.7)), glm::normalize(glm::dvec3(outward * 0.4, -0.6, 0.7))};
  }
  const BodyFamily told = generated_family(1, 4, {}, arms), plain = generated_family(1, 4);
  const ClothedFigure &figure = told.members[0].figure, &before = plain.members[0].figure;
  const RestingArms found = resting_arms(figure.body.skeleton, "figure"), described = *described_arms(told.description);
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_LT(glm::length(found.bones[side][i] - arms.bones[side][i]), 1e-9);
      EXPECT_EQ(described.bones[side][i], arms.bones[side][i]);
    }
  EXPECT_FALSE(described_arms(plain.description));
  const Skeleton &skeleton = figure.body.skeleton, &straight = before.body.skeleton;
  for (std::size_t j = 1; j < skeleton.size(); ++j) {
    const auto parent = static_cast<std::size_t>(skeleton.parents[j]);
    EXPECT_NEAR(glm::length(skeleton.rest_joints[j] - skeleton.rest_joints[parent]), glm::length(straight.rest_joints[j] - straight.rest_joints[parent]), 1e-9) << skeleton.names[j];
  }
  // Its rest is where skinning takes the T-pose.
  EXPECT_EQ(figure.rest.size(), before.rest.size());
  std::size_t still = 0;
  for (std::size_t i = 0; i < figure.rest.size(); ++i) still += figure.rest[i] == before.rest[i];
  EXPECT_GT(still, figure.rest.size() / 2) << "legs, trunk and head";
  EXPECT_LT(still, figure.rest.size()) << "but not the arms";
  const int hand = find_joint(skeleton, "left_hand");
  float lowest = 10;
  for (std::size_t i = 0; i < figure.body.vertices.size(); ++i)
    if (figure.body.joints[i][0] == hand && figure.body.weights[i][0] > 0.9F) lowest = std::min(lowest, glm::distance(figure.body.vertices[i], glm::vec3(skeleton.rest_joints[static_cast<std::size_t>(hand)])));
  EXPECT_LT(lowest, 0.1F) << "flesh goes with its bone";

  // As they are, they stay where they are.
  ClothedFigure same = before;
  rest_with(same, resting_arms(straight, "figure"));
  for (std::size_t i = 0; i < same.rest.size(); ++i) ASSERT_LT(glm::distance(same.rest[i], before.rest[i]), 1e-6F);
  Skeleton nameless = straight;
  nameless.names[static_cast<std::size_t>(find_joint(straight, "right_wrist"))] = "claw";
  try {
    resting_arms(nameless, "claw.glb");
    FAIL() << "nothing was refused";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("claw.glb: joints: expected SMPL's right_wrist"));
  }
}

TEST_F(BodyFamilyTest, AFolderThatDoesNotFitIsRefusedByFileAndJoint) {
  EXPECT_THAT(refusal(), testing::HasSubstr("expected skinned bodies, .glb or .gltf, found none"));
  write("a.glb", box_body(0.04f));
  write("b.glb", box_body(0.04f, "cover"));
  EXPECT_THAT(refusal(), testing::HasSubstr("b.glb: joint 1: expected 'lid' as in"));
  BodyTemplate one = box_body(0.04f);
  one.skeleton = {{"base"}, {-1}, {{0, 0, 0}}};
  for (auto& joints : one.joints) joints = glm::u8vec4(0);
  write("b.glb", one);
  EXPECT_THAT(refusal(), testing::HasSubstr("b.glb: joints: expected 2 as in"));
  BodyTemplate chain = box_body(0.04f), fork = chain;
  chain.skeleton = {{"base", "lid", "tip"}, {-1, 0, 1}, {{0, 0, 0}, {0, 0.02, 0}, {0, 0.03, 0}}};
  fork.skeleton = {{"base", "lid", "tip"}, {-1, 0, 0}, {{0, 0, 0}, {0, 0.02, 0}, {0, 0.03, 0}}};
  write("a.glb", chain);
  write("b.glb", fork);
  EXPECT_THAT(refusal(), testing::HasSubstr("b.glb: joint 2 ('tip'): expected parent 1 as in"));
  std::ofstream(folder / "b.glb") << "no glTF at all";
  EXPECT_THAT(refusal(), testing::HasSubstr("b.glb"));
  fs::remove_all(folder);
  EXPECT_THAT(refusal(), testing::HasSubstr("no such folder"));
}

TEST_F(BodyFamilyTest, GeneratedBodiesRepeatAndAreSkinnedAlike) {
  std::size_t told = 0;
  const BodyFamily family = generated_family(3, 1, [&](std::size_t made) { return told = made, true; });
  EXPECT_EQ(told, 3u);
  ASSERT_EQ(family.members.size(), 3u);
  const BodyFamily alone = generated_family(1, 2);
  EXPECT_EQ(family.members[1].figure.rest, alone.members[0].figure.rest) << "whatever thread made it";
  EXPECT_EQ(family.members[1].name, "body 2");
  EXPECT_NE(family.members[0].figure.body.vertices, family.members[2].figure.body.vertices);
  EXPECT_THROW(generated_family(4, 1, [](std::size_t) { return false; }), std::runtime_error);

  // Visible skin moves by skinning alone, so it comes back to the same place from every pose; clothes do not.
  const ClothedFigure& figure = family.members[0].figure;
  const CanonicalPose canonical = make_canonical_pose(figure.body.skeleton);
  const CanonicalSurface rest = canonical_surface(figure, canonical);
  ASSERT_EQ(rest.vertices.size(), figure.rest.size());
  EXPECT_LT(rest.triangles.size(), figure.triangles.size()) << "skin under clothes is left out";
  EXPECT_GT(rest.triangles.size(), figure.triangles.size() / 2);
  const auto scans = family_scans(family, 3, 0);
  ASSERT_EQ(scans.size(), 9u);
  double farthest_skin = 0, farthest_cloth = 0;
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_EQ(scans[s].member, 0u);
    EXPECT_GT(scans[s].surface.triangles.size(), rest.triangles.size() * 99 / 100);
    for (const glm::dvec3& normal : scans[s].surface.normals) ASSERT_NEAR(glm::length(normal), 1, 1e-9);
    for (std::size_t i = 0; i < figure.rest.size(); ++i) {
      const double moved = glm::distance(scans[s].surface.vertices[i], rest.vertices[i]);
      if (figure.looseness[i] > 0) farthest_cloth = std::max(farthest_cloth, moved);
      else if (figure.weights[i].x > 0.999f) farthest_skin = std::max(farthest_skin, moved);
    }
  }
  EXPECT_LT(farthest_skin, 2e-3) << "metres, of skin that hangs on one bone";
  EXPECT_GT(farthest_cloth, 0.01);
  EXPECT_NE(scans[0].surface.vertices, scans[1].surface.vertices);
  EXPECT_NE(scans[0].pose, scans[1].pose);
}

}  // namespace
}  // namespace arah
