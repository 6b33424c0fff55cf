#include "host/body/morph_targets.h"

#include <algorithm>
#include <cmath>

#include "host/body/gltf_accessor.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kMostTargets = 1024, kMostDisplacements = 12'000'000;

}  // namespace

std::optional<std::vector<glm::dvec3>> MorphTargets::stated_joints(const tinygltf::Mesh& mesh, std::size_t target) const {
  if (!mesh.extras.IsObject() || !mesh.extras.Has("joint_shapedirs")) return std::nullopt;
  const std::string field = fmt::format("mesh '{}' extras.joint_shapedirs", mesh.name);
  const tinygltf::Value& all = mesh.extras.Get("joint_shapedirs");
  const std::size_t count = mesh.primitives[0].targets.size();
  if (!all.IsArray() || all.ArrayLen() != count) {
    throw InputError(where_, field, fmt::format("a list of {}, one for each target", count), all.IsArray() ? fmt::format("{}", all.ArrayLen()) : "no list");
  }
  const tinygltf::Value& of_target = all.Get(static_cast<int>(target));
  if (!of_target.IsArray() || of_target.ArrayLen() != joint_of_slot_.size()) {
    throw InputError(where_, fmt::format("{}[{}]", field, target), fmt::format("a list of {}, one for each joint", joint_of_slot_.size()),
                     of_target.IsArray() ? fmt::format("{}", of_target.ArrayLen()) : "no list");
  }
  std::vector<glm::dvec3> joints(joint_of_slot_.size());
  for (std::size_t slot = 0; slot < joints.size(); ++slot) {
    const tinygltf::Value& vector = of_target.Get(static_cast<int>(slot));
    glm::dvec3 offset;
    for (int axis = 0; axis < 3; ++axis) {
      const bool number = vector.IsArray() && vector.ArrayLen() == 3 && vector.Get(axis).IsNumber();
      offset[axis] = number ? vector.Get(axis).GetNumberAsDouble() : NAN;
      if (!std::isfinite(offset[axis])) {
        throw InputError(where_, fmt::format("{}[{}][{}]", field, target, slot), "three finite numbers", "something else");
      }
    }
    joints[static_cast<std::size_t>(joint_of_slot_[slot])] = linear_ * offset;
  }
  return joints;
}

void MorphTargets::begin_mesh(const tinygltf::Node& node, const tinygltf::Mesh& mesh) {
  of_mesh_.clear();
  const std::size_t count = mesh.primitives.empty() ? 0 : mesh.primitives[0].targets.size();
  for (const tinygltf::Primitive& primitive : mesh.primitives) {
    if (primitive.targets.size() != count) {
      throw InputError(where_, fmt::format("mesh '{}'", mesh.name), fmt::format("{} morph targets in each primitive, as in the first", count), fmt::format("{}", primitive.targets.size()));
    }
  }
  const std::vector<double>& weights = node.weights.empty() ? mesh.weights : node.weights;
  if (!weights.empty() && weights.size() != count) {
    throw InputError(where_, fmt::format("mesh '{}' weights", mesh.name), fmt::format("{}, one for each morph target", count), fmt::format("{}", weights.size()));
  }
  if (count > kMaxShapes) {
    most_ = std::max(most_, count);
    return;
  }
  for (std::size_t t = 0; t < count; ++t) {
    Target target;
    target.name = fmt::format("shape_{}", t);
    if (mesh.extras.IsObject() && mesh.extras.Has("targetNames")) {
      const tinygltf::Value& names = mesh.extras.Get("targetNames");
      if (names.IsArray() && t < names.ArrayLen() && names.Get(static_cast<int>(t)).IsString()) {
        target.name = names.Get(static_cast<int>(t)).Get<std::string>();
      }
    }
    target.weight = weights.empty() ? 0.0 : weights[t];
    if (!std::isfinite(target.weight)) throw InputError(where_, fmt::format("mesh '{}' weights[{}]", mesh.name, t), "a finite number", fmt::format("{}", target.weight));
    std::size_t place = 0;
    while (place < targets_.size() && (targets_[place].name != target.name || targets_[place].weight != target.weight ||
                                       std::find(of_mesh_.begin(), of_mesh_.end(), place) != of_mesh_.end())) {
      ++place;
    }
    if (place == targets_.size()) {
      if (place == kMostTargets) throw InputError(where_, fmt::format("mesh '{}'", mesh.name), fmt::format("at most {} morph targets of different names in all meshes", kMostTargets), "more");
      targets_.push_back(std::move(target));
    }
    if (!targets_[place].joints) targets_[place].joints = stated_joints(mesh, t);
    of_mesh_.push_back(place);
  }
}

void MorphTargets::add_primitive(const tinygltf::Primitive& primitive, const std::string& field, std::size_t first, std::size_t vertices) {
  for (std::size_t t = 0; t < of_mesh_.size(); ++t) {
    const auto found = primitive.targets[t].find("POSITION");
    if (found == primitive.targets[t].end()) continue;
    const std::string name = fmt::format("{} target {} POSITION", field, t);
    const GltfAccessor displacements(model_, found->second, TINYGLTF_TYPE_VEC3, where_, name, vertices);
    if (displacements.count() != vertices) throw InputError(where_, name, fmt::format("{} displacements, as vertices", vertices), fmt::format("{}", displacements.count()));
    Target& target = targets_[of_mesh_[t]];
    target.displaces = true;
    // A sparse accessor states displacements of any number of vertices in a few bytes.
    displacements_ += first + vertices - std::min(first + vertices, target.offsets.size());
    if (displacements_ > kMostDisplacements) throw InputError(where_, name, fmt::format("at most {} displacements in all targets", kMostDisplacements), "more");
    target.offsets.resize(first + vertices, glm::vec3(0.0f));
    for (std::size_t i = 0; i < vertices; ++i) {
      const glm::dvec3 displacement(displacements.value(i, 0), displacements.value(i, 1), displacements.value(i, 2));
      const glm::vec3 offset(linear_ * displacement);
      if (!std::isfinite(offset.x) || !std::isfinite(offset.y) || !std::isfinite(offset.z)) {
        throw InputError(where_, fmt::format("{} vertex {}", name, i), "a finite displacement", "NaN or infinity");
      }
      target.offsets[first + i] = offset;
    }
  }
}

void MorphTargets::finish(BodyTemplate* body) {
  std::erase_if(targets_, [](const Target& target) { return !target.displaces; });
  ShapeSpace& shape = body->shape;
  if (const std::size_t most = std::max(most_, targets_.size()); most > kMaxShapes) {
    shape.ignored = fmt::format("{} morph targets, more than the {} that are taken for a shape: the body is the mesh without them", most, kMaxShapes);
    return;
  }
  if (targets_.empty()) return;
  shape.base_vertices = body->vertices;
  shape.base_joints = body->skeleton.rest_joints;
  std::vector<double> weights;
  for (Target& target : targets_) {
    target.offsets.resize(body->vertices.size(), glm::vec3(0.0f));
    shape.joint_offsets.push_back(target.joints ? std::move(*target.joints) : joint_offsets_from(*body, target.offsets));
    shape.names.push_back(std::move(target.name));
    shape.vertex_offsets.push_back(std::move(target.offsets));
    weights.push_back(target.weight);
  }
  shape.beta.assign(weights.size(), 0.0);
  set_shape(*body, weights);
}

}  // namespace arah
