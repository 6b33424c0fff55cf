#include "host/body/smpl_joints.h"

#include <array>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kSmpl = 24, kSmplH = 52, kSmplX = 55;
constexpr std::size_t kBody = 22;  // joints up to the wrists, which all three share
constexpr std::array<const char*, kBody> kBodyNames{
    "pelvis",     "left_hip",   "right_hip", "spine1", "left_knee",   "right_knee",   "spine2", "left_ankle",
    "right_ankle", "spine3",    "left_foot", "right_foot", "neck",    "left_collar",  "right_collar", "head",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"};
constexpr std::array<int, kBody> kBodyParents{-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19};
constexpr int kHead = 15, kWrists[2] = {20, 21};

void check_count(std::size_t joints, const std::string& where) {
  if (joints == kSmpl || joints == kSmplH || joints == kSmplX) return;
  throw InputError(where, "joints", "24 (SMPL), 52 (SMPL-H) or 55 (SMPL-X)", fmt::format("{}", joints));
}

}  // namespace

std::vector<std::string> smpl_joint_names(std::size_t joints, const std::string& where) {
  check_count(joints, where);
  std::vector<std::string> names(kBodyNames.begin(), kBodyNames.end());
  if (joints == kSmpl) names.insert(names.end(), {"left_hand", "right_hand"});
  if (joints == kSmplX) names.insert(names.end(), {"jaw", "left_eye_smplhf", "right_eye_smplhf"});
  for (const char* side : {"left", "right"}) {
    for (const char* finger : {"index", "middle", "pinky", "ring", "thumb"}) {
      for (int bone = 1; joints != kSmpl && bone <= 3; ++bone) names.push_back(fmt::format("{}_{}{}", side, finger, bone));
    }
  }
  return names;
}

std::vector<int> smpl_joint_parents(std::size_t joints, const std::string& where) {
  check_count(joints, where);
  std::vector<int> parents(kBodyParents.begin(), kBodyParents.end());
  if (joints == kSmpl) parents.insert(parents.end(), {kWrists[0], kWrists[1]});
  if (joints == kSmplX) parents.insert(parents.end(), {kHead, kHead, kHead});
  for (const int wrist : kWrists) {
    for (int bone = 0; joints != kSmpl && bone < 15; ++bone) {
      parents.push_back(bone % 3 == 0 ? wrist : static_cast<int>(parents.size()) - 1);
    }
  }
  return parents;
}

}  // namespace arah
