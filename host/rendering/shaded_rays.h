// Rays with their samples placed → colours, depths and, where wanted, normals: distances at all samples, the weights that
// follow from them, the rest of the field at the samples that are worth it, compositing. What rendering and training share.
#pragma once

#include <optional>

#include "host/rendering/field.h"
#include "host/rendering/ray_samples.h"
#include "host/rendering/shading_queue.h"
#include "kernels/compositing/samples.h"

namespace arah {

class ShadedRays {
 public:
  // rays: at a time, `samples` of each. For training: with a way back for so many shaded samples.
  ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, uint32_t shaded);
  // For pictures: samples are shaded so many at a time, a multiple of 64, one batch after the other. normals: room for them.
  // arithmetic: of the field.
  ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, uint32_t shaded_at_a_time, bool normals, Arithmetic arithmetic);

  struct Options {
    double least_weight = 0;
    bool normals = false;
    std::optional<DistanceNodes> baked = {};  // distances come from this grid instead of the network; without a way back
    uint32_t groups = 0;                      // 0: a colour for each sample; else see below, without a way back
    std::optional<std::array<float, 9>> view_rotation = {};  // of the colour's view directions; in training
  };
  // Shades the samples of `placed`, those whose compositing weight exceeds least_weight; the others are black but absorb. 0
  // leaves out nothing but weights that are 0 in float32: then no colour changes.
  // groups: of each ray, one place for every so-manieth part of its Σ w gives its colour to the samples there
  // (kernels/compositing/group_samples.h). Moves the canonical points of those that begin a group.
  // Records and submits: on return all but the last launches are done, and these are recorded.
  // Returns false, with nothing shaded, where more samples are to be shaded than there is a way back for.
  bool record_forward(Commands& commands, FrameOnDevice& frame, RaySamples& placed, uint32_t rays, const Options& options);

  BufferSlice colors() { return colors_.slice(); }          // vec4 by ray: rgb on black, Σ w
  BufferSlice ray_depths() { return ray_depths_.slice(); }  // float by ray: Σ w z, metres
  BufferSlice normals() { return composited_normals_.slice(); }  // vec4 by ray: Σ w n, world axes; after a call with normals

  // What the way back reads, in training: the composited samples, and the field with the rows that it was evaluated at.
  const CompositeSamples& composited() const { return composited_; }
  BufferSlice weights() { return weights_.slice(); }                // float by sample: of compositing
  BufferSlice transmittances() { return transmittances_.slice(); }  // float by sample
  Field& field() { return field_; }
  const Field::Inputs& inputs() const { return inputs_; }
  const ShadingQueue& queue() const { return queue_; }
  ShadingQueue& queue() { return queue_; }

 private:
  ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, const Field::Shaded& shaded, bool with_gradients, Arithmetic arithmetic);
  void shade(Commands& commands, FrameOnDevice& frame, RaySamples& placed, uint32_t rows, const Options& options);
  // Of all slots of the queue.
  Matrix rgb() { return rgb_.bytes() ? Matrix{rgb_.slice(), channel_padding, 0} : field_.rgb(); }

  AvatarNetworks& networks_;
  Field field_;
  ShadingQueue queue_;
  CompositeSamples composited_;
  Field::Inputs inputs_;
  Buffer colors_, ray_depths_, weights_, transmittances_, normals_, composited_normals_, unused_depths_;
  Buffer rgb_;  // where the queue's samples do not go into the field together
};

}  // namespace arah
