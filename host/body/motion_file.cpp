#include "host/body/motion_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>

#include "host/body/bvh.h"
#include "host/body/gltf_motion.h"
#include "host/body/npz.h"
#include "host/body/pickle.h"
#include "host/body/smpl_joints.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kSharedJoints = 22;  // of SMPL, SMPL-H and SMPL-X: all but hands and face
constexpr double kSameRestDegrees = 10;
constexpr double kAistFramesPerSecond = 60;
constexpr double kMostMotionNumber = 1e6;

// Rest joints of SMPL's mean male body, m.
constexpr std::array<std::array<double, 3>, kSharedJoints> kMeanSmpl{{
    {-0.002, -0.223, 0.028}, {0.068, -0.315, 0.021},  {-0.069, -0.314, 0.024}, {-0.004, -0.114, 0.002},
    {0.102, -0.690, 0.017},  {-0.108, -0.696, 0.015}, {0.001, 0.021, 0.003},   {0.088, -1.088, -0.027},
    {-0.092, -1.095, -0.027}, {0.003, 0.074, 0.028},  {0.115, -1.144, 0.093},  {-0.117, -1.143, 0.096},
    {0.000, 0.288, -0.015},  {0.081, 0.195, -0.006},  {-0.079, 0.193, -0.011}, {0.005, 0.353, 0.037},
    {0.172, 0.226, -0.015},  {-0.175, 0.225, -0.020}, {0.432, 0.213, -0.042},  {-0.429, 0.212, -0.041},
    {0.681, 0.222, -0.044},  {-0.684, 0.220, -0.047},
}};

Skeleton mean_smpl() {
  Skeleton skeleton;
  skeleton.names = smpl_joint_names(24, "");
  skeleton.parents = smpl_joint_parents(24, "");
  skeleton.names.resize(kSharedJoints);
  skeleton.parents.resize(kSharedJoints);
  for (const auto& [x, y, z] : kMeanSmpl) skeleton.rest_joints.emplace_back(x, y, z);
  return skeleton;
}

double bounded(double number, const std::string& where, const std::string& field) {
  if (!(std::abs(number) <= kMostMotionNumber)) throw InputError(where, field, "finite numbers of at most 1e6", fmt::format("{}", number));
  return number;
}

// Poses of SMPL's kind and translations; `trans` times `metres`. The root's joint is where it rests, moved by trans.
Motion smpl_motion(const PythonArray& poses, const char* poses_field, const PythonArray& trans, const char* trans_field, double metres, const std::string& where) {
  Motion motion;
  motion.skeleton = mean_smpl();
  const std::size_t frames = poses.shape[0], numbers = poses.shape[1];
  if (frames == 0) throw InputError(where, poses_field, "at least one frame", "none");
  if (trans.shape[0] != frames) throw InputError(where, trans_field, fmt::format("{} frames, as {} has", frames, poses_field), fmt::format("{}", trans.shape[0]));
  check_motion_size(frames, kSharedJoints, where, poses_field);
  for (std::size_t f = 0; f < frames; ++f) {
    MotionFrame frame;
    frame.number = static_cast<int>(f);
    frame.pose = rest_pose(motion.skeleton);
    for (std::size_t k = 0; k < 3 * kSharedJoints; ++k) {
      frame.pose.theta[k / 3][static_cast<int>(k % 3)] = bounded(poses.number(f * numbers + k), where, fmt::format("{} frame {}", poses_field, f));
    }
    for (std::size_t k = 0; k < 3; ++k) {
      frame.pose.root_position[static_cast<int>(k)] += metres * bounded(trans.number(f * 3 + k), where, fmt::format("{} frame {}", trans_field, f));
    }
    motion.frames.push_back(std::move(frame));
  }
  return motion;
}

// The same motion where `up` is +Z.
void stand_up(Motion& motion, const glm::dvec3& up) {
  const glm::dmat3 turn = shortest_turn(up, {0.0, 0.0, 1.0});
  for (MotionFrame& frame : motion.frames) {
    frame.pose.root_position = turn * frame.pose.root_position;
    frame.pose.theta[0] = axis_angle_from_rotation(turn * rotation_from_axis_angle(frame.pose.theta[0]));
  }
}

MotionFile read_amass(const std::filesystem::path& path) {
  const std::string where = path.string();
  const NpzFile file(path);
  MotionFile result;
  result.format = "AMASS";
  if (!file.has("poses") || !file.has("trans")) {
    std::string names;
    for (const std::string& name : file.names()) names += (names.empty() ? "" : ", ") + name.substr(0, 40);
    throw InputError(where, "", "a motion of AMASS with poses and trans", names.empty() ? "no arrays" : names.substr(0, 200));
  }
  const PythonData poses = file.read("poses"), trans = file.read("trans");
  const PythonArray& rotations = python_array(*poses.root, {-1, -1}, where, "poses");
  if (rotations.shape[1] % 3 != 0) throw InputError(where, "poses", "three numbers a joint", fmt::format("{} numbers", rotations.shape[1]));
  smpl_joint_names(rotations.shape[1] / 3, where);  // refuses other counts
  result.motion = smpl_motion(rotations, "poses", python_array(*trans.root, {-1, 3}, where, "trans"), "trans", 1.0, where);
  for (const char* name : {"mocap_framerate", "mocap_frame_rate"}) {
    if (!file.has(name) || result.motion.frames_per_second > 0.0) continue;
    const PythonData rate = file.read(name);
    result.motion.frames_per_second = python_numbers(*rate.root, 1, where, name)[0];
    if (!(result.motion.frames_per_second > 0.0 && result.motion.frames_per_second <= kMostMotionNumber)) {
      throw InputError(where, name, "frames a second, above 0", fmt::format("{}", result.motion.frames_per_second));
    }
  }
  return result;
}

MotionFile read_aist(const std::filesystem::path& path) {
  const std::string where = path.string();
  const PythonData file = read_pickle(path);
  const PythonArray& poses = python_array(python_member(*file.root, "smpl_poses", where, ""), {-1, 72}, where, "smpl_poses");
  const PythonArray& trans = python_array(python_member(*file.root, "smpl_trans", where, ""), {-1, 3}, where, "smpl_trans");
  double scaling = 100.0;
  if (const PythonValue* stated = python_find(*file.root, "smpl_scaling")) scaling = python_numbers(*stated, 1, where, "smpl_scaling")[0];
  if (!(scaling >= 1e-3)) throw InputError(where, "smpl_scaling", "a number above 0", fmt::format("{}", scaling));
  MotionFile result;
  result.format = "AIST++";
  result.motion = smpl_motion(poses, "smpl_poses", trans, "smpl_trans", 1.0 / scaling, where);
  result.motion.frames_per_second = kAistFramesPerSecond;
  stand_up(result.motion, {0.0, 1.0, 0.0});
  return result;
}

}  // namespace

bool is_foreign_motion(const std::filesystem::path& path) {
  return path.extension() == ".bvh" || path.extension() == ".npz" || path.extension() == ".pkl";
}

MotionFile read_motion_file(const std::filesystem::path& path, const std::string& animation, double frames_per_second) {
  const std::string extension = path.extension().string();
  MotionFile result;
  if (extension == ".bvh") {
    result.format = "BVH";
    result.motion = read_bvh(path);
    stand_up(result.motion, rest_axes(result.motion.skeleton)[1]);
  } else if (extension == ".npz" || extension == ".pkl") {
    result = extension == ".npz" ? read_amass(path) : read_aist(path);
    result.settings.same_rest_degrees = kSameRestDegrees;
    result.notes.push_back("The file's hands, face and body shape are left out.");
  } else if (extension == ".glb" || extension == ".gltf") {
    GltfMotion read = read_gltf_motion(path, animation, frames_per_second);
    result = {std::move(read.motion), fmt::format("glTF animation '{}'", read.animation), std::move(read.notes), {}};
    stand_up(result.motion, {0.0, 1.0, 0.0});
  } else if (extension == ".json") {
    result.format = "motion";
    result.motion = read_motion(path);
  } else {
    throw InputError(path.string(), "", "a motion: .bvh, .glb, .gltf, .npz (AMASS), .pkl (AIST++) or .json", fmt::format("a file ending in '{}'", extension));
  }
  return result;
}

}  // namespace arah
