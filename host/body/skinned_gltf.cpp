#include "host/body/skinned_gltf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "host/body/gltf_append.h"

namespace arah {
namespace {

constexpr int float_components = TINYGLTF_COMPONENT_TYPE_FLOAT, vertex_data = TINYGLTF_TARGET_ARRAY_BUFFER;

void check(const SkinnedModel& model) {
  const auto same = [&](const char* what, std::size_t found, std::size_t expected) {
    if (found != expected) throw std::invalid_argument(fmt::format("a skinned model of {} vertices or joints with {} {}", expected, found, what));
  };
  const std::size_t count = model.vertices.size();
  if (count == 0 || model.triangles.empty()) throw std::invalid_argument("a skinned model without triangles");
  same("normals", model.normals.size(), count);
  same("texture coordinates", model.uvs.size(), model.texture_png.empty() ? 0 : count);
  if (!model.colors.empty()) same("colours", model.colors.size(), count);
  for (const auto& corrective : model.correctives) {
    same("offsets", corrective.offsets.size(), count);
    if (!corrective.normal_offsets.empty()) same("normals' offsets", corrective.normal_offsets.size(), count);
  }
  if (model.joints.empty()) {
    if (!model.weights.empty() || !model.poses.empty()) throw std::invalid_argument("a model that moves needs joints for its vertices");
    return;
  }
  same("joints of vertices", model.joints.size(), count);
  same("weights", model.weights.size(), count);
  same("bind transforms", model.rest_to_bind.size(), model.skeleton.size());
  if (!model.correctives.empty()) same("weights of correctives", model.corrective_weights.size(), model.poses.size());
  for (const Pose& pose : model.poses) same("rotations", pose.theta.size(), model.skeleton.size());
}

// Of sRGB: glTF's vertex colours are linear.
float linear(float value) { return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f); }

int append_material(tinygltf::Model& file, const SkinnedModel& model) {
  tinygltf::Material material;
  material.name = model.name;
  material.pbrMetallicRoughness.metallicFactor = 0;
  material.pbrMetallicRoughness.roughnessFactor = 1;
  material.extensions["KHR_materials_unlit"] = tinygltf::Value(tinygltf::Value::Object());
  file.extensionsUsed.push_back("KHR_materials_unlit");
  if (!model.texture_png.empty()) {
    tinygltf::Image image;
    image.name = model.name;
    image.bufferView = append_view(&file, model.texture_png, 0);
    image.mimeType = "image/png";
    file.images.push_back(image);
    tinygltf::Sampler sampler;
    sampler.magFilter = TINYGLTF_TEXTURE_FILTER_LINEAR;
    sampler.minFilter = TINYGLTF_TEXTURE_FILTER_LINEAR_MIPMAP_LINEAR;
    sampler.wrapS = sampler.wrapT = TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE;
    file.samplers.push_back(sampler);
    tinygltf::Texture texture;
    texture.source = 0;
    texture.sampler = 0;
    file.textures.push_back(texture);
    material.pbrMetallicRoughness.baseColorTexture.index = 0;
  }
  file.materials.push_back(material);
  return 0;
}

// Weights whose float32 sum is 1 to the last bit or two, 0 in slots without one, and joint 0 there.
void tidy(std::vector<glm::vec4>& weights, std::vector<glm::u8vec4>& joints) {
  for (std::size_t v = 0; v < weights.size(); ++v) {
    glm::vec4& w = weights[v];
    const float sum = w.x + w.y + w.z + w.w;
    if (!(sum > 0)) throw std::invalid_argument(fmt::format("vertex {} of a skinned model has no weight", v));
    int greatest = 0;
    for (int k = 0; k < 4; ++k) {
      w[k] /= sum;
      if (w[k] > w[greatest]) greatest = k;
      if (!(w[k] > 0)) w[k] = 0, joints[v][k] = 0;
    }
    float others = 0;
    for (int k = 0; k < 4; ++k) others += k == greatest ? 0 : w[k];
    w[greatest] = 1 - others;
  }
}

void append_skin(tinygltf::Model& file, const SkinnedModel& model) {
  const Skeleton& skeleton = model.skeleton;
  tinygltf::Skin skin;
  std::vector<glm::mat4> inverse_bind;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    tinygltf::Node node;
    node.name = skeleton.names[j];
    glm::dvec3 offset = skeleton.rest_joints[j];
    if (skeleton.parents[j] >= 0) {
      const auto parent = static_cast<std::size_t>(skeleton.parents[j]);
      offset -= skeleton.rest_joints[parent];
      file.nodes[parent].children.push_back(static_cast<int>(j));
    }
    node.translation = {offset.x, offset.y, offset.z};
    file.nodes.push_back(node);
    skin.joints.push_back(static_cast<int>(j));
    // (V T(J))⁻¹ = T(−J) V⁻¹: with the node at G this is A V⁻¹, for A = G T(−J).
    glm::dmat4 inverse = glm::inverse(model.rest_to_bind[j]);
    inverse[3] -= glm::dvec4(skeleton.rest_joints[j], 0.0);
    for (int c = 0; c < 4; ++c) inverse[c][3] = c == 3 ? 1.0 : 0.0;  // affine to the last bit, as validators ask
    inverse_bind.emplace_back(inverse);
  }
  skin.skeleton = 0;
  skin.inverseBindMatrices = append(&file, inverse_bind, 0, float_components, TINYGLTF_TYPE_MAT4, skeleton.size());
  file.skins.push_back(skin);
}

void append_animation(tinygltf::Model& file, const SkinnedModel& model, int mesh_node) {
  tinygltf::Animation animation;
  animation.name = model.motion;
  std::vector<float> times;
  for (std::size_t f = 0; f < model.poses.size(); ++f) times.push_back(static_cast<float>(double(f) / model.frames_per_second));
  const int input = append(&file, times, 0, float_components, TINYGLTF_TYPE_SCALAR, times.size());
  file.accessors[static_cast<std::size_t>(input)].minValues = {double{times.front()}};
  file.accessors[static_cast<std::size_t>(input)].maxValues = {double{times.back()}};
  const auto track = [&](int output, int node, const char* path) {
    tinygltf::AnimationSampler sampler;
    sampler.input = input;
    sampler.output = output;
    sampler.interpolation = "LINEAR";
    tinygltf::AnimationChannel channel;
    channel.sampler = static_cast<int>(animation.samplers.size());
    channel.target_node = node;
    channel.target_path = path;
    animation.samplers.push_back(sampler);
    animation.channels.push_back(channel);
  };
  for (std::size_t j = 0; j < model.skeleton.size(); ++j) {
    std::vector<glm::vec4> rotations;  // x y z w
    for (const Pose& pose : model.poses) {
      const glm::dquat q = glm::normalize(glm::quat_cast(rotation_from_axis_angle(pose.theta[j])));
      glm::vec4 rotation(q.x, q.y, q.z, q.w);
      if (!rotations.empty() && glm::dot(rotation, rotations.back()) < 0) rotation = -rotation;  // the shorter way, whoever interpolates
      rotations.push_back(rotation);
    }
    track(append(&file, rotations, 0, float_components, TINYGLTF_TYPE_VEC4, rotations.size()), static_cast<int>(j), "rotation");
  }
  std::vector<glm::vec3> roots;
  for (const Pose& pose : model.poses) roots.emplace_back(pose.root_position);
  track(append(&file, roots, 0, float_components, TINYGLTF_TYPE_VEC3, roots.size()), 0, "translation");
  if (!model.correctives.empty()) {
    std::vector<float> weights;
    for (const std::vector<float>& of_frame : model.corrective_weights) {
      if (of_frame.size() != model.correctives.size()) throw std::invalid_argument("a weight for each corrective and frame");
      weights.insert(weights.end(), of_frame.begin(), of_frame.end());
    }
    track(append(&file, weights, 0, float_components, TINYGLTF_TYPE_SCALAR, weights.size()), mesh_node, "weights");
  }
  file.animations.push_back(animation);
}

}  // namespace

std::vector<std::uint8_t> skinned_glb(const SkinnedModel& model) {
  check(model);
  tinygltf::Model file;
  file.asset.version = "2.0";
  file.asset.generator = "arah";
  file.buffers.emplace_back();
  const bool skinned = !model.joints.empty();

  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  primitive.attributes["POSITION"] = append_positions(&file, model.vertices);
  primitive.attributes["NORMAL"] = append_vectors(&file, model.normals);
  if (!model.uvs.empty()) primitive.attributes["TEXCOORD_0"] = append(&file, model.uvs, vertex_data, float_components, TINYGLTF_TYPE_VEC2, model.uvs.size());
  if (!model.colors.empty()) {
    std::vector<glm::vec3> colors;
    for (const glm::vec3& c : model.colors) colors.emplace_back(linear(std::clamp(c.x, 0.0f, 1.0f)), linear(std::clamp(c.y, 0.0f, 1.0f)), linear(std::clamp(c.z, 0.0f, 1.0f)));
    primitive.attributes["COLOR_0"] = append_vectors(&file, colors);
  }
  if (skinned) {
    std::vector<glm::u8vec4> joints = model.joints;
    std::vector<glm::vec4> weights = model.weights;
    tidy(weights, joints);
    primitive.attributes["JOINTS_0"] = append(&file, joints, vertex_data, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE, TINYGLTF_TYPE_VEC4, joints.size());
    primitive.attributes["WEIGHTS_0"] = append(&file, weights, vertex_data, float_components, TINYGLTF_TYPE_VEC4, weights.size());
  }
  primitive.indices = append(&file, model.triangles, TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR, 3 * model.triangles.size());
  tinygltf::Mesh mesh;
  mesh.name = model.name;
  tinygltf::Value::Array names;
  for (const SkinnedModel::Corrective& corrective : model.correctives) {
    primitive.targets.push_back({{"POSITION", append_positions(&file, corrective.offsets)}});
    if (!corrective.normal_offsets.empty()) primitive.targets.back()["NORMAL"] = append_vectors(&file, corrective.normal_offsets);
    mesh.weights.push_back(0);
    names.emplace_back(corrective.name);
  }
  if (!names.empty()) mesh.extras = tinygltf::Value(tinygltf::Value::Object{{"targetNames", tinygltf::Value(names)}});
  primitive.material = append_material(file, model);
  mesh.primitives.push_back(primitive);
  file.meshes.push_back(mesh);

  tinygltf::Scene scene;
  if (skinned) {
    append_skin(file, model);
    scene.nodes.push_back(0);
  }
  tinygltf::Node node;  // at the scene's root: a skinned mesh's own place means nothing
  node.name = model.name;
  node.mesh = 0;
  if (skinned) node.skin = 0;
  const int mesh_node = static_cast<int>(file.nodes.size());
  file.nodes.push_back(node);
  scene.nodes.push_back(mesh_node);
  file.scenes.push_back(scene);
  file.defaultScene = 0;
  if (!model.poses.empty()) append_animation(file, model, mesh_node);
  if (file.buffers[0].data.size() > std::numeric_limits<std::uint32_t>::max() - (1u << 20)) throw std::runtime_error("more than glTF's 4 GiB: take fewer frames or a larger cell");

  std::ostringstream stream(std::ios::binary);
  if (!tinygltf::TinyGLTF().WriteGltfSceneToStream(&file, stream, /*prettyPrint=*/false, /*writeBinary=*/true)) throw std::runtime_error("the mesh could not be written as glTF");
  const std::string text = stream.str();
  return {text.begin(), text.end()};
}

FourInfluences greatest_four(std::vector<std::pair<std::uint32_t, float>> influences) {
  std::stable_sort(influences.begin(), influences.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  FourInfluences four;
  double sum = 0, kept = 0;
  for (std::size_t i = 0; i < influences.size(); ++i) {
    sum += double{influences[i].second};
    if (i < 4) kept += double{influences[i].second};
  }
  if (!(kept > 0)) throw std::invalid_argument("influences without weight");
  for (std::size_t i = 0; i < std::min<std::size_t>(4, influences.size()); ++i) {
    four.joints[static_cast<int>(i)] = static_cast<glm::u8>(influences[i].first);
    four.weights[static_cast<int>(i)] = static_cast<float>(double{influences[i].second} / kept);
  }
  four.lost = (sum - kept) / sum;
  return four;
}

}  // namespace arah
