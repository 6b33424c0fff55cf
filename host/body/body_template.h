// The skinned body that an avatar starts from: a triangle mesh in its rest pose, a skeleton, and the weights between
// them.
#pragma once

#include <cstddef>
#include <filesystem>
#include <glm/gtc/type_precision.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/body/shape_space.h"
#include "host/body/skeleton.h"

namespace arah {

struct BodyTemplate {
  Skeleton skeleton;
  std::vector<glm::vec3> vertices;    // [V] rest pose, metres, +Y up, +Z forward
  std::vector<glm::vec3> normals;     // [V] unit length, outward
  std::vector<glm::uvec3> triangles;  // [T] vertex indices, counter-clockwise seen from outside
  std::vector<glm::u8vec4> joints;    // [V] up to four joints of a vertex
  std::vector<glm::vec4> weights;     // [V] their weights: >= 0, sum 1; 0 where a slot is unused
  ShapeSpace shape;                   // of the file's morph targets; `vertices` and the skeleton are of shape.beta
  std::vector<std::byte> glb;         // the GLB file that this was read from, so that an avatar can carry it along
};

// Reads a skinned glTF 2.0 file, binary (.glb) or text (.gltf with its buffers). All triangle primitives that the first
// skin moves are merged. The rest pose is the bind pose: joint positions are those of the inverse bind matrices'
// inverses, whatever their rotation (the mesh's skinning needs positions only, because rest frames are world-aligned
// here). A common transform between mesh and world (an armature's turn or scale) is applied to vertices and joints.
// Joints keep the skin's order where parents already come before children. Normals that the file lacks are computed.
// Morph targets are the body's shape (morph_targets.h); the body has the shape that the mesh's weights state, as viewers
// show it, while inverse bind matrices state the joints of the base. More than kMaxShapes targets are left out.
// Buffers of a text file lie in its folder or below; a binary file is one piece. Nothing else is opened.
// Throws InputError: not a glTF file, truncated, of more than 128 MB, a million vertices or two million triangles, no skin, more than 64 joints, more than four influences, several
// roots, indices out of range, numbers that are not finite, vertices without weight, compressed data, sparse data other
// than morph targets', targets that do not fit the vertices.
BodyTemplate read_body_template(const std::filesystem::path& path);

// The same from the bytes of a GLB file; `where` names them in errors.
BodyTemplate read_body_template_bytes(std::span<const std::byte> bytes, const std::string& where);

// The bytes of a GLB file with POSITION, NORMAL, JOINTS_0, WEIGHTS_0, indices and inverse bind matrices (float32), and
// with a shape: its base, morph targets, β as their weights, extras.targetNames and extras.joint_shapedirs.
// The result depends on the mesh, the skeleton and the shape only, not on body_template.glb.
std::vector<std::byte> body_template_glb(const BodyTemplate& body_template);

// Writes body_template_glb() to `path`. Throws std::runtime_error when the disk refuses.
void write_body_template(const std::filesystem::path& path, const BodyTemplate& body_template);

}  // namespace arah
