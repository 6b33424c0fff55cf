#include "host/body/retarget.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <optional>
#include <span>

#include "host/body/pose_blend.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kMostFrames = 10'000'000;
constexpr std::size_t kFewestNamed = 3;

// What rigs call a joint, without spaces, signs and the side, in the order in which a name is looked for; a joint that has a
// name already is not given a second one.
struct Spellings {
  const char* name;
  bool sided;
  std::vector<const char*> words;
};

const std::vector<Spellings>& spellings() {
  static const std::vector<Spellings> all{
      {"pelvis", false, {"pelvis", "hips", "hip", "root"}},
      {"neck", false, {"neck", "neck1", "neck01"}},
      {"head", false, {"head"}},
      {"hip", true, {"upleg", "upperleg", "thigh", "hip"}},
      {"knee", true, {"leg", "lowerleg", "lowleg", "shin", "calf", "knee"}},
      {"ankle", true, {"ankle", "foot"}},
      {"foot", true, {"toebase", "toe", "toes", "toe0", "ball", "foot"}},
      {"shoulder", true, {"arm", "upperarm", "uparm", "shldr", "shoulder"}},
      {"collar", true, {"collar", "clavicle", "collarbone", "shoulder"}},
      {"elbow", true, {"forearm", "lowerarm", "lowarm", "elbow"}},
      {"wrist", true, {"wrist", "hand"}},
      {"hand", true, {"hand"}},
  };
  return all;
}

// Lower case, letters and digits only, without a rig's prefix ("mixamorig:").
std::string plain(const std::string& name) {
  const std::size_t colon = name.rfind(':');
  std::string text;
  for (const char c : colon == name.npos ? name : name.substr(colon + 1)) {
    if (std::isalnum(static_cast<unsigned char>(c))) text += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  for (const char* prefix : {"mixamorig", "character1", "bip01", "bip001"}) {
    if (text.starts_with(prefix) && text.size() > std::string(prefix).size()) return text.substr(std::string(prefix).size());
  }
  return text;
}

std::size_t joint_index(int joint) {
  return static_cast<std::size_t>(joint);
}

int joint_named(std::span<const NamedJoint> names, const std::string& name) {
  for (const NamedJoint& named : names)
    if (named.name == name) return named.joint;
  return -1;
}

// The joints between two, from above, without either; empty where `below` does not hang below `above`.
std::vector<int> between(const Skeleton& skeleton, int above, int below) {
  std::vector<int> joints;
  for (int at = below < 0 ? -1 : skeleton.parents[joint_index(below)]; at != above; at = skeleton.parents[joint_index(at)]) {
    if (at < 0) return {};
    joints.push_back(at);
  }
  std::reverse(joints.begin(), joints.end());
  return joints;
}

// The rest places of some joints of SMPL's names; nothing where one is missing.
std::optional<std::vector<glm::dvec3>> rest_of(const Skeleton& skeleton, std::span<const NamedJoint> names, const std::vector<std::string>& wanted) {
  std::vector<glm::dvec3> places;
  for (const std::string& name : wanted) {
    const int joint = joint_named(names, name);
    if (joint < 0) return std::nullopt;
    places.push_back(skeleton.rest_joints[joint_index(joint)]);
  }
  return places;
}

// The unit vector along the axis that is nearest to `v`.
glm::dvec3 nearest_axis(const glm::dvec3& v) {
  int most = 0;
  for (int k = 1; k < 3; ++k)
    if (std::abs(v[k]) > std::abs(v[most])) most = k;
  glm::dvec3 axis(0.0);
  axis[most] = v[most] < 0.0 ? -1.0 : 1.0;
  return axis;
}

// Of both legs together, hip to knee to ankle; 0 where joints are missing.
double leg_length(const Skeleton& skeleton, std::span<const NamedJoint> names) {
  double length = 0.0;
  for (const std::string side : {"left_", "right_"}) {
    const auto leg = rest_of(skeleton, names, {side + "hip", side + "knee", side + "ankle"});
    if (!leg) return 0.0;
    length += glm::distance((*leg)[0], (*leg)[1]) + glm::distance((*leg)[1], (*leg)[2]);
  }
  return length;
}

// The joint at the other end of a limb's bone, in SMPL's names; "" for all other joints.
std::string limb_end(const std::string& name) {
  static constexpr std::array<std::array<const char*, 2>, 4> kBones{{{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}}};
  const std::size_t side = name.find('_') + 1;  // 0 where there is none
  for (const auto& bone : kBones)
    if (side > 0 && name.substr(side) == bone[0]) return name.substr(0, side) + bone[1];
  return "";
}

// The joints whose middle is followed: the hips.
std::optional<std::array<std::size_t, 2>> hips_of(std::span<const NamedJoint> names) {
  const int left = joint_named(names, "left_hip"), right = joint_named(names, "right_hip");
  if (left < 0 || right < 0) return std::nullopt;
  return std::array<std::size_t, 2>{joint_index(left), joint_index(right)};
}

glm::dvec3 middle(const std::array<std::size_t, 2>& joints, const std::vector<glm::dvec3>& places) {
  return 0.5 * (places[joints[0]] + places[joints[1]]);
}

// D_j of the header for all joints of the target.
struct RestCorrections {
  std::vector<glm::dmat3> turns;
  double largest_degrees = 0;  // of a limb
};

RestCorrections rest_corrections(const Skeleton& source, std::span<const NamedJoint> source_names, const Skeleton& target,
                                 std::span<const NamedJoint> target_names) {
  RestCorrections result;
  const glm::dmat3 axes = rest_axes(source) * glm::transpose(rest_axes(target));
  for (std::size_t j = 0; j < target.size(); ++j) {
    const int parent = target.parents[j];
    glm::dmat3 turn = parent < 0 ? axes : result.turns[joint_index(parent)];
    for (const NamedJoint& named : target_names) {
      if (named.joint != static_cast<int>(j)) continue;
      if (named.name.ends_with("_ankle")) turn = axes;
      const std::string end = limb_end(named.name);
      if (end.empty()) continue;
      const auto own = rest_of(target, target_names, {named.name, end}), theirs = rest_of(source, source_names, {named.name, end});
      if (!own || !theirs) continue;
      const glm::dvec3 from = axes * ((*own)[1] - (*own)[0]), to = (*theirs)[1] - (*theirs)[0];
      if (!(glm::length(from) > 0.0 && glm::length(to) > 0.0)) continue;
      const glm::dmat3 shortest = shortest_turn(glm::normalize(from), glm::normalize(to));
      turn = shortest * axes;
      result.largest_degrees = std::max(result.largest_degrees, glm::degrees(glm::length(axis_angle_from_rotation(shortest))));
    }
    result.turns.push_back(turn);
  }
  return result;
}

void number_frames(Motion& motion) {
  for (std::size_t f = 0; f < motion.frames.size(); ++f) motion.frames[f].number = static_cast<int>(f);
}

}  // namespace

std::vector<NamedJoint> smpl_names(const Skeleton& skeleton) {
  std::vector<std::string> words;
  for (const std::string& name : skeleton.names) words.push_back(plain(name));
  std::vector<NamedJoint> names;
  std::vector<bool> taken(skeleton.size(), false);
  // Takes the first joint that is called one of these and has no name yet.
  const auto take = [&](const std::string& name, const std::vector<std::string>& called) {
    for (const std::string& word : called) {
      for (std::size_t j = 0; j < words.size(); ++j) {
        if (taken[j] || words[j] != word) continue;
        taken[j] = true;
        names.push_back({name, static_cast<int>(j)});
        return;
      }
    }
  };
  for (const Spellings& spelling : spellings()) {
    for (const std::string side : {"left", "right"}) {
      std::vector<std::string> called;
      for (const std::string word : spelling.words) {
        if (!spelling.sided) called.push_back(word);
        else for (const std::string& sided : {side + word, side.substr(0, 1) + word, word + side, word + side.substr(0, 1)}) called.push_back(sided);
      }
      take(spelling.sided ? side + "_" + spelling.name : spelling.name, called);
      if (!spelling.sided) break;
    }
  }
  const int pelvis = joint_named(names, "pelvis");
  std::vector<int> spine;
  for (const char* end : {"neck", "head", "left_collar", "left_shoulder"}) {
    if (spine.empty() && pelvis >= 0) spine = between(skeleton, pelvis, joint_named(names, end));
  }
  std::erase_if(spine, [&](int joint) { return taken[joint_index(joint)]; });
  for (std::size_t k = 1; k <= 3 && !spine.empty(); ++k) names.push_back({fmt::format("spine{}", k), spine[(k * spine.size() + 2) / 3 - 1]});
  return names;
}

glm::dmat3 rest_axes(const Skeleton& skeleton) {
  const auto legs = rest_of(skeleton, smpl_names(skeleton), {"left_hip", "right_hip", "left_ankle", "right_ankle"});
  if (!legs) return glm::dmat3(1.0);
  const auto& p = *legs;
  const glm::dvec3 up = nearest_axis(p[0] + p[1] - p[2] - p[3]);
  const glm::dvec3 left = p[0] - p[1];
  const glm::dvec3 across = nearest_axis(left - glm::dot(left, up) * up);
  if (glm::dot(across, up) != 0.0) return glm::dmat3(1.0);  // the hips are not beside one another
  return {across, up, glm::cross(across, up)};
}

Retargeted retarget(const Motion& source, const Skeleton& target, const RetargetSettings& settings, const std::string& where) {
  const std::vector<NamedJoint> source_names = smpl_names(source.skeleton), target_names = smpl_names(target);
  Retargeted result;
  result.sources.assign(target.size(), -1);
  std::size_t matched = 0;
  for (std::size_t j = 0; j < target.size(); ++j) {
    for (const NamedJoint& named : target_names) {
      if (named.joint == static_cast<int>(j)) result.sources[j] = joint_named(source_names, named.name);
    }
    const bool unnamed = std::none_of(target_names.begin(), target_names.end(), [&](const NamedJoint& named) { return named.joint == static_cast<int>(j); });
    if (unnamed) result.sources[j] = find_joint(source.skeleton, target.names[j]);
    matched += result.sources[j] >= 0 ? 1 : 0;
  }
  if (matched < kFewestNamed || result.sources[0] < 0) {
    std::string found;
    for (std::size_t j = 0; j < std::min<std::size_t>(6, source.skeleton.size()); ++j) found += (j == 0 ? "'" : ", '") + source.skeleton.names[j].substr(0, 40) + "'";
    throw InputError(where, "joints", fmt::format("the target's root '{}' and two joints more, by names that are known", target.names[0]),
                     fmt::format("{} of {} joints: {} …", matched, source.skeleton.size(), found), "Rename the joints, in the file or in the rig.");
  }

  const double source_leg = leg_length(source.skeleton, source_names), target_leg = leg_length(target, target_names);
  if (settings.scale == 0.0 && !(source_leg > 0.0 && target_leg > 0.0)) {
    throw InputError(where, "scale", "legs in both skeletons, hip to ankle", "none in one of them", "Give the scale from its lengths to metres.");
  }
  result.scale = settings.scale > 0.0 ? settings.scale : target_leg / source_leg;

  RestCorrections corrections = rest_corrections(source.skeleton, source_names, target, target_names);
  result.same_rest = corrections.largest_degrees <= settings.same_rest_degrees;
  if (result.same_rest) corrections.turns.assign(target.size(), corrections.turns[0]);

  result.motion = source;
  result.motion.skeleton = target;
  auto source_hips = hips_of(source_names), target_hips = hips_of(target_names);
  if (!source_hips || !target_hips) {  // the roots instead
    source_hips = {joint_index(result.sources[0]), joint_index(result.sources[0])};
    target_hips = {0, 0};
  }
  const glm::dvec3 hips_at_rest = middle(*target_hips, target.rest_joints) - target.rest_joints[0];
  std::vector<glm::dvec3> places(source.skeleton.size());
  std::vector<glm::dmat3> turned(target.size());
  for (MotionFrame& frame : result.motion.frames) {
    const std::vector<glm::dmat4> posed = forward_kinematics(source.skeleton, frame.pose);
    for (std::size_t j = 0; j < places.size(); ++j) places[j] = glm::dvec3(posed[j][3]) + root_translation(source.skeleton, frame.pose);
    frame.pose.theta.resize(target.size());
    for (std::size_t j = 0; j < target.size(); ++j) {
      const glm::dmat3 parent = target.parents[j] < 0 ? glm::dmat3(1.0) : turned[joint_index(target.parents[j])];
      turned[j] = result.sources[j] < 0 ? parent : glm::dmat3(posed[joint_index(result.sources[j])]) * corrections.turns[j];
      frame.pose.theta[j] = axis_angle_from_rotation(glm::transpose(parent) * turned[j]);
    }
    frame.pose.root_position = result.scale * middle(*source_hips, places) - turned[0] * hips_at_rest;
    const glm::dvec3& at = frame.pose.root_position;
    if (!std::isfinite(at.x + at.y + at.z)) throw InputError(where, fmt::format("frame {}", frame.number), "a finite root position", "one that is not");
  }
  return result;
}

std::string retarget_table(const Retargeted& result, const Skeleton& source) {
  std::string table, resting;
  for (std::size_t j = 0; j < result.sources.size(); ++j) {
    const std::string& name = result.motion.skeleton.names[j];
    if (result.sources[j] >= 0) table += fmt::format("  {:<16} {}\n", name, source.names[joint_index(result.sources[j])]);
    else resting += (resting.empty() ? "" : ", ") + name;
  }
  if (!resting.empty()) table += fmt::format("  at rest: {}\n", resting);
  return table;
}

Motion cut(const Motion& motion, std::size_t first, std::size_t end, std::size_t step, const std::string& where) {
  Motion result = motion;
  result.frames.clear();
  for (std::size_t f = first; f < std::min(end, motion.frames.size()); f += step) result.frames.push_back(motion.frames[f]);
  if (result.frames.empty()) throw InputError(where, "frames", fmt::format("some of the {} that there are", motion.frames.size()), fmt::format("{}:{}", first, end));
  result.frames_per_second = motion.frames_per_second / static_cast<double>(step);
  number_frames(result);
  return result;
}

Motion resampled(const Motion& motion, double frames_per_second, const std::string& where) {
  if (!(motion.frames_per_second > 0.0)) throw InputError(where, "rate", "a motion that states its frames a second", "none stated");
  const std::size_t last = motion.frames.size() - 1;
  const double ratio = motion.frames_per_second / frames_per_second;
  const double intervals = std::floor(static_cast<double>(last) / ratio + 1e-6);
  if (!(intervals < static_cast<double>(kMostFrames))) throw InputError(where, "frames", fmt::format("at most {}", kMostFrames), fmt::format("{:.0f}", intervals));
  Motion result = motion;
  result.frames_per_second = frames_per_second;
  result.frames.clear();
  for (std::size_t f = 0; f <= static_cast<std::size_t>(intervals); ++f) {
    const double at = std::min(ratio * static_cast<double>(f), static_cast<double>(last));
    const auto before = static_cast<std::size_t>(at);
    const MotionFrame& a = motion.frames[before];
    const MotionFrame& b = motion.frames[std::min(before + 1, last)];
    const double part = at - static_cast<double>(before);
    MotionFrame frame = a;
    frame.pose = blended(a.pose, b.pose, part);
    result.frames.push_back(std::move(frame));
  }
  number_frames(result);
  return result;
}

Motion looped(const Motion& motion, int times, const std::string& where) {
  if (motion.frames.size() * static_cast<std::size_t>(times) > kMostFrames) {
    throw InputError(where, "frames", fmt::format("at most {}", kMostFrames), fmt::format("{} times {}", times, motion.frames.size()));
  }
  Motion result = motion;
  for (int time = 1; time < times; ++time) result.frames.insert(result.frames.end(), motion.frames.begin(), motion.frames.end());
  number_frames(result);
  return result;
}

Motion placed(const Motion& motion, const std::vector<double>& place) {
  Motion result = motion;
  const glm::dvec3 start = motion.frames.at(0).pose.root_position;
  const glm::dvec3 by(place.at(0) - start.x, place.at(1) - start.y, place.size() > 2 ? place[2] - start.z : 0.0);
  for (MotionFrame& frame : result.frames) frame.pose.root_position += by;
  return result;
}

}  // namespace arah
