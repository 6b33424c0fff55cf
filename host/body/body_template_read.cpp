#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>
#include <glm/matrix.hpp>

#include "host/body/body_template.h"
#include "host/body/gltf_accessor.h"
#include "host/body/gltf_file.h"
#include "host/body/morph_targets.h"
#include "host/input_error.h"

namespace arah {
namespace {

// Primitives may share one accessor, so that a small file can state any number of vertices.
constexpr std::size_t kMostGltfVertices = 1'000'000, kMostGltfTriangles = 2'000'000;

bool finite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

// The largest absolute difference of two matrices.
double difference(const glm::dmat4& a, const glm::dmat4& b) {
  double largest = 0.0;
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 4; ++r) largest = std::max(largest, std::abs(a[c][r] - b[c][r]));
  }
  return largest;
}

// A skeleton and how the file's skin maps to it.
struct Rig {
  Skeleton skeleton;
  std::vector<int> joint_of_slot;  // the skin's joint → ours
  glm::dmat4 mesh_to_world{1.0};
};

std::vector<glm::dmat4> inverse_bind_matrices(const tinygltf::Model& model, const tinygltf::Skin& skin,
                                              const std::string& where) {
  std::vector<glm::dmat4> result(skin.joints.size(), glm::dmat4(1.0));  // identity where absent, as glTF says
  if (skin.inverseBindMatrices < 0) return result;
  const GltfAccessor matrices(model, skin.inverseBindMatrices, TINYGLTF_TYPE_MAT4, where, "inverseBindMatrices");
  if (matrices.count() < result.size()) {
    throw InputError(where, "inverseBindMatrices", fmt::format("{} matrices", result.size()),
                     fmt::format("{}", matrices.count()));
  }
  for (std::size_t j = 0; j < result.size(); ++j) {
    for (std::size_t i = 0; i < 16; ++i) {
      result[j][static_cast<int>(i / 4)][static_cast<int>(i % 4)] = matrices.value(j, i);
    }
    const double determinant = glm::determinant(result[j]);
    if (!std::isfinite(determinant) || determinant == 0.0) {
      throw InputError(where, fmt::format("inverse bind matrix {}", j), "an invertible matrix",
                       fmt::format("determinant {}", determinant));
    }
  }
  return result;
}

// The transform from the mesh's space to the world at rest. Where the scene's nodes stand in the bind pose it is
// node · inverse bind matrix, one matrix for all joints; otherwise the root joint's parent, the armature, places the
// body.
glm::dmat4 mesh_to_world(const GltfNodeTree& tree, const std::vector<std::size_t>& joint_nodes,
                         const std::vector<glm::dmat4>& inverse_bind, std::size_t root, const std::string& where) {
  glm::dmat4 result = tree.world(joint_nodes[root]) * inverse_bind[root];
  const double scale = std::max(1.0, glm::length(glm::dvec3(result[3])));
  for (std::size_t j = 0; j < joint_nodes.size(); ++j) {
    if (difference(tree.world(joint_nodes[j]) * inverse_bind[j], result) > 1e-4 * scale) {
      const std::size_t armature = tree.parent(joint_nodes[root]);
      result = armature == kNoGltfNode ? glm::dmat4(1.0) : tree.world(armature);
      break;
    }
  }
  // Rounding of a file whose mesh is in world space already must not move its vertices.
  if (difference(result, glm::dmat4(1.0)) < 1e-5) return glm::dmat4(1.0);
  const glm::dmat3 linear(result);
  const double squared = glm::dot(linear[0], linear[0]);
  const glm::dmat4 gram(glm::transpose(linear) * linear / squared);
  if (!(squared > 0.0) || !(difference(gram, glm::dmat4(1.0)) < 1e-3) || glm::determinant(linear) <= 0.0) {
    throw InputError(where, "armature", "turned, moved and evenly scaled",
                     "a transform that shears, mirrors or scales unevenly",
                     "Apply the armature's scale before export.");
  }
  return result;
}

Rig read_rig(const tinygltf::Model& model, const GltfNodeTree& tree, const std::string& where) {
  if (model.skins.empty()) {
    throw InputError(where, "skins", "a skinned mesh", "no skin", "Export the mesh together with its armature.");
  }
  const tinygltf::Skin& skin = model.skins[0];
  const std::size_t count = skin.joints.size();
  if (count < 1 || count > kMaxJoints) {
    throw InputError(where, "skin", fmt::format("1 to {} joints", kMaxJoints), fmt::format("{}", count),
                     count > kMaxJoints ? "Merge the finest joints (fingers, face) into their parents." : "");
  }
  std::vector<std::size_t> nodes(count);
  std::vector<std::size_t> slot_of_node(model.nodes.size(), kNoGltfNode);
  for (std::size_t j = 0; j < count; ++j) {
    const int node = skin.joints[j];
    if (node < 0 || static_cast<std::size_t>(node) >= model.nodes.size() ||
        slot_of_node[static_cast<std::size_t>(node)] != kNoGltfNode) {
      throw InputError(where, fmt::format("skin joint {}", j), "a node, each once", fmt::format("node {}", node));
    }
    nodes[j] = static_cast<std::size_t>(node);
    slot_of_node[nodes[j]] = j;
  }

  // A joint's parent is its nearest ancestor that is a joint too.
  std::vector<std::size_t> parent_slot(count, kNoGltfNode);
  std::size_t root = kNoGltfNode;
  for (std::size_t j = 0; j < count; ++j) {
    std::size_t at = tree.parent(nodes[j]);
    while (at != kNoGltfNode && slot_of_node[at] == kNoGltfNode) at = tree.parent(at);
    if (at != kNoGltfNode) {
      parent_slot[j] = slot_of_node[at];
    } else if (root == kNoGltfNode) {
      root = j;
    } else {
      throw InputError(where, "skin", "one root joint",
                       fmt::format("two: '{}' and '{}'", model.nodes[nodes[root]].name, model.nodes[nodes[j]].name));
    }
  }

  const std::vector<glm::dmat4> inverse_bind = inverse_bind_matrices(model, skin, where);
  Rig rig;
  rig.mesh_to_world = mesh_to_world(tree, nodes, inverse_bind, root, where);
  // Take the first joint whose parent is placed, over and over: the skin's own order where that is sound.
  rig.joint_of_slot.assign(count, -1);
  for (std::size_t placed = 0; placed < count; ++placed) {
    std::size_t next = 0;
    while (rig.joint_of_slot[next] >= 0 || (next != root && rig.joint_of_slot[parent_slot[next]] < 0)) ++next;
    rig.joint_of_slot[next] = static_cast<int>(placed);
    const std::string& name = model.nodes[nodes[next]].name;
    rig.skeleton.names.push_back(name.empty() ? fmt::format("joint_{}", next) : name);
    rig.skeleton.parents.push_back(next == root ? -1 : rig.joint_of_slot[parent_slot[next]]);
    rig.skeleton.rest_joints.push_back(glm::dvec3(rig.mesh_to_world * glm::inverse(inverse_bind[next])[3]));
  }
  validate_skeleton(rig.skeleton, where);
  return rig;
}

// Appends one primitive's triangles to the template.
void read_primitive(const tinygltf::Model& model, const tinygltf::Primitive& primitive, const Rig& rig,
                    const std::string& where, const std::string& field, BodyTemplate* body) {
  auto attribute = [&](const char* name, int type) {
    const auto found = primitive.attributes.find(name);
    if (found == primitive.attributes.end()) throw InputError(where, field, name, "a primitive without it");
    return GltfAccessor(model, found->second, type, where, field + " " + name);
  };
  if (primitive.mode != -1 && primitive.mode != TINYGLTF_MODE_TRIANGLES) {
    throw InputError(where, field, "triangles", fmt::format("primitive mode {}", primitive.mode));
  }
  if (primitive.attributes.contains("JOINTS_1")) {
    throw InputError(where, field, "at most four joints a vertex", "a second set (JOINTS_1)",
                     "Limit the weights to four influences before export.");
  }
  const GltfAccessor positions = attribute("POSITION", TINYGLTF_TYPE_VEC3);
  const GltfAccessor joints = attribute("JOINTS_0", TINYGLTF_TYPE_VEC4);
  const GltfAccessor weights = attribute("WEIGHTS_0", TINYGLTF_TYPE_VEC4);
  if (joints.count() != positions.count() || weights.count() != positions.count()) {
    throw InputError(where, field, fmt::format("{} joints and weights, as positions", positions.count()),
                     fmt::format("{} and {}", joints.count(), weights.count()));
  }
  const std::size_t first = body->vertices.size();
  if (positions.count() > kMostGltfVertices - first) throw InputError(where, field, fmt::format("at most {} vertices", kMostGltfVertices), fmt::format("{}", first + positions.count()));
  for (std::size_t i = 0; i < positions.count(); ++i) {
    const std::string vertex = fmt::format("{} vertex {}", field, i);
    const glm::dvec4 position(positions.value(i, 0), positions.value(i, 1), positions.value(i, 2), 1.0);
    if (!finite(glm::dvec3(position))) throw InputError(where, vertex, "a finite position", "NaN or infinity");
    body->vertices.push_back(glm::vec3(glm::dvec3(rig.mesh_to_world * position)));
    glm::u8vec4 own_joints(0);
    glm::dvec4 own_weights(0.0);
    for (int k = 0; k < 4; ++k) {
      const double weight = weights.value(i, static_cast<std::size_t>(k));
      if (!std::isfinite(weight) || weight < 0.0) {
        throw InputError(where, vertex, "weights of 0 and more", fmt::format("{}", weight));
      }
      if (weight == 0.0) continue;  // exporters leave any index in an unused slot
      const double slot = joints.value(i, static_cast<std::size_t>(k));
      if (!(slot >= 0.0 && slot < static_cast<double>(rig.joint_of_slot.size()))) {
        throw InputError(where, vertex, fmt::format("one of {} joints", rig.joint_of_slot.size()),
                         fmt::format("joint {}", slot));
      }
      own_joints[k] = static_cast<glm::u8>(rig.joint_of_slot[static_cast<std::size_t>(slot)]);
      own_weights[k] = weight;
    }
    const double sum = own_weights.x + own_weights.y + own_weights.z + own_weights.w;
    if (!(sum > 0.0)) {
      throw InputError(where, vertex, "a joint that moves it", "no weight", "Assign every vertex to a joint.");
    }
    body->joints.push_back(own_joints);
    body->weights.push_back(glm::vec4(own_weights / sum));
  }

  if (primitive.attributes.contains("NORMAL")) {
    const GltfAccessor normals = attribute("NORMAL", TINYGLTF_TYPE_VEC3);
    if (normals.count() != positions.count()) {
      throw InputError(where, field, fmt::format("{} normals", positions.count()), fmt::format("{}", normals.count()));
    }
    for (std::size_t i = 0; i < normals.count(); ++i) {
      const glm::dvec3 normal(normals.value(i, 0), normals.value(i, 1), normals.value(i, 2));
      if (!finite(normal)) {
        throw InputError(where, fmt::format("{} normal {}", field, i), "a finite vector", "NaN or infinity");
      }
      body->normals.push_back(glm::vec3(glm::dmat3(rig.mesh_to_world) * normal));
    }
  } else {
    body->normals.resize(body->vertices.size(), glm::vec3(0.0f));  // computed once all triangles are known
  }

  std::vector<std::size_t> indices;
  const auto require_few = [&](std::size_t count) {
    const std::size_t triangles = body->triangles.size() + count / 3;
    if (triangles > kMostGltfTriangles) throw InputError(where, field, fmt::format("at most {} triangles", kMostGltfTriangles), fmt::format("{}", triangles));
  };
  if (primitive.indices >= 0) {
    const GltfAccessor stored(model, primitive.indices, TINYGLTF_TYPE_SCALAR, where, field + " indices");
    require_few(stored.count());
    for (std::size_t i = 0; i < stored.count(); ++i) {
      const double index = stored.value(i, 0);
      if (!(index >= 0.0 && index < static_cast<double>(positions.count()))) {
        throw InputError(where, fmt::format("{} index {}", field, i),
                         fmt::format("a vertex below {}", positions.count()), fmt::format("{}", index));
      }
      indices.push_back(static_cast<std::size_t>(index));
    }
  } else {
    require_few(positions.count());
    for (std::size_t i = 0; i < positions.count(); ++i) indices.push_back(i);
  }
  if (indices.size() % 3 != 0) {
    throw InputError(where, field, "three indices a triangle", fmt::format("{} indices", indices.size()));
  }
  for (std::size_t i = 0; i < indices.size(); i += 3) {
    body->triangles.emplace_back(first + indices[i], first + indices[i + 1], first + indices[i + 2]);
  }
}

// Makes normals unit length; where there is none, the sum over the vertex's triangles of area times normal.
void complete_normals(BodyTemplate* body) {
  std::vector<glm::dvec3> sums(body->vertices.size(), glm::dvec3(0.0));
  for (const glm::uvec3& triangle : body->triangles) {
    const glm::dvec3 a(body->vertices[triangle.x]), b(body->vertices[triangle.y]), c(body->vertices[triangle.z]);
    const glm::dvec3 twice_area = glm::cross(b - a, c - a);
    for (int k = 0; k < 3; ++k) sums[triangle[k]] += twice_area;
  }
  for (std::size_t i = 0; i < sums.size(); ++i) {
    glm::dvec3 normal(body->normals[i]);
    if (glm::length(normal) < 1e-12) normal = sums[i];
    const double length = glm::length(normal);
    // A vertex of no triangle, or of flat ones only, has no normal; any unit vector serves.
    body->normals[i] = length > 0.0 ? glm::vec3(normal / length) : glm::vec3(0.0f, 1.0f, 0.0f);
  }
}

BodyTemplate template_from_model(const tinygltf::Model& model, const std::string& where) {
  for (const std::string& extension : model.extensionsRequired) {
    if (extension.find("compression") != std::string::npos || extension.find("quantization") != std::string::npos) {
      throw InputError(where, "extensionsRequired", "plain data", extension, "Export without compression.");
    }
  }
  const GltfNodeTree tree(model, where);
  const Rig rig = read_rig(model, tree, where);
  BodyTemplate body;
  body.skeleton = rig.skeleton;
  MorphTargets targets(model, glm::dmat3(rig.mesh_to_world), rig.joint_of_slot, where);
  for (std::size_t n = 0; n < model.nodes.size(); ++n) {
    const tinygltf::Node& node = model.nodes[n];
    if (node.skin < 0 || node.mesh < 0) continue;
    if (static_cast<std::size_t>(node.skin) >= model.skins.size() ||
        static_cast<std::size_t>(node.mesh) >= model.meshes.size()) {
      throw InputError(where, fmt::format("node {}", n), "a skin and a mesh of the file",
                       fmt::format("skin {}, mesh {}", node.skin, node.mesh));
    }
    // Exporters write one skin a mesh; the same joints in the same order are the same skin.
    if (model.skins[static_cast<std::size_t>(node.skin)].joints != model.skins[0].joints) {
      throw InputError(where, fmt::format("node {}", n), "one armature for all meshes", "a skin with other joints");
    }
    const tinygltf::Mesh& mesh = model.meshes[static_cast<std::size_t>(node.mesh)];
    targets.begin_mesh(node, mesh);
    for (std::size_t p = 0; p < mesh.primitives.size(); ++p) {
      const std::string field = fmt::format("mesh '{}' primitive {}", mesh.name, p);
      const std::size_t first = body.vertices.size();
      read_primitive(model, mesh.primitives[p], rig, where, field, &body);
      targets.add_primitive(mesh.primitives[p], field, first, body.vertices.size() - first);
    }
  }
  if (body.triangles.empty()) throw InputError(where, "meshes", "triangles that the skin moves", "none");
  complete_normals(&body);
  targets.finish(&body);
  return body;
}

}  // namespace

BodyTemplate read_body_template_bytes(std::span<const std::byte> bytes, const std::string& where) {
  BodyTemplate body = template_from_model(parse_gltf(bytes, where, {}), where);
  body.glb.assign(bytes.begin(), bytes.end());
  return body;
}

BodyTemplate read_body_template(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = gltf_bytes(path);
  if (is_binary_gltf(bytes)) return read_body_template_bytes(bytes, path.string());
  // A text file's buffers may lie beside it; what an avatar carries along must be one piece.
  BodyTemplate body = template_from_model(parse_gltf(bytes, path.string(), std::filesystem::absolute(path).parent_path()), path.string());
  body.glb = body_template_glb(body);
  return body;
}

}  // namespace arah
