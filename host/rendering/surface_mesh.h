// The avatar's surface as a mesh: triangles of its zero set in canonical space, with the skinning weights of their vertices. It
// can be posed and drawn for a fraction of what a search along every ray costs (knob `surface`).
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/rendering/avatar_networks.h"
#include "host/rendering/baked_distances.h"
#include "host/rendering/surface_finder.h"

namespace arah {

// Of the largest connected part's vertices: smaller parts float about and hardly show in volume rendering.
inline constexpr double least_part = 0.01;

// The zero set of baked distances by surface nets, a little smoothed, without its small loose parts: what pictures are drawn of.
TriangleMesh smooth_net(const FieldSamples<float>& distances);

class SurfaceMesh {
 public:
  // A mesh in canonical space with the weights of the skinning network as it is packed now (or those of the template's
  // nearest vertices, where the avatar follows these). frame: any pose's constants. Submits.
  SurfaceMesh(Device& device, Commands& commands, AvatarNetworks& networks, const Avatar& avatar, TriangleMesh mesh, const BufferSlice& frame);

  // What the centre of each pixel sees of it, row-major, top left first.
  // outline: metres that the mesh is drawn farther out than the surface that its places belong to, because volume rendering
  // with a density that fades over b shows a body that much wider where it is seen from the side.
  SurfaceHits seen(const Pose& pose, const Camera& camera, double outline) const;

  const TriangleMesh& canonical() const { return mesh_; }  // metres
  const std::vector<glm::dvec3>& normals() const { return normals_; }  // of its vertices, canonical, unit length
  std::vector<glm::vec3> posed(const Pose& pose) const;    // its vertices in the world
  std::vector<glm::mat4> vertex_transforms(const Pose& pose) const;  // canonical → world, by vertex
  // Joints that move a vertex with their weights, sum 1; none where no bone moves.
  std::vector<std::pair<uint32_t, float>> influences(size_t vertex) const;

 private:
  struct Influence {
    uint32_t joint = 0;
    float weight = 0;
  };
  void take_network_weights(Device& device, Commands& commands, AvatarNetworks& networks, const BufferSlice& frame);
  void take_template_weights();

  const Avatar& avatar_;
  TriangleMesh mesh_;
  std::vector<glm::dvec3> normals_;    // of its vertices
  std::vector<Influence> influences_;  // of vertex v: first_[v] to first_[v + 1]; none where no bone moves
  std::vector<uint32_t> first_;
};

}  // namespace arah
