// Bodies of the SMPL family become rigs: shape, joints and weights of small files in the same formats, which the test
// writes itself.
#include "host/body/smpl_file.h"

#include <glm/geometric.hpp>

#include "host/body/pose.h"
#include "tests/host/body/rigs.h"
#include "tests/host/body/small_smpl.h"

namespace arah {
namespace {

TEST(SmplFile, GivesTheSameRigFromArchivesAndPickles) {
  const TemporaryFolder folder;
  const SmallModel model;
  const std::vector<double> betas{0.5, -0.2, 0.0, 0.0};
  const std::filesystem::path files[] = {folder.write("a.npz", model.npz(false)), folder.write("b.npz", model.npz(true)), folder.write("c.pkl", model.pickle()),
                                         folder.write("d.pkl", model.pickle(true))};
  for (const auto& path : files) {
    SCOPED_TRACE(path.string());
    ASSERT_TRUE(is_smpl_file(path));
    const BodyTemplate plain = read_smpl_body(path).body;
    const SmplBody read = read_smpl_body(path, betas);
    const BodyTemplate& body = read.body;
    ASSERT_EQ(body.vertices.size(), 48u);
    EXPECT_EQ(body.skeleton.names[16], "left_shoulder");
    EXPECT_EQ(body.skeleton.parents, (std::vector<int>{-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21}));
    for (std::size_t v = 0; v < body.vertices.size(); ++v) {
      const double x = 0.05 * static_cast<double>(v);
      const glm::vec3 rest(static_cast<float>(x), v % 2 ? 1.2f : 1.0f, static_cast<float>(0.01 * x * x));
      EXPECT_LT(glm::length(plain.vertices[v] - rest), 1e-6f);
      // shapedirs[v] is [[0.1, 0], [0, x], [0, 0.3]]
      EXPECT_LT(glm::length(body.vertices[v] - rest - glm::vec3(0.05, -0.2 * x, -0.06)), 1e-6f);
      EXPECT_NEAR(glm::length(body.normals[v]), 1.0, 1e-5);
    }
    for (std::size_t j = 0; j < 24; ++j) EXPECT_LT(glm::length(glm::vec3(body.skeleton.rest_joints[j]) - body.vertices[2 * j]), 1e-6f);
    EXPECT_LT(glm::length(body.weights[0] - glm::vec4(0.3, 0.25, 0.2, 0.15) / 0.9f), 1e-6f);
    EXPECT_EQ(body.joints[0], glm::u8vec4(0, 1, 2, 3));
    EXPECT_EQ(body.joints[47][0], 23);
    EXPECT_EQ(read.notes.size(), path.extension() == ".npz" ? 2u : 1u);
    EXPECT_THAT(read.notes[0], testing::HasSubstr("1 of 48 vertices have more than four joints: the smallest weights are left out, 10.00 %"));
    // The shape goes on from there: its directions move vertices and, through the regressor, joints.
    EXPECT_EQ(plain.shape.beta, (std::vector<double>{0, 0}));
    EXPECT_EQ(body.shape.beta, (std::vector<double>{0.5, -0.2}));
    EXPECT_EQ(body.shape.names, (std::vector<std::string>{"beta_0", "beta_1"}));
    EXPECT_TRUE(body.shape.moves_joints());
    for (std::size_t j = 0; j < 24; ++j) {
      EXPECT_EQ(body.shape.joint_offsets[0][j], glm::dvec3(0.1, 0, 0));
      EXPECT_LT(glm::length(body.shape.joint_offsets[1][j] - glm::dvec3(0, 0.1 * static_cast<double>(j), 0.3)), 1e-12);
    }
    BodyTemplate moved = body;
    set_shape(moved, {-1, 0.75});
    const BodyTemplate stated = read_smpl_body(path, std::vector<double>{-1, 0.75}).body;
    for (std::size_t v = 0; v < moved.vertices.size(); ++v) EXPECT_LT(glm::length(moved.vertices[v] - stated.vertices[v]), 1e-6f);
    for (std::size_t j = 0; j < 24; ++j) EXPECT_LT(glm::length(moved.skeleton.rest_joints[j] - stated.skeleton.rest_joints[j]), 1e-6);
    EXPECT_EQ(read_body_template_bytes(body.glb, "glb").shape.beta, body.shape.beta);
    // Normals are those of the mesh in its shape.
    std::vector<glm::dvec3> sums(body.vertices.size(), glm::dvec3(0.0));
    for (const glm::uvec3& t : body.triangles) {
      const glm::dvec3 a(body.vertices[t.x]), b(body.vertices[t.y]), c(body.vertices[t.z]);
      for (int k = 0; k < 3; ++k) sums[t[k]] += glm::cross(b - a, c - a);
    }
    for (std::size_t v = 0; v < sums.size(); ++v) EXPECT_LT(glm::length(glm::dvec3(body.normals[v]) - glm::normalize(sums[v])), 1e-4) << v;
    // What it writes is a body like any other.
    write_body_template(folder / "body.glb", body);
    EXPECT_EQ(read_body_template(folder / "body.glb").vertices, body.vertices);
  }
}

TEST(SmplFile, KeepsTenDirectionsOfTheShapeAndTakesTheOthersAsTheyAreStated) {
  const TemporaryFolder folder;
  SmallModel model;
  model.shapes = 13;
  model.directions.clear();
  for (std::size_t v = 0; v < model.vertices; ++v)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t b = 0; b < model.shapes; ++b) model.directions.push_back(axis == b % 3 ? 0.01 * static_cast<double>(b + 1) : 0.0);
  std::vector<double> betas(12, 0.0);
  betas[3] = 2;
  betas[11] = 1;
  const BodyTemplate body = read_smpl_body(folder.write("a.npz", model.npz(true)), betas).body;
  ASSERT_EQ(body.shape.size(), 10u);
  EXPECT_EQ(body.shape.beta, (std::vector<double>{0, 0, 0, 2, 0, 0, 0, 0, 0, 0}));
  for (std::size_t v = 0; v < body.vertices.size(); ++v) {
    const double x = 0.05 * static_cast<double>(v);
    const glm::vec3 rest(static_cast<float>(x), v % 2 ? 1.2f : 1.0f, static_cast<float>(0.01 * x * x));
    EXPECT_LT(glm::length(body.shape.base_vertices[v] - rest - glm::vec3(0, 0, 0.12f)), 1e-6f);  // beta 11 moves z by 0.12
    EXPECT_LT(glm::length(body.vertices[v] - rest - glm::vec3(0.08f, 0, 0.12f)), 1e-6f);         // beta 3 moves x by 0.04
  }
  EXPECT_LT(glm::length(body.skeleton.rest_joints[5] - glm::dvec3(body.vertices[10])), 1e-6);
  EXPECT_LT(glm::length(body.shape.joint_offsets[9][7] - glm::dvec3(0.1, 0, 0)), 1e-12);
}

// Σ_k P[v][axis][k] (R_j − I)[row][column], k = 9 (j − 1) + 3 row + column: SMPL's definition.
std::vector<glm::dvec3> pose_offsets(const SmallModel& model, const std::vector<glm::dvec3>& pose) {
  std::vector<glm::dvec3> offsets(model.vertices, glm::dvec3(0.0));
  for (std::size_t v = 0; v < model.vertices; ++v)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t j = 1; j < model.joints; ++j) {
        const glm::dmat3 turn = rotation_from_axis_angle(pose[j]);
        for (std::size_t row = 0; row < 3; ++row)
          for (std::size_t column = 0; column < 3; ++column) {
            const std::size_t k = 9 * (j - 1) + 3 * row + column;
            const double number = turn[static_cast<int>(column)][static_cast<int>(row)] - (row == column ? 1.0 : 0.0);
            offsets[v][static_cast<int>(axis)] += model.pose_directions[(3 * v + axis) * 9 * (model.joints - 1) + k] * number;
          }
      }
  return offsets;
}

TEST(SmplFile, GivesTheMeshTheMeanOfItsPoseBlendShapes) {
  const TemporaryFolder folder;
  const SmallModel model;
  const auto path = folder.write("a.npz", model.npz(true));
  std::vector<std::vector<glm::dvec3>> poses(2, std::vector<glm::dvec3>(24, glm::dvec3(0.0)));
  poses[0][0] = {2, 1, 0};  // the root's turn displaces nothing
  poses[0][4] = {0.75, -0.25, 0.5};
  poses[1][4] = {0.5, 0, 0.125};
  poses[1][18] = {0, 1, -0.25};
  const std::vector<double> betas{0.5};
  const BodyTemplate bare = read_smpl_body(path, betas).body;
  // One pose: posed by skinning alone, the rig is SMPL's body in that pose.
  const SmplBody one = read_smpl_body(path, betas, std::span(poses).first(1));
  const Pose pose{poses[0], {0.25, 1, -0.5}};
  BodyTemplate truth = bare;
  const std::vector<glm::dvec3> of_first = pose_offsets(model, poses[0]), of_second = pose_offsets(model, poses[1]);
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) truth.vertices[v] += glm::vec3(of_first[v]);
  const std::vector<glm::vec3> is = posed_vertices(one.body, pose), should = posed_vertices(truth, pose);
  for (std::size_t v = 0; v < is.size(); ++v) EXPECT_LT(glm::length(is[v] - should[v]), 1e-6f) << v;
  EXPECT_EQ(one.body.skeleton.rest_joints, bare.skeleton.rest_joints);
  EXPECT_EQ(one.body.shape.joint_offsets, bare.shape.joint_offsets);
  EXPECT_THAT(one.notes.back(), testing::HasSubstr("mean over 1 poses"));
  EXPECT_THAT(one.notes.back(), testing::HasSubstr("0.0 mm on average and 0.0 mm at most, is left out"));
  // Two: the mean, and half of the difference is left out.
  const SmplBody both = read_smpl_body(path, betas, poses);
  double mean = 0, left = 0, most = 0;
  for (std::size_t v = 0; v < bare.vertices.size(); ++v) {
    const glm::dvec3 middle = 0.5 * (of_first[v] + of_second[v]);
    EXPECT_LT(glm::length(glm::dvec3(both.body.vertices[v]) - glm::dvec3(bare.vertices[v]) - middle), 1e-6);
    mean += 1e3 * glm::length(middle) / 48;
    left += 1e3 * glm::length(of_first[v] - middle) / 48;
    most = std::max(most, 1e3 * glm::length(of_first[v] - middle));
  }
  EXPECT_GT(left, 1);
  EXPECT_THAT(both.notes.back(), testing::HasSubstr(fmt::format("mean over 2 poses, {:.1f} mm at a vertex on average. What single poses add, {:.1f} mm on average and {:.1f} mm at most", mean, left, most)));
  // Poses of other joints say nothing of these.
  const SmplBody others = read_smpl_body(path, betas, std::vector(1, std::vector<glm::dvec3>(52, glm::dvec3(0.5))));
  EXPECT_EQ(others.body.vertices, bare.vertices);
  EXPECT_THAT(others.notes.back(), testing::HasSubstr("Pose blend shapes are left out"));
  SmallModel damaged;
  damaged.pose_directions[5] = NAN;
  expect_input_error([&] { read_smpl_body(folder.write("b.npz", damaged.npz(false)), {}, poses); }, {"b.npz: posedirs: expected finite numbers"});
}

TEST(SmplFile, KnowsHandsAndFaces) {
  const TemporaryFolder folder;
  for (const std::size_t joints : {52u, 55u}) {
    const BodyTemplate body = read_smpl_body(folder.write("a.npz", SmallModel(joints).npz(true))).body;
    const auto parent = [&](const char* name) { return body.skeleton.names[static_cast<std::size_t>(body.skeleton.parents[static_cast<std::size_t>(find_joint(body.skeleton, name))])]; };
    EXPECT_EQ(body.skeleton.size(), joints);
    EXPECT_EQ(parent("left_index1"), "left_wrist");
    EXPECT_EQ(parent("left_index2"), "left_index1");
    EXPECT_EQ(parent("right_thumb1"), "right_wrist");
    EXPECT_EQ(parent("right_thumb3"), "right_thumb2");
    if (joints == 55) {
      EXPECT_EQ(parent("jaw"), "head");
    }
  }
}

TEST(SmplFile, RefusesWhatIsNoBody) {
  const TemporaryFolder folder;
  const auto refuse = [&](const std::function<void(SmallModel&)>& spoil, const std::vector<std::string>& parts, std::vector<double> betas = {}) {
    for (const bool pickled : {false, true}) {
      SmallModel model;
      spoil(model);
      const auto path = pickled ? folder.write("bad.pkl", model.pickle()) : folder.write("bad.npz", model.npz(true));
      expect_input_error([&] { read_smpl_body(path, betas); }, parts);
    }
  };
  refuse([](SmallModel& m) { m.faces[4] = 48; }, {"bad.", "f: expected vertices below 48, found 48 in face 1"});
  refuse([](SmallModel& m) { m.weights[30] = -0.1; }, {"weights of 0 and more", "vertex 1"});
  refuse([](SmallModel& m) { m.weights[24] = 0; }, {"none at vertex 1"});
  refuse([](SmallModel& m) { m.weights[24] = std::nan(""); }, {"weights: expected finite"});
  refuse([](SmallModel& m) { m.rest[3] = INFINITY; }, {"v_template: expected finite"});
  refuse([](SmallModel& m) { m.directions[7] = INFINITY; }, {"shapedirs: expected finite"}, {0.1, 0.1});
  refuse([](SmallModel&) {}, {"shapedirs: expected a direction for each of 3 betas, found 2"}, {0, 0, 1});
  refuse([](SmallModel& m) { m.tree[5] = 30; }, {"kintree_table: expected parents below 24, found 30"});
  refuse([](SmallModel& m) { m.tree[5] = 9; }, {"a parent that comes before it"});
  SmallModel model;
  std::string pickled = model.pickle();
  const std::string indices = python::raw<std::int32_t>({0, 1, 2, 3, 4});
  pickled.replace(pickled.find(indices), 4, python::raw<std::int32_t>({24}));
  expect_input_error([&] { read_smpl_body(folder.write("bad.pkl", pickled)); }, {"J_regressor indices: expected 0 to 23, found 24"});
  const std::string starts = python::raw<std::int32_t>({0, 1, 1, 2, 2});
  pickled = model.pickle();
  pickled.replace(pickled.find(starts) + 4, 4, python::raw<std::int32_t>({900}));
  expect_input_error([&] { read_smpl_body(folder.write("bad.pkl", pickled)); }, {"J_regressor indptr"});
  expect_input_error([&] { read_smpl_body(folder.write("bad.npz", python::npz({{"v_template", python::npy({2}, {1, 2})}}))); }, {"v_template", "an array of Nx3 numbers"});
  expect_input_error([&] { read_smpl_body(folder.write("bad.npz", python::npz({{"poses", python::npy({2}, {1, 2})}}))); }, {"v_template: expected this array, found none"});
  expect_input_error([&] { smpl_joint_names(16, "mano.pkl"); }, {"mano.pkl", "24 (SMPL)", "16"});
}

}  // namespace
}  // namespace arah
