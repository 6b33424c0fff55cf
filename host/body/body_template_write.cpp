#include <algorithm>
#include <sstream>
#include <stdexcept>

#include "host/body/body_template.h"
#include "host/body/gltf_append.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {
namespace {

// targetNames, as viewers show them, and joint_shapedirs (morph_targets.h).
tinygltf::Value shape_extras(const ShapeSpace& shape) {
  using tinygltf::Value;
  Value::Array names, joints;
  for (const std::string& name : shape.names) names.emplace_back(name);
  for (const std::vector<glm::dvec3>& offsets : shape.joint_offsets) {
    Value::Array of_target;
    for (const glm::dvec3& offset : offsets) of_target.emplace_back(Value::Array{Value(offset.x), Value(offset.y), Value(offset.z)});
    joints.emplace_back(std::move(of_target));
  }
  return Value(Value::Object{{"targetNames", Value(std::move(names))}, {"joint_shapedirs", Value(std::move(joints))}});
}

}  // namespace

std::vector<std::byte> body_template_glb(const BodyTemplate& body) {
  const std::size_t count = body.vertices.size();
  const ShapeSpace& shape = body.shape;
  if (body.normals.size() != count || body.joints.size() != count || body.weights.size() != count || count == 0) {
    throw std::invalid_argument("a template needs vertices, and a normal, joints and weights for each");
  }
  validate_skeleton(body.skeleton, "template");
  const auto displaces_all = [&](const std::vector<glm::vec3>& offsets) { return offsets.size() == count; };
  if (shape.size() > 0 && (shape.base_vertices.size() != count || shape.base_joints.size() != body.skeleton.size() ||
                           !std::all_of(shape.vertex_offsets.begin(), shape.vertex_offsets.end(), displaces_all))) {
    throw std::invalid_argument("a shape needs the base's vertices and joints, and an offset for each vertex");
  }
  tinygltf::Model model;
  model.asset.version = "2.0";
  model.asset.generator = "arah";
  model.buffers.emplace_back();

  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  const int vertex_data = TINYGLTF_TARGET_ARRAY_BUFFER;
  primitive.attributes["POSITION"] = append_positions(&model, shape.size() > 0 ? shape.base_vertices : body.vertices);
  primitive.attributes["NORMAL"] =
      append(&model, body.normals, vertex_data, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3, count);
  primitive.attributes["JOINTS_0"] =
      append(&model, body.joints, vertex_data, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE, TINYGLTF_TYPE_VEC4, count);
  primitive.attributes["WEIGHTS_0"] =
      append(&model, body.weights, vertex_data, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC4, count);
  primitive.indices = append(&model, body.triangles, TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER,
                             TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR, 3 * body.triangles.size());
  for (const std::vector<glm::vec3>& offsets : shape.vertex_offsets) primitive.targets.push_back({{"POSITION", append_positions(&model, offsets)}});
  tinygltf::Mesh mesh;
  mesh.name = "template";
  mesh.primitives.push_back(primitive);
  if (shape.size() > 0) {
    mesh.weights = shape.beta;
    mesh.extras = shape_extras(shape);
  }
  model.meshes.push_back(mesh);

  // Nodes stand where the inverse bind matrices say: of the base, from which the targets move the vertices.
  Skeleton skeleton = body.skeleton;
  if (shape.size() > 0) skeleton.rest_joints = shape.base_joints;
  tinygltf::Skin skin;
  std::vector<glm::mat4> inverse_bind(skeleton.size(), glm::mat4(1.0f));
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    tinygltf::Node node;
    node.name = skeleton.names[j];
    glm::dvec3 offset = skeleton.rest_joints[j];
    if (skeleton.parents[j] >= 0) {
      const std::size_t parent = static_cast<std::size_t>(skeleton.parents[j]);
      offset -= skeleton.rest_joints[parent];
      model.nodes[parent].children.push_back(static_cast<int>(j));
    }
    node.translation = {offset.x, offset.y, offset.z};
    model.nodes.push_back(node);
    skin.joints.push_back(static_cast<int>(j));
    inverse_bind[j][3] = glm::vec4(glm::vec3(-skeleton.rest_joints[j]), 1.0f);
  }
  skin.skeleton = 0;
  skin.inverseBindMatrices =
      append(&model, inverse_bind, 0, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_MAT4, skeleton.size());
  model.skins.push_back(skin);

  tinygltf::Node node;
  node.name = "template";
  node.mesh = 0;
  node.skin = 0;
  model.nodes.push_back(node);
  tinygltf::Scene scene;
  scene.nodes = {0, static_cast<int>(skeleton.size())};
  model.scenes.push_back(scene);
  model.defaultScene = 0;

  std::ostringstream stream(std::ios::binary);
  if (!tinygltf::TinyGLTF().WriteGltfSceneToStream(&model, stream, /*prettyPrint=*/false, /*writeBinary=*/true)) {
    throw std::runtime_error("the template could not be written as glTF");
  }
  const std::string text = stream.str();
  const std::span<const std::byte> bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

void write_body_template(const std::filesystem::path& path, const BodyTemplate& body_template) {
  const std::vector<std::byte> bytes = body_template_glb(body_template);
  write_file_safely(path, std::span(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()));
}

}  // namespace arah
