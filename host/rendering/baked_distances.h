// The avatar's signed distance kept at the nodes of a grid, for one code: a narrow band around the surface in full resolution,
// coarser beyond. What a picture reads instead of the network (knob `distances`), and what the surface's mesh is made of.
#pragma once

#include <functional>

#include "host/avatar/avatar.h"
#include "host/capture/implicit_surface.h"
#include "host/rendering/field.h"
#include "kernels/tracing/interpolate_distances.h"

namespace arah {

class BakedDistances {
 public:
  // cell: metres between the nodes of the band. Larger where a large body would need more than 16 million of them.
  BakedDistances(Device& device, const Avatar& avatar, double cell);

  // Asks the network, as it is packed now, from coarse to fine: nodes four cells apart where the canonical template is within
  // 6 cm, then halves of the cells that may come near the surface (10 b, at most 1 cm). The rest is interpolated; beyond the coarse
  // nodes the template's own distance stands. `field`: any that has room for some thousand points. Submits.
  // `between`: called before each chunk of points; what it throws passes, and nothing is baked.
  void make_room_for_points(uint32_t at_a_time);  // by bake() itself otherwise
  void bake(Commands& commands, Field& field, const BufferSlice& frame, const std::function<void()>& between = {});

  // Distances in the cube's units, as the network gives them.
  DistanceNodes nodes() { return {grid_, distances_.slice()}; }
  const FieldSamples<float>& samples() const { return samples_; }  // the same, in metres
  uint64_t evaluated() const { return evaluated_; }         // points that the network was asked for
  uint64_t bytes() const { return distances_.bytes(); }

 private:
  void evaluate(Commands& commands, Field& field, const BufferSlice& frame, const std::vector<uint32_t>& nodes, const std::function<void()>& between);
  void interpolate_cell(const glm::ivec3& first, int edge);

  Device& device_;
  const Avatar& avatar_;
  ShellGrid grid_;
  std::vector<float> rough_;      // by coarse node: distance to the canonical template
  glm::ivec3 coarse_nodes_{0};
  FieldSamples<float> samples_;
  std::vector<uint8_t> known_;    // by node: the network's own answer
  uint64_t evaluated_ = 0;
  Buffer distances_, points_;
};

}  // namespace arah
