// Animations of glTF files come back as the poses that they show.
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <random>
#include <stdexcept>

#include "host/body/gltf_motion.h"
#include "host/body/motion_file.h"
#include "host/body/skinned_gltf.h"
#include "host/body/smpl_joints.h"
#include "tests/host/body/glb_parts.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// The angle between two axis-angles as rotations.
double turn_between(const glm::dvec3& a, const glm::dvec3& b) {
  return glm::length(axis_angle_from_rotation(glm::transpose(rotation_from_axis_angle(a)) * rotation_from_axis_angle(b)));
}

double largest_turn(const Pose& a, const Pose& b) {
  double largest = 0;
  for (std::size_t j = 0; j < a.theta.size(); ++j) largest = std::max(largest, turn_between(a.theta[j], b.theta.at(j)));
  return largest;
}

// SMPL's tree in a T-pose, somewhat.
Skeleton smpl_person() {
  Skeleton skeleton;
  skeleton.names = smpl_joint_names(24, "");
  skeleton.parents = smpl_joint_parents(24, "");
  skeleton.rest_joints = {{0, .95, 0},     {.07, .86, 0},  {-.07, .86, 0}, {0, 1.06, 0},    {.09, .48, 0},  {-.09, .48, 0}, {0, 1.19, 0},    {.08, .07, -.03}, {-.08, .07, -.03}, {0, 1.25, 0},   {.1, .01, .1},   {-.1, .01, .1},
                          {0, 1.46, -.02}, {.08, 1.37, 0}, {-.08, 1.37, 0}, {0, 1.55, .03}, {.17, 1.4, 0},  {-.17, 1.4, 0}, {.43, 1.39, -.02}, {-.43, 1.39, -.02}, {.68, 1.4, -.02}, {-.68, 1.4, -.02}, {.76, 1.39, 0}, {-.76, 1.39, 0}};
  return skeleton;
}

// A mesh of one triangle on it, with the poses as its animation.
SkinnedModel animated(const Skeleton& skeleton, const std::vector<Pose>& poses, double rate) {
  SkinnedModel model;
  model.name = "body";
  model.skeleton = skeleton;
  model.rest_to_bind.assign(skeleton.size(), glm::dmat4(1.0));
  model.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  model.normals.assign(3, {0, 0, 1});
  model.triangles = {{0, 1, 2}};
  model.joints.assign(3, glm::u8vec4(0));
  model.weights.assign(3, {1, 0, 0, 0});
  model.motion = "dance";
  model.poses = poses;
  model.frames_per_second = rate;
  return model;
}

std::vector<Pose> smooth_poses(const Skeleton& skeleton, int count, double rate) {
  std::vector<Pose> poses;
  for (int f = 0; f < count; ++f) {
    Pose pose = rest_pose(skeleton);
    const double t = f / rate;
    for (std::size_t j = 0; j < pose.theta.size(); ++j) {
      const double phase = 0.7 * static_cast<double>(j);
      pose.theta[j] = glm::dvec3(std::sin(1.3 * t + phase), std::cos(0.9 * t + phase), std::sin(0.5 * t - phase)) * (j == 0 ? 1.7 : 0.8);
    }
    pose.root_position += glm::dvec3(0.3 * t, 0.1 * std::sin(t), -0.2 * t);
    poses.push_back(pose);
  }
  return poses;
}

std::string bytes_text(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

TEST(GltfMotion, OurOwnExportsReadBackToTheSamePoses) {
  const TemporaryFolder folder;
  const Skeleton skeleton = smpl_person();
  for (const double rate : {25.0, 30.0, 59.94}) {
    const std::vector<Pose> poses = smooth_poses(skeleton, 2000, rate);
    const auto path = folder.write("dance.glb", bytes_text(skinned_glb(animated(skeleton, poses, rate))));
    EXPECT_THAT(gltf_animation_names(path), ElementsAre("dance"));
    const GltfMotion read = read_gltf_motion(path);
    EXPECT_THAT(read.notes, IsEmpty());
    EXPECT_EQ(read.animation, "dance");
    EXPECT_EQ(read.motion.skeleton.names, skeleton.names);
    EXPECT_EQ(read.motion.skeleton.parents, skeleton.parents);
    EXPECT_NEAR(read.motion.frames_per_second, rate, 1e-3);
    ASSERT_EQ(read.motion.frames.size(), poses.size());
    double turn = 0, moved = 0;
    for (std::size_t f = 0; f < poses.size(); ++f) {
      turn = std::max(turn, largest_turn(poses[f], read.motion.frames[f].pose));
      moved = std::max(moved, glm::distance(poses[f].root_position, read.motion.frames[f].pose.root_position));
    }
    std::printf("%g frames a second: largest turn %.2g rad, root %.2g m\n", rate, turn, moved);
    EXPECT_LT(turn, 1e-5);
    EXPECT_LT(moved, 1e-5);
  }
}

// As `arah export` turns a motion of a z-up world upright, and `arah import motion` brings it onto the same rig.
TEST(GltfMotion, AMotionGoesOutAndComesBackOntoItsRig) {
  const TemporaryFolder folder;
  const Skeleton skeleton = smpl_person();
  const std::vector<Pose> poses = smooth_poses(skeleton, 50, 25);
  const glm::dmat3 upright(1, 0, 0, 0, 0, -1, 0, 1, 0);
  std::vector<Pose> turned = poses;
  for (Pose& pose : turned) {
    pose.theta[0] = axis_angle_from_rotation(upright * rotation_from_axis_angle(pose.theta[0]));
    pose.root_position = upright * pose.root_position;
  }
  const MotionFile file = read_motion_file(folder.write("dance.glb", bytes_text(skinned_glb(animated(skeleton, turned, 25)))));
  EXPECT_EQ(file.format, "glTF animation 'dance'");
  EXPECT_EQ(file.motion.frames_per_second, 25.0);
  const Retargeted result = retarget(file.motion, skeleton, file.settings, "dance.glb");
  EXPECT_TRUE(result.same_rest);
  ASSERT_EQ(result.motion.frames.size(), poses.size());
  for (std::size_t f = 0; f < poses.size(); ++f) {
    EXPECT_LT(largest_turn(poses[f], result.motion.frames[f].pose), 1e-5) << f;
    EXPECT_LT(glm::distance(poses[f].root_position, result.motion.frames[f].pose.root_position), 1e-5) << f;
  }
}

// A body of three joints to hang animations on.
struct AnimatedParts : Parts {
  AnimatedParts() : Parts(tetrahedron(3)) { head["animations"] = nlohmann::json::array(); }

  std::size_t add_accessor(const std::vector<float>& values, const char* type, std::size_t each) {
    const std::size_t view = add_view(values);
    head["accessors"].push_back({{"bufferView", view}, {"componentType", 5126}, {"count", values.size() / each}, {"type", type}});
    return head["accessors"].size() - 1;
  }
  void add_animation(const std::string& name) { head["animations"].push_back({{"name", name}, {"channels", nlohmann::json::array()}, {"samplers", nlohmann::json::array()}}); }
  std::size_t node(const std::string& name) const {
    for (std::size_t n = 0; n < head["nodes"].size(); ++n) {
      if (head["nodes"][n].value("name", "") == name) return n;
    }
    throw std::logic_error("no node " + name);
  }
  void add_channel(const std::string& joint, const char* path, const std::vector<float>& times, const std::vector<float>& values, const char* interpolation) {
    nlohmann::json& animation = head["animations"].back();
    const bool rotation = std::string(path) == "rotation";
    const std::size_t input = add_accessor(times, "SCALAR", 1), output = add_accessor(values, rotation ? "VEC4" : "VEC3", rotation ? 4 : 3);
    animation["channels"].push_back({{"sampler", animation["samplers"].size()}, {"target", {{"node", node(joint)}, {"path", path}}}});
    animation["samplers"].push_back({{"input", input}, {"output", output}, {"interpolation", interpolation}});
  }
};

const float kHalf = static_cast<float>(std::sqrt(0.5));

TEST(GltfMotion, InterpolatesEachChannelItsOwnWay) {
  const TemporaryFolder folder;
  AnimatedParts parts;
  parts.add_animation("three");
  // About z: 0 to 90 degrees in two seconds, the second key frame with its sign turned; held values; a cubic path.
  parts.add_channel("bone_0", "rotation", {1, 3}, {0, 0, 0, 1, 0, 0, -kHalf, -kHalf}, "LINEAR");
  parts.add_channel("bone_1", "rotation", {1, 2, 2.5}, {0, 0, 0, 1, kHalf, 0, 0, kHalf, 0, 1, 0, 0}, "STEP");
  parts.add_channel("bone_0", "translation", {1, 3}, {9, 9, 9, 0, 0, 0, 1, 0, 0, 0, 3, 0, 4, 0, 0, 9, 9, 9}, "CUBICSPLINE");
  const GltfMotion read = read_gltf_motion(folder.write("a.glb", parts.glb()), "three", 4);
  const Motion& motion = read.motion;
  EXPECT_EQ(motion.frames_per_second, 4.0);
  ASSERT_EQ(motion.frames.size(), 9u);  // from 1 s to 3 s
  for (std::size_t f = 0; f < 9; ++f) {
    const double s = static_cast<double>(f) / 8.0, time = 1.0 + 2.0 * s;
    const Pose& pose = motion.frames[f].pose;
    EXPECT_LT(turn_between(pose.theta[0], {0, 0, 0.5 * glm::pi<double>() * s}), 1e-6) << f;
    const glm::dvec3 held = time < 2.0 ? glm::dvec3(0.0) : time < 2.5 ? glm::dvec3(0.5 * glm::pi<double>(), 0, 0) : glm::dvec3(0, glm::pi<double>(), 0);
    EXPECT_LT(turn_between(pose.theta[1], held), 1e-6) << f;
    EXPECT_EQ(pose.theta[2], glm::dvec3(0.0));
    // glTF 2.0, appendix C: Hermite with tangents (1, 0, 0) out of the first and (0, 3, 0) into the second, in units a second, from (0, 0, 0) to (4, 0, 0) in two.
    const double s2 = s * s, s3 = s2 * s;
    const glm::dvec3 expected = 2.0 * (s3 - 2 * s2 + s) * glm::dvec3(1, 0, 0) + (3 * s2 - 2 * s3) * glm::dvec3(4, 0, 0) + 2.0 * (s3 - s2) * glm::dvec3(0, 3, 0);
    EXPECT_LT(glm::distance(pose.root_position, expected), 1e-6) << f;
  }
  // Uneven key frames: at 30 a second, and that is said.
  const GltfMotion usual = read_gltf_motion(folder / "a.glb");
  EXPECT_EQ(usual.motion.frames_per_second, 30.0);
  EXPECT_EQ(usual.motion.frames.size(), 61u);
  EXPECT_THAT(usual.notes, ElementsAre(HasSubstr("not evenly spaced")));
}

TEST(GltfMotion, CubicRotationsAreNormalised) {
  const TemporaryFolder folder;
  AnimatedParts parts;
  parts.add_animation("cubic");
  parts.add_channel("bone_1", "rotation", {0, 1}, {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, kHalf, kHalf, 0, 0, 0, 0}, "CUBICSPLINE");
  const Motion motion = read_gltf_motion(folder.write("a.glb", parts.glb()), "", 2).motion;
  ASSERT_EQ(motion.frames.size(), 3u);
  EXPECT_LT(turn_between(motion.frames[1].pose.theta[1], {0, 0, 0.25 * glm::pi<double>()}), 1e-6);  // symmetric, so half way
}

TEST(GltfMotion, TakesAnimationsByName) {
  const TemporaryFolder folder;
  AnimatedParts parts;
  for (const float angle : {0.2f, 0.4f}) {
    parts.add_animation(angle < 0.3f ? "walk" : "");
    parts.add_channel("bone_0", "rotation", {0}, {std::sin(angle / 2), 0, 0, std::cos(angle / 2)}, "LINEAR");
  }
  const auto path = folder.write("a.glb", parts.glb());
  EXPECT_THAT(gltf_animation_names(path), ElementsAre("walk", "animation_1"));
  EXPECT_NEAR(read_gltf_motion(path).motion.frames[0].pose.theta[0].x, 0.2, 1e-6);
  EXPECT_NEAR(read_gltf_motion(path, "animation_1").motion.frames[0].pose.theta[0].x, 0.4, 1e-6);
  EXPECT_EQ(read_gltf_motion(path).motion.frames_per_second, 0.0);  // of a single key frame
  expect_input_error([&] { read_gltf_motion(path, "run"); }, {"a.glb", "'walk', 'animation_1'", "'run'"});
}

// Nodes with frames of their own below an armature in centimetres with +Z up, as Blender and Mixamo leave them, show the same motion.
TEST(GltfMotion, RestFramesAndAnArmatureDoNotMatter) {
  const TemporaryFolder folder;
  std::mt19937 generator(5);
  const auto random_rotation = [&] {
    std::normal_distribution<double> normal;
    return glm::normalize(glm::dquat(normal(generator), normal(generator), normal(generator), normal(generator)));
  };
  AnimatedParts parts;
  const BodyTemplate body = tetrahedron(3);
  const std::vector<Pose> poses = smooth_poses(body.skeleton, 5, 10);
  const glm::dquat armature = glm::angleAxis(-glm::half_pi<double>(), glm::dvec3(1, 0, 0));
  const auto floats = [](const glm::dquat& q) { return std::vector<float>{static_cast<float>(q.x), static_cast<float>(q.y), static_cast<float>(q.z), static_cast<float>(q.w)}; };
  const auto list = [](const glm::dvec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
  std::vector<glm::dquat> frames;  // of the nodes in the world at rest
  parts.add_animation("take");
  const std::vector<float> times{0.0f, 0.1f, 0.2f, 0.3f, 0.4f};
  std::vector<float> roots;
  for (std::size_t j = 0; j < 3; ++j) {
    frames.push_back(random_rotation());
    const glm::dquat above = j == 0 ? armature : frames[j - 1];
    const glm::dvec3 offset = body.skeleton.rest_joints[j] - (j == 0 ? glm::dvec3(0.0) : body.skeleton.rest_joints[j - 1]);
    nlohmann::json& node = parts.head["nodes"][parts.node(fmt::format("bone_{}", j))];
    node["translation"] = list(100.0 * (glm::conjugate(above) * offset));
    node["rotation"] = floats(glm::conjugate(above) * frames[j]);
    std::vector<float> values;
    for (const Pose& pose : poses) {
      glm::dquat turned(1, 0, 0, 0), parent(1, 0, 0, 0);
      for (std::size_t k = 0; k <= j; ++k) {
        parent = turned;
        turned = turned * glm::quat_cast(rotation_from_axis_angle(pose.theta[k]));
      }
      const std::vector<float> q = floats(glm::conjugate(j == 0 ? armature : parent * frames[j - 1]) * turned * frames[j]);
      values.insert(values.end(), q.begin(), q.end());
      if (j > 0) continue;
      const glm::dvec3 root = 100.0 * (glm::conjugate(armature) * pose.root_position);
      for (int k = 0; k < 3; ++k) roots.push_back(static_cast<float>(root[k]));
    }
    parts.add_channel(fmt::format("bone_{}", j), "rotation", times, values, "LINEAR");
  }
  parts.add_channel("bone_0", "translation", times, roots, "LINEAR");
  const std::size_t root = parts.node("bone_0");
  parts.head["nodes"].push_back({{"name", "Armature"}, {"rotation", floats(armature)}, {"scale", {0.01, 0.01, 0.01}}, {"children", {root}}});
  for (nlohmann::json& node : parts.head["scenes"][0]["nodes"]) {
    if (node == root) node = parts.head["nodes"].size() - 1;
  }
  const GltfMotion read = read_gltf_motion(folder.write("a.glb", parts.glb()));
  EXPECT_THAT(read.notes, IsEmpty());
  EXPECT_EQ(read.motion.frames_per_second, 10.0);
  ASSERT_EQ(read.motion.frames.size(), 5u);
  for (std::size_t j = 0; j < 3; ++j) EXPECT_LT(glm::distance(read.motion.skeleton.rest_joints[j], body.skeleton.rest_joints[j]), 1e-6);
  for (std::size_t f = 0; f < 5; ++f) {
    EXPECT_LT(largest_turn(poses[f], read.motion.frames[f].pose), 2e-6);
    EXPECT_LT(glm::distance(poses[f].root_position, read.motion.frames[f].pose.root_position), 1e-6);
  }
}

TEST(GltfMotion, WithoutASkinTheAnimatedNodesAreTheSkeleton) {
  const TemporaryFolder folder;
  AnimatedParts parts;
  parts.add_animation("take");
  parts.add_channel("bone_0", "rotation", {0, 1}, {0, 0, 0, 1, kHalf, 0, 0, kHalf}, "LINEAR");
  parts.add_channel("bone_2", "translation", {0, 1}, {0, 0, 0, 1, 0, 0}, "LINEAR");
  parts.head.erase("skins");
  for (nlohmann::json& node : parts.head["nodes"]) node.erase("skin");
  const GltfMotion read = read_gltf_motion(folder.write("a.glb", parts.glb()));
  EXPECT_THAT(read.motion.skeleton.names, ElementsAre("bone_0", "bone_1", "bone_2"));
  EXPECT_THAT(read.notes, ElementsAre(HasSubstr("Translations of 1 joints below the root are left out")));
}

TEST(GltfMotion, RefusesWhatIsDamaged) {
  const TemporaryFolder folder;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto refused = [&](const std::function<void(AnimatedParts&)>& spoil, const std::vector<std::string>& parts_of_text) {
    AnimatedParts parts;
    parts.add_animation("take");
    parts.add_channel("bone_0", "rotation", {0, 1}, {0, 0, 0, 1, kHalf, 0, 0, kHalf}, "LINEAR");
    spoil(parts);
    const auto path = folder.write("bad.glb", parts.glb());
    expect_input_error([&] { read_gltf_motion(path); }, parts_of_text);
  };
  refused([](AnimatedParts& p) { p.head.erase("animations"); }, {"bad.glb", "an animation", "none"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["channels"][0]["target"]["node"] = 99; }, {"channel 0", "node 99"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["channels"][0]["sampler"] = 7; }, {"channel 0", "sampler 7"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["channels"][0]["target"]["path"] = "translation"; }, {"channel 0 values", "3 numbers"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["samplers"][0]["interpolation"] = "SPLINE"; }, {"CUBICSPLINE", "'SPLINE'"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["samplers"][0]["interpolation"] = "CUBICSPLINE"; }, {"three values", "2 times and 2 values"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["samplers"][0]["input"] = 77; }, {"channel 0 times", "accessor 77"});
  refused([](AnimatedParts& p) { p.head["accessors"].back()["count"] = 1u << 30; }, {"elements"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["channels"].push_back(p.head["animations"][0]["channels"][0]); }, {"channel 1", "a second one"});
  refused([](AnimatedParts& p) { p.head["nodes"][p.node("bone_1")]["scale"] = {1, -1, 1}; }, {"mirrors"});
  refused([](AnimatedParts& p) { p.head["extensionsRequired"] = {"EXT_meshopt_compression"}; }, {"EXT_meshopt_compression"});
  refused([](AnimatedParts& p) { p.head["animations"][0]["channels"][0]["target"]["path"] = "scale"; }, {"channels that turn nodes"});
  refused([&](AnimatedParts& p) { p.add_channel("bone_1", "rotation", {0, 1}, {0, 0, 0, 1, nan, 0, 0, 1}, "LINEAR"); }, {"channel 1 key frame 1", "finite", "nan"});
  refused([&](AnimatedParts& p) { p.add_channel("bone_1", "rotation", {0, 1}, {0, 0, 0, 1, 0, 0, 0, 0}, "LINEAR"); }, {"channel 1 key frame 1", "length 0"});
  refused([&](AnimatedParts& p) { p.add_channel("bone_1", "rotation", {1, 0}, {0, 0, 0, 1, 0, 0, 0, 1}, "LINEAR"); }, {"channel 1", "increase"});
  refused([&](AnimatedParts& p) { p.add_channel("bone_1", "rotation", {nan}, {0, 0, 0, 1}, "LINEAR"); }, {"channel 1", "times of at most 1e6"});
  // Two key frames two weeks apart must not become a motion of a billion numbers.
  refused([&](AnimatedParts& p) { p.add_channel("bone_1", "rotation", {0, 0.5f, 1e6f}, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, "LINEAR"); }, {"frames of 3 joints", "1e+06 seconds"});

  AnimatedParts parts;
  parts.add_animation("take");
  parts.add_channel("bone_0", "rotation", {0, 1}, {0, 0, 0, 1, kHalf, 0, 0, kHalf}, "LINEAR");
  const std::string whole = parts.glb();
  int refusals = 0;
  for (std::size_t size = 0; size < whole.size(); size += 7) {
    try {
      read_gltf_motion(folder.write("cut.glb", whole.substr(0, size)));
    } catch (const InputError&) {
      ++refusals;
    }
  }
  EXPECT_EQ(refusals, static_cast<int>((whole.size() + 6) / 7));
}

}  // namespace
}  // namespace arah
