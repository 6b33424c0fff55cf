#include "host/body/motion.h"

#include <limits>
#include <set>

#include "host/body/json_fields.h"
#include "host/file_writing.h"

namespace arah {
namespace {

Skeleton read_skeleton(const nlohmann::json& file, const std::string& where) {
  const nlohmann::json& names = json_list(json_member(file, "joint_names", where, ""), -1, where, "joint_names");
  const long count = static_cast<long>(names.size());
  const nlohmann::json& parents = json_list(json_member(file, "parents", where, ""), count, where, "parents");
  const nlohmann::json& rest = json_list(json_member(file, "joint_rest", where, ""), count, where, "joint_rest");
  Skeleton skeleton;
  for (std::size_t j = 0; j < names.size(); ++j) {
    skeleton.names.push_back(json_text(names[j], where, fmt::format("joint_names[{}]", j)));
    skeleton.parents.push_back(
        json_integer(parents[j], -1, static_cast<int>(count), where, fmt::format("parents[{}]", j)));
    skeleton.rest_joints.push_back(json_vector(rest[j], where, fmt::format("joint_rest[{}]", j)));
  }
  validate_skeleton(skeleton, where);
  return skeleton;
}

// The template's shape belongs to template.glb; coefficients here would silently do nothing.
void refuse_shape(const nlohmann::json& file, const std::string& where) {
  const auto betas = file.find("betas");
  if (betas == file.end()) return;
  for (const nlohmann::json& beta : json_list(*betas, -1, where, "betas")) {
    if (json_number(beta, where, "betas") != 0.0) {
      throw InputError(where, "betas", "0", json_excerpt(*betas), "Give the template the subject's shape instead.");
    }
  }
}

nlohmann::ordered_json as_json(const glm::dvec3& v) {
  return nlohmann::ordered_json::array({v.x, v.y, v.z});
}

}  // namespace

void check_motion_size(std::size_t frames, std::size_t joints, const std::string& where, const std::string& field) {
  const std::size_t most = kMostMotionJoints / (joints + 5);
  if (frames > most) throw InputError(where, field, fmt::format("at most {} frames of {} joints", most, joints), fmt::format("{}", frames), "Cut the motion into parts.");
}

Motion read_motion(const std::filesystem::path& path) {
  const std::string where = path.string();
  const nlohmann::json file = read_json(path);
  Motion motion;
  motion.skeleton = read_skeleton(file, where);
  if (file.contains("split")) motion.split = json_text(file["split"], where, "split");
  if (file.contains("poses")) motion.poses = json_text(file["poses"], where, "poses");
  if (file.contains("fps")) {
    motion.frames_per_second = json_number(file["fps"], where, "fps");
    if (!(motion.frames_per_second > 0.0)) throw InputError(where, "fps", "a rate above 0", json_excerpt(file["fps"]));
  }
  refuse_shape(file, where);
  const long joints = static_cast<long>(motion.skeleton.size());
  std::set<int> numbers;
  for (const nlohmann::json& entry : json_list(json_member(file, "frames", where, ""), -1, where, "frames")) {
    const std::string position = fmt::format("frames[{}]", motion.frames.size());
    MotionFrame frame;
    frame.number = json_integer(json_member(entry, "frame", where, position), 0, std::numeric_limits<int>::max(), where,
                                position + " frame");
    const std::string name = fmt::format("frame {}", frame.number);
    if (!numbers.insert(frame.number).second) {
      throw InputError(where, name, "each frame number once", "this one twice");
    }
    const nlohmann::json& theta = json_list(json_member(entry, "theta", where, name), joints, where, name + " theta");
    for (std::size_t j = 0; j < theta.size(); ++j) {
      frame.pose.theta.push_back(
          json_vector(theta[j], where, fmt::format("{} theta[{}] ({})", name, j, motion.skeleton.names[j])));
    }
    if (entry.contains("root_position")) {
      frame.pose.root_position = json_vector(entry["root_position"], where, name + " root_position");
    } else if (entry.contains("trans")) {
      frame.pose.root_position = motion.skeleton.rest_joints[0] + json_vector(entry["trans"], where, name + " trans");
    } else {
      throw InputError(where, name, "root_position or trans", "neither");
    }
    if (entry.contains("source")) frame.source = json_text(entry["source"], where, name + " source");
    motion.frames.push_back(std::move(frame));
  }
  if (motion.frames.empty()) throw InputError(where, "frames", "at least one frame", "none");
  return motion;
}

void write_motion(const std::filesystem::path& path, const Motion& motion) {
  nlohmann::ordered_json file;
  file["split"] = motion.split;
  if (!motion.poses.empty()) file["poses"] = motion.poses;
  if (motion.frames_per_second > 0.0) file["fps"] = motion.frames_per_second;
  file["joint_names"] = motion.skeleton.names;
  file["parents"] = motion.skeleton.parents;
  file["units"] = "metres, radians";
  file["joint_rest"] = nlohmann::json::array();
  for (const glm::dvec3& joint : motion.skeleton.rest_joints) file["joint_rest"].push_back(as_json(joint));
  file["frames"] = nlohmann::json::array();
  for (const MotionFrame& frame : motion.frames) {
    nlohmann::ordered_json entry;
    entry["frame"] = frame.number;
    entry["source"] = frame.source;
    entry["theta"] = nlohmann::json::array();
    for (const glm::dvec3& theta : frame.pose.theta) entry["theta"].push_back(as_json(theta));
    entry["root_position"] = as_json(frame.pose.root_position);
    entry["trans"] = as_json(root_translation(motion.skeleton, frame.pose));
    file["frames"].push_back(std::move(entry));
  }
  write_file_safely(path, file.dump() + "\n");
}

Motion adapt_motion(const Motion& motion, const Skeleton& skeleton, const std::string& where) {
  std::vector<std::size_t> target(motion.skeleton.size());
  for (std::size_t j = 0; j < target.size(); ++j) {
    const std::string& name = motion.skeleton.names[j];
    const int found = find_joint(skeleton, name);
    if (found < 0) {
      throw InputError(where, "joint_names", "joints of the template", fmt::format("'{}', which it lacks", name),
                       "Retarget the motion to the template's skeleton, or rename its joints.");
    }
    target[j] = static_cast<std::size_t>(found);
    const int own_parent = motion.skeleton.parents[j];
    const int parent = skeleton.parents[target[j]];
    const std::string own_name = own_parent < 0 ? "none" : motion.skeleton.names[static_cast<std::size_t>(own_parent)];
    const std::string name_there = parent < 0 ? "none" : skeleton.names[static_cast<std::size_t>(parent)];
    if (own_name != name_there) {
      throw InputError(where, fmt::format("parent of '{}'", name), fmt::format("'{}', as in the template", name_there),
                       fmt::format("'{}'", own_name));
    }
  }
  Motion adapted = motion;
  adapted.skeleton = skeleton;
  for (std::size_t f = 0; f < motion.frames.size(); ++f) {
    std::vector<glm::dvec3>& theta = adapted.frames[f].pose.theta;
    theta.assign(skeleton.size(), glm::dvec3(0.0));
    for (std::size_t j = 0; j < target.size(); ++j) theta[target[j]] = motion.frames[f].pose.theta.at(j);
  }
  return adapted;
}

const MotionFrame* find_frame(const Motion& motion, int number) {
  for (const MotionFrame& frame : motion.frames) {
    if (frame.number == number) return &frame;
  }
  return nullptr;
}

}  // namespace arah
