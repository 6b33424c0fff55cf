// The colour field on the surface, without a camera: what textures and vertices of exported meshes show.
#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/rendering/field.h"

namespace arah {

class SurfaceColors {
 public:
  SurfaceColors(Device& device, AvatarNetworks& networks);

  // Colours 0..1 as in the photographs (sRGB, not linearised) at canonical points with their unit normals. A colour that follows
  // the view sees each point from straight ahead: along its posed normal. transforms: canonical → world, of the frame's pose; the
  // networks as they are packed now, code and all. Submits.
  std::vector<glm::vec3> at(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points, std::span<const glm::vec3> normals, std::span<const glm::mat4> transforms);

 private:
  Device& device_;
  AvatarNetworks& networks_;
  Field field_;
  Buffer points_, rays_, transforms_;
};

}  // namespace arah
