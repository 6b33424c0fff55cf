#include "host/body/gltf_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>
#include <map>
#include <optional>
#include <set>

#include "host/body/gltf_accessor.h"
#include "host/body/gltf_file.h"

namespace arah {
namespace {

constexpr double kUsualRate = 30;
constexpr std::size_t kMostRotations = 4'000'000;
constexpr double kEvenly = 0.01;      // of the spacing, that key frames may be off an even grid
constexpr double kMoved = 1e-3;       // m; bones that change their length by more are mentioned
constexpr double kMostGltfNumber = 1e6;

enum class Interpolation { step, linear, cubic };

// One sampler: values over time.
struct GltfTrack {
  Interpolation interpolation = Interpolation::linear;
  std::vector<double> times;
  std::vector<glm::dvec4> values;  // one a time; cubic: tangent in, value, tangent out

  const glm::dvec4& value(std::size_t key) const { return values[interpolation == Interpolation::cubic ? 3 * key + 1 : key]; }

  glm::dvec4 at(double time, bool rotation) const {
    if (time <= times.front()) return value(0);
    if (time >= times.back()) return value(times.size() - 1);
    const auto after = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), time) - times.begin());
    const std::size_t before = after - 1;
    if (interpolation == Interpolation::step) return value(before);
    const double span = times[after] - times[before], s = (time - times[before]) / span;
    if (interpolation == Interpolation::cubic) {
      const double s2 = s * s, s3 = s2 * s;
      return (2 * s3 - 3 * s2 + 1) * value(before) + span * (s3 - 2 * s2 + s) * values[3 * before + 2] + (3 * s2 - 2 * s3) * value(after) + span * (s3 - s2) * values[3 * after];
    }
    if (!rotation) return glm::mix(value(before), value(after), s);
    const auto quaternion = [](const glm::dvec4& v) { return glm::normalize(glm::dquat(v.w, v.x, v.y, v.z)); };
    const glm::dquat q = glm::slerp(quaternion(value(before)), quaternion(value(after)), s);
    return {q.x, q.y, q.z, q.w};
  }
};

// A node's translation, rotation and scale, at rest or in a frame.
struct GltfPlace {
  glm::dvec3 translation{0.0}, scale{1.0};
  glm::dquat rotation{1.0, 0.0, 0.0, 0.0};
};

// Where a node is in the world, with and without scales.
struct GltfWorld {
  glm::dmat4 transform{1.0};
  glm::dquat rotation{1.0, 0.0, 0.0, 0.0};

  glm::dvec3 position() const { return glm::dvec3(transform[3]); }
};

class GltfMotionReader {
 public:
  GltfMotionReader(const tinygltf::Model& model, const tinygltf::Animation& animation, std::string where)
      : model_(model), animation_(animation), where_(std::move(where)), tree_(model, where_) {
    for (std::size_t n = 0; n < model.nodes.size(); ++n) rest_.push_back(place_of(n));
    for (std::size_t c = 0; c < animation.channels.size(); ++c) read_channel(c);
    choose_joints();
  }

  GltfMotion read(double wanted_rate) {
    GltfMotion result;
    result.animation = animation_.name;
    Motion& motion = result.motion;
    std::map<std::size_t, GltfWorld> rest;
    for (const std::size_t node : joints_) {
      add_world(node, nullptr, rest);
      motion.skeleton.names.push_back(name_of(node));
      motion.skeleton.parents.push_back(parent_of(node));
      motion.skeleton.rest_joints.push_back(rest.at(node).position());
      check_finite(motion.skeleton.rest_joints.back(), node);
    }
    note_what_is_left_out(rest);

    double first = 0.0, last = 0.0;
    const double rate = key_rate(first, last);
    const double per_second = wanted_rate > 0.0 ? wanted_rate : rate > 0.0 ? rate : kUsualRate;
    if (rate == 0.0 && wanted_rate <= 0.0 && last > first) notes_.push_back(fmt::format("Key frames are not evenly spaced: sampled at {} a second.", kUsualRate));
    const double intervals = std::floor((last - first) * per_second + 1e-3);
    const std::size_t most = std::max(kMostRotations, 4 * numbers_) / joints_.size();
    if (!(intervals < static_cast<double>(most))) {
      throw InputError(where_, animation_.name, fmt::format("at most {} frames of {} joints", most, joints_.size()), fmt::format("{:.4g} seconds at {:.4g} frames a second", last - first, per_second),
                       "Ask for fewer frames a second.");
    }
    const auto count = static_cast<std::size_t>(intervals) + 1;
    motion.frames_per_second = last > first ? per_second : 0.0;
    for (std::size_t f = 0; f < count; ++f) {
      // Key times are float32: one that is meant is met.
      double time = first + static_cast<double>(f) / per_second;
      const auto key = std::lower_bound(all_times_.begin(), all_times_.end(), time - 1e-6 - 2.5e-7 * std::abs(time));
      if (key != all_times_.end() && std::abs(*key - time) <= 1e-6 + 2.5e-7 * std::abs(time)) time = *key;
      motion.frames.push_back(frame_at(time, static_cast<int>(f), rest));
    }
    result.notes = notes_;
    return result;
  }

 private:
  struct Tracks {
    std::optional<GltfTrack> translation, rotation;
  };

  [[noreturn]] void refuse(const std::string& field, const std::string& expected, const std::string& found) const { throw InputError(where_, field, expected, found); }

  std::string name_of(std::size_t node) const {
    const std::string& name = model_.nodes[node].name;
    return name.empty() ? fmt::format("node_{}", node) : repeated_.contains(name) ? fmt::format("{}_{}", name, node) : name;
  }

  void check_finite(const glm::dvec3& v, std::size_t node) const {
    for (int k = 0; k < 3; ++k) {
      if (!(std::abs(v[k]) <= kMostGltfNumber)) refuse(fmt::format("node {}", node), "a place within 1e6 m", fmt::format("{}", v[k]));
    }
  }

  // Anything may come out of nodes that are none; add_world refuses those that count.
  GltfPlace place_of(std::size_t n) const {
    const tinygltf::Node& node = model_.nodes[n];
    GltfPlace place;
    if (node.matrix.size() == 16) {
      const glm::dmat4 matrix = local_transform(node);
      glm::dmat3 linear(matrix);
      for (int k = 0; k < 3; ++k) place.scale[k] = glm::length(linear[k]);
      if (glm::determinant(linear) < 0.0) place.scale.x = -place.scale.x;
      for (int k = 0; k < 3; ++k) linear[k] /= place.scale[k];
      place.rotation = glm::normalize(glm::quat_cast(linear));
      place.translation = glm::dvec3(matrix[3]);
      return place;
    }
    if (node.rotation.size() == 4) {
      const glm::dquat q(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
      place.rotation = q / glm::length(q);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      if (node.scale.size() == 3) place.scale[static_cast<int>(k)] = node.scale[k];
      if (node.translation.size() == 3) place.translation[static_cast<int>(k)] = node.translation[k];
    }
    return place;
  }

  GltfTrack read_track(const tinygltf::AnimationSampler& sampler, int type, const std::string& field) {
    GltfTrack track;
    if (sampler.interpolation == "STEP") track.interpolation = Interpolation::step;
    else if (sampler.interpolation == "CUBICSPLINE") track.interpolation = Interpolation::cubic;
    else if (sampler.interpolation != "LINEAR" && !sampler.interpolation.empty()) refuse(field, "LINEAR, STEP or CUBICSPLINE", "'" + sampler.interpolation + "'");
    const GltfAccessor input(model_, sampler.input, TINYGLTF_TYPE_SCALAR, where_, field + " times");
    const GltfAccessor output(model_, sampler.output, type, where_, field + " values");
    const std::size_t each = track.interpolation == Interpolation::cubic ? 3 : 1;
    if (input.count() == 0 || output.count() / each != input.count() || output.count() % each != 0) {
      refuse(field, fmt::format("{} a key frame, and one at least", each == 3 ? "three values" : "a value"), fmt::format("{} times and {} values", input.count(), output.count()));
    }
    for (std::size_t i = 0; i < input.count(); ++i) {
      const double time = input.value(i, 0);
      if (!(std::abs(time) <= kMostGltfNumber)) refuse(field, "times of at most 1e6 s", fmt::format("{}", time));
      if (i > 0 && !(time > track.times.back())) refuse(field, "times that increase", fmt::format("{} after {}", time, track.times.back()));
      track.times.push_back(time);
    }
    const int components = type == TINYGLTF_TYPE_VEC4 ? 4 : 3;
    for (std::size_t i = 0; i < output.count(); ++i) {
      glm::dvec4 value(0.0);
      for (int k = 0; k < components; ++k) {
        value[k] = output.value(i, static_cast<std::size_t>(k));
        if (!(std::abs(value[k]) <= kMostGltfNumber)) refuse(fmt::format("{} key frame {}", field, i / each), "finite numbers of at most 1e6", fmt::format("{}", value[k]));
      }
      if (components == 4 && (each == 1 || i % 3 == 1) && !(glm::length(value) > 1e-6)) refuse(fmt::format("{} key frame {}", field, i / each), "a rotation", "a quaternion of length 0");
      track.values.push_back(value);
    }
    numbers_ += input.count();
    return track;
  }

  void read_channel(std::size_t c) {
    const tinygltf::AnimationChannel& channel = animation_.channels[c];
    const std::string field = fmt::format("animation '{}' channel {}", animation_.name, c);
    if (channel.target_path == "scale") scaled_ = true;
    if (channel.target_node < 0 || (channel.target_path != "rotation" && channel.target_path != "translation")) return;  // of an extension, weights, scale
    const auto node = static_cast<std::size_t>(channel.target_node);
    if (node >= model_.nodes.size()) refuse(field, fmt::format("one of {} nodes", model_.nodes.size()), fmt::format("node {}", node));
    if (channel.sampler < 0 || static_cast<std::size_t>(channel.sampler) >= animation_.samplers.size()) refuse(field, fmt::format("one of {} samplers", animation_.samplers.size()), fmt::format("sampler {}", channel.sampler));
    const tinygltf::AnimationSampler& sampler = animation_.samplers[static_cast<std::size_t>(channel.sampler)];
    const bool rotation = channel.target_path == "rotation";
    std::optional<GltfTrack>& track = rotation ? tracks_[node].rotation : tracks_[node].translation;
    if (track) refuse(field, "one channel a node and path", "a second one");
    track = read_track(sampler, rotation ? TINYGLTF_TYPE_VEC4 : TINYGLTF_TYPE_VEC3, field);
    all_times_.insert(all_times_.end(), track->times.begin(), track->times.end());
  }

  void choose_joints() {
    std::sort(all_times_.begin(), all_times_.end());
    all_times_.erase(std::unique(all_times_.begin(), all_times_.end()), all_times_.end());
    const auto turned = [&](std::size_t node) {
      const auto found = tracks_.find(node);
      return found != tracks_.end() && found->second.rotation;
    };
    std::vector<std::size_t> wanted;
    for (const tinygltf::Skin& skin : model_.skins) {
      if (!wanted.empty()) break;
      bool any = false;
      for (const int node : skin.joints) {
        if (node < 0 || static_cast<std::size_t>(node) >= model_.nodes.size()) refuse("skin", fmt::format("joints among {} nodes", model_.nodes.size()), fmt::format("node {}", node));
        any = any || turned(static_cast<std::size_t>(node));
      }
      if (any) wanted.assign(skin.joints.begin(), skin.joints.end());
    }
    if (wanted.empty()) {
      for (std::size_t n = 0; n < model_.nodes.size(); ++n) {
        std::size_t at = n;
        while (at != kNoGltfNode && !tracks_.contains(at)) at = tree_.parent(at);
        if (at != kNoGltfNode && model_.nodes[n].mesh < 0 && model_.nodes[n].camera < 0) wanted.push_back(n);
      }
    }
    if (std::none_of(wanted.begin(), wanted.end(), turned)) refuse(fmt::format("animation '{}'", animation_.name), "channels that turn nodes of a skeleton", "none");
    const std::set<std::size_t> chosen(wanted.begin(), wanted.end());
    if (chosen.size() != wanted.size()) refuse("skin", "each joint once", "one twice");
    const auto joint_above = [&](std::size_t node) {
      std::size_t at = tree_.parent(node);
      while (at != kNoGltfNode && !chosen.contains(at)) at = tree_.parent(at);
      return at;
    };
    std::map<std::size_t, std::size_t> below;  // how many joints have this root
    std::map<std::size_t, std::size_t> root_of;
    for (const std::size_t node : wanted) {
      std::size_t root = node;
      for (std::size_t at = joint_above(node); at != kNoGltfNode; at = joint_above(at)) root = at;
      root_of[node] = root;
      ++below[root];
    }
    const std::size_t root = std::max_element(below.begin(), below.end(), [](const auto& a, const auto& b) { return a.second < b.second; })->first;
    if (below.at(root) > kMostGltfJoints) refuse("skeleton", fmt::format("at most {} joints", kMostGltfJoints), fmt::format("{}", below.at(root)));
    if (wanted.size() > below.at(root)) notes_.push_back(fmt::format("{} joints that do not hang below '{}' are left out.", wanted.size() - below.at(root), model_.nodes[root].name));
    // The file's order where parents come first in it: the first joint whose parent is placed, over and over.
    std::erase_if(wanted, [&](std::size_t node) { return root_of[node] != root; });
    std::set<std::string> names;
    for (const std::size_t node : wanted) {
      if (!names.insert(model_.nodes[node].name).second) repeated_.insert(model_.nodes[node].name);
    }
    while (!wanted.empty()) {
      const auto next = std::find_if(wanted.begin(), wanted.end(), [&](std::size_t node) { return node == root || index_.contains(joint_above(node)); });
      index_[*next] = static_cast<int>(joints_.size());
      parents_[*next] = *next == root ? -1 : index_.at(joint_above(*next));
      joints_.push_back(*next);
      wanted.erase(next);
    }
  }

  int parent_of(std::size_t node) const { return parents_.at(node); }

  // Where a node is at a time (null: at rest), with all above it.
  const GltfWorld& add_world(std::size_t node, const double* time, std::map<std::size_t, GltfWorld>& worlds) const {
    std::vector<std::size_t> chain;
    for (std::size_t at = node; at != kNoGltfNode && !worlds.contains(at); at = tree_.parent(at)) chain.push_back(at);
    for (auto it = chain.rbegin(); it != chain.rend(); ++it) {
      GltfPlace place = rest_[*it];
      const auto tracks = tracks_.find(*it);
      if (time && tracks != tracks_.end()) {
        if (const auto& track = tracks->second.translation) place.translation = glm::dvec3(track->at(*time, false));
        if (const auto& track = tracks->second.rotation) {
          const glm::dvec4 q = track->at(*time, true);
          place.rotation = glm::normalize(glm::dquat(q.w, q.x, q.y, q.z));
        }
      }
      glm::dmat4 local(glm::mat3_cast(place.rotation));
      for (int k = 0; k < 3; ++k) local[k] *= place.scale[k];
      local[3] = glm::dvec4(place.translation, 1.0);
      const std::size_t parent = tree_.parent(*it);
      const GltfWorld above = parent == kNoGltfNode ? GltfWorld{} : worlds.at(parent);
      if (!time && !(glm::determinant(glm::dmat3(local)) > 0.0)) refuse(fmt::format("node {}", *it), "a transform that turns, moves and scales", "one that mirrors, flattens or has no rotation");
      worlds[*it] = {above.transform * local, above.rotation * place.rotation};
    }
    return worlds.at(node);
  }

  MotionFrame frame_at(double time, int number, const std::map<std::size_t, GltfWorld>& rest) const {
    MotionFrame frame;
    frame.number = number;
    std::map<std::size_t, GltfWorld> worlds;
    std::vector<glm::dquat> turned;  // from the rest, in the world
    for (const std::size_t node : joints_) {
      const GltfWorld& world = add_world(node, &time, worlds);
      turned.push_back(glm::normalize(world.rotation * glm::conjugate(rest.at(node).rotation)));
      const int parent = parent_of(node);
      if (parent < 0) frame.pose.root_position = world.position();
      const glm::dquat relative = parent < 0 ? turned.back() : glm::conjugate(turned[static_cast<std::size_t>(parent)]) * turned.back();
      frame.pose.theta.push_back(axis_angle_from_rotation(glm::mat3_cast(glm::normalize(relative))));
    }
    check_finite(frame.pose.root_position, joints_[0]);
    return frame;
  }

  void note_what_is_left_out(const std::map<std::size_t, GltfWorld>& rest) {
    std::size_t moving = 0;
    for (std::size_t j = 1; j < joints_.size(); ++j) {
      const auto tracks = tracks_.find(joints_[j]);
      if (tracks == tracks_.end() || !tracks->second.translation) continue;
      const GltfTrack& track = *tracks->second.translation;
      const std::size_t above = tree_.parent(joints_[j]);
      double most = 0.0;
      for (std::size_t k = 0; k < track.times.size(); ++k) {
        const glm::dvec3 by = glm::dvec3(track.value(k)) - rest_[joints_[j]].translation;
        most = std::max(most, glm::length(glm::dmat3(rest.at(above).transform) * by));
      }
      moving += most > kMoved ? 1 : 0;
    }
    if (moving > 0) notes_.push_back(fmt::format("Translations of {} joints below the root are left out: their bones change by more than a millimetre.", moving));
    if (scaled_) notes_.push_back("Scales that change over time are left out.");
  }

  // The even rate of the channel with the most key frames; 0 where there is none.
  double key_rate(double& first, double& last) const {
    first = all_times_.front();
    last = all_times_.back();
    const std::vector<double>* most = nullptr;
    for (const auto& [node, tracks] : tracks_) {
      for (const std::optional<GltfTrack>* track : {&tracks.rotation, &tracks.translation}) {
        if (*track && (!most || (*track)->times.size() > most->size())) most = &(*track)->times;
      }
    }
    const std::vector<double>& times = *most;
    const std::size_t steps = times.size() - 1;
    if (steps == 0) return 0.0;
    const double step = (times.back() - times.front()) / static_cast<double>(steps);
    for (std::size_t i = 0; i <= steps; ++i) {
      if (std::abs(times[i] - times.front() - static_cast<double>(i) * step) > kEvenly * step) return 0.0;
    }
    const double rate = 1.0 / step, whole = std::round(rate);
    return whole > 0.0 && std::abs(rate / whole - 1.0) < 5e-4 ? whole : rate;
  }

  const tinygltf::Model& model_;
  const tinygltf::Animation& animation_;
  std::string where_;
  GltfNodeTree tree_;
  std::vector<GltfPlace> rest_;              // of all nodes
  std::map<std::size_t, Tracks> tracks_;     // of animated nodes
  std::vector<std::size_t> joints_;          // nodes, parents first
  std::map<std::size_t, int> index_, parents_;  // of joints' nodes: its place in joints_, its parent's
  std::set<std::string> repeated_;
  std::vector<double> all_times_;            // of key frames, ascending
  std::vector<std::string> notes_;
  std::size_t numbers_ = 0;                  // of key frames over all channels
  bool scaled_ = false;
};

tinygltf::Model read_animated_gltf(const std::filesystem::path& path) {
  tinygltf::Model model = parse_gltf(gltf_bytes(path), path.string(), std::filesystem::absolute(path).parent_path());
  for (std::size_t a = 0; a < model.animations.size(); ++a) {
    if (model.animations[a].name.empty()) model.animations[a].name = fmt::format("animation_{}", a);
  }
  return model;
}

}  // namespace

std::vector<std::string> gltf_animation_names(const std::filesystem::path& path) {
  std::vector<std::string> names;
  for (const tinygltf::Animation& animation : read_animated_gltf(path).animations) names.push_back(animation.name);
  return names;
}

GltfMotion read_gltf_motion(const std::filesystem::path& path, const std::string& animation, double frames_per_second) {
  const std::string where = path.string();
  const tinygltf::Model model = read_animated_gltf(path);
  if (std::find(model.extensionsRequired.begin(), model.extensionsRequired.end(), "EXT_meshopt_compression") != model.extensionsRequired.end()) {
    throw InputError(where, "extensionsRequired", "plain data", "EXT_meshopt_compression", "Export without compression.");
  }
  if (model.animations.empty()) throw InputError(where, "animations", "an animation", "none");
  std::string names;
  for (const tinygltf::Animation& candidate : model.animations) {
    if (animation.empty() || candidate.name == animation) return GltfMotionReader(model, candidate, where).read(frames_per_second);
    names += (names.empty() ? "'" : ", '") + candidate.name.substr(0, 60) + "'";
  }
  throw InputError(where, "animation", "one of " + names.substr(0, 400), "'" + animation + "'");
}

}  // namespace arah
