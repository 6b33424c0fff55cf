#include "host/body/shape_space.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "host/body/body_template.h"

namespace arah {

bool ShapeSpace::moves_joints() const {
  return std::any_of(joint_offsets.begin(), joint_offsets.end(), [](const std::vector<glm::dvec3>& offsets) {
    return std::any_of(offsets.begin(), offsets.end(), [](const glm::dvec3& offset) { return offset != glm::dvec3(0.0); });
  });
}

Skeleton skeleton_in_shape(const BodyTemplate& body, const std::vector<double>& beta) {
  const ShapeSpace& shape = body.shape;
  if (beta.size() != shape.size()) {
    throw std::invalid_argument(fmt::format("a shape of {} numbers for a body with {}", beta.size(), shape.size()));
  }
  Skeleton skeleton = body.skeleton;
  if (beta == shape.beta) return skeleton;
  skeleton.rest_joints = shape.base_joints;
  for (std::size_t b = 0; b < beta.size(); ++b) {
    if (beta[b] == 0.0) continue;  // adding 0 would turn −0 into 0
    for (std::size_t j = 0; j < skeleton.size(); ++j) skeleton.rest_joints[j] += beta[b] * shape.joint_offsets[b][j];
  }
  return skeleton;
}

void set_shape(BodyTemplate& body, const std::vector<double>& beta) {
  ShapeSpace& shape = body.shape;
  body.skeleton = skeleton_in_shape(body, beta);
  if (beta == shape.beta) return;
  shape.beta = beta;
  body.vertices = shape.base_vertices;
  std::vector<std::size_t> used;
  for (std::size_t b = 0; b < beta.size(); ++b) {
    if (beta[b] != 0.0) used.push_back(b);
  }
  if (used.empty()) return;
  for (std::size_t v = 0; v < body.vertices.size(); ++v) {
    glm::dvec3 vertex(body.vertices[v]);
    for (const std::size_t b : used) vertex += beta[b] * glm::dvec3(shape.vertex_offsets[b][v]);
    body.vertices[v] = glm::vec3(vertex);
  }
}

InShape::InShape(BodyTemplate& body, const std::vector<double>& beta) : body_(body), before_(body.shape.beta) {
  set_shape(body_, beta);
}

InShape::~InShape() { set_shape(body_, before_); }

std::vector<glm::dvec3> joint_offsets_from(const BodyTemplate& body, const std::vector<glm::vec3>& vertex_offsets) {
  const std::size_t joints = body.skeleton.size();
  std::vector<glm::dvec3> seam(joints, glm::dvec3(0.0)), bone = seam;
  std::vector<double> seam_weights(joints, 0.0), bone_weights = seam_weights;
  for (std::size_t v = 0; v < vertex_offsets.size(); ++v) {
    const glm::dvec3 offset(vertex_offsets[v]);
    for (int k = 0; k < 4; ++k) {
      const std::size_t joint = body.joints[v][k];
      const double weight = static_cast<double>(body.weights[v][k]);
      bone[joint] += weight * offset;
      bone_weights[joint] += weight;
      for (int other = 0; other < 4; ++other) {
        if (static_cast<int>(body.joints[v][other]) != body.skeleton.parents[joint]) continue;
        const double both = weight * static_cast<double>(body.weights[v][other]);
        seam[joint] += both * offset;
        seam_weights[joint] += both;
      }
    }
  }
  std::vector<glm::dvec3> offsets(joints, glm::dvec3(0.0));
  for (std::size_t j = 0; j < joints; ++j) {
    const int parent = body.skeleton.parents[j];
    if (seam_weights[j] > 0.0) {
      offsets[j] = seam[j] / seam_weights[j];
    } else if (bone_weights[j] > 0.0) {
      offsets[j] = bone[j] / bone_weights[j];
    } else if (parent >= 0) {
      offsets[j] = offsets[static_cast<std::size_t>(parent)];
    }
  }
  return offsets;
}

}  // namespace arah
