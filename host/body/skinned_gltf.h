// A skinned, coloured and animated mesh as a glTF 2.0 file that other programs open.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/gtc/type_precision.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <vector>

#include "host/body/pose.h"
#include "host/body/skeleton.h"

namespace arah {

// Metres, +Y up as glTF wants it. The mesh lies in its bind pose, which need not be the rest pose: the skin moves it by
// Σ w_b A_b V_b⁻¹ (canonical.h), exactly linear blend skinning from the bind pose, whatever that is. Joints' nodes stand as the
// skeleton rests, without rotations: a rotation of a node is the axis-angle of a Pose.
struct SkinnedModel {
  // Offsets of all vertices in the bind pose, added in proportion to a weight before the skin moves them.
  struct Corrective {
    std::string name;
    std::vector<glm::vec3> offsets;         // [V]
    std::vector<glm::vec3> normal_offsets;  // [V], or none
  };

  std::string name;
  Skeleton skeleton;
  std::vector<glm::dmat4> rest_to_bind;  // [J] V_b
  std::vector<glm::vec3> vertices;       // [V]
  std::vector<glm::vec3> normals;        // [V] unit length
  std::vector<glm::uvec3> triangles;     // counter-clockwise seen from outside
  std::vector<glm::u8vec4> joints;       // [V], or empty: the mesh does not move and there is neither skin nor skeleton
  std::vector<glm::vec4> weights;        // [V] ≥ 0; written so that their sum is 1 in float32

  // At most one of texture and colours, as shown (sRGB). The material is unlit (KHR_materials_unlit; elsewhere rough and not
  // metallic): light is in the colours already.
  std::vector<std::uint8_t> texture_png;
  std::vector<glm::vec2> uvs;     // [V] with a texture; v goes down
  std::vector<glm::vec3> colors;  // [V] 0..1

  std::vector<Corrective> correctives;

  // One animation of all joints, linear between key frames 1 / frames_per_second apart; none without poses.
  std::string motion;
  std::vector<Pose> poses;
  std::vector<std::vector<float>> corrective_weights;  // [poses][correctives]
  double frames_per_second = 25;
};

// The bytes of a GLB file. Throws std::invalid_argument where lists are not equally long or there is no triangle,
// std::runtime_error beyond glTF's 4 GiB.
std::vector<std::uint8_t> skinned_glb(const SkinnedModel& model);

// The four greatest of any number of influences, their sum 1 again.
struct FourInfluences {
  glm::u8vec4 joints{0};
  glm::vec4 weights{0.0f};  // descending
  double lost = 0;          // the sum of the others
};
FourInfluences greatest_four(std::vector<std::pair<std::uint32_t, float>> influences);

}  // namespace arah
