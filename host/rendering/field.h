// The avatar's field at canonical points: signed distance, feature and colour, forward and back. Distances alone come first,
// at all samples; the rest is computed where a sample is worth it (shading_queue.h).
#pragma once

#include <array>
#include <memory>
#include <optional>

#include "host/rendering/avatar_networks.h"
#include "kernels/linear/arithmetic.h"
#include "kernels/tracing/interpolate_distances.h"

namespace arah {

class Field {
 public:
  // What is evaluated beside distances, at how many points at a time.
  struct Shaded {
    uint32_t capacity = 0;
    bool gradient = false;  // wanted by record_forward
  };
  // capacity: points at a time whose distances are wanted. samples_per_ray: sample s belongs to ray s / samples_per_ray.
  // arithmetic: float32 with gradients.
  Field(Device& device, AvatarNetworks& networks, uint32_t capacity, uint32_t samples_per_ray, const Shaded& shaded, bool with_gradients, Arithmetic arithmetic = Arithmetic::float32);

  // Signed distances at the rows of canonical points, vec4 by row: channel 0 of the result, cube units; it stays until the
  // next call. sparse: only rows with w > 0 are evaluated, the others' distances mean nothing; submits, to know how many they
  // are. Worth it where a good part of the rows has no point.
  Matrix record_distances(Commands& commands, const BufferSlice& frame, const BufferSlice& canonical, uint32_t rows, bool sparse);
  // The same from a grid of distances in cube units (baked_distances.h).
  Matrix record_distances(Commands& commands, const BufferSlice& canonical, uint32_t rows, const DistanceNodes& baked);
  // The same for samples on a surface that lets nothing through: deep inside, whatever the network says.
  Matrix opaque_distances();
  // The result of the distances that do not come from all rows of the network, or from none; made at its first use.
  Matrix distances_by_row();
  uint32_t capacity() const { return distance_tape_->capacity(); }
  uint32_t shaded_capacity() const { return sdf_tape_->capacity(); }

  // Makes the room that sparse distances take; else their first call does.
  void make_room_for_gaps();
  // The same for rotated view directions of a colour that does not take the normal.
  void make_room_for_normals();

  struct Inputs {
    BufferSlice frame;      // FrameConstants
    BufferSlice canonical;  // vec4 by row
    BufferSlice rays;       // Ray by ray; read where the colour takes the view direction
    uint32_t rows = 0;
    BufferSlice transforms = {};  // three vec4 by row: blended transforms; read where takes_transforms() says so
    BufferSlice samples = {};     // uint32 by row: which sample it is, sample s being of ray s / samples_per_ray; empty: its number
    uint32_t sample_count = 0;    // with `samples`: how many samples there are
    std::optional<std::array<float, 9>> view_rotation = {};  // of the colour's view directions (AssembleInputsArgs)
  };
  // Whether the colour takes a direction that has to be turned between posed and canonical space.
  bool takes_transforms(bool view_rotated) const;
  // Fills sdf(), rgb(), and gradient() where wanted (always where the colour takes the normal). Throws
  // std::invalid_argument where takes_transforms() and there are none.
  void record_forward(Commands& commands, const Inputs& inputs, bool want_gradient = false);

  Matrix sdf() { return sdf_tape_->sdf(); }             // channel 0: f, cube units
  Matrix gradient() { return sdf_tape_->gradient(); }   // channels 0..2: ∂f/∂n, canonical
  Matrix rgb() { return color_tape_->output(); }        // channels 0..2
  Matrix d_sdf() { return sdf_tape_->sdf_cotangent(); }  // the caller writes dL/df and dL/drgb here …
  Matrix d_rgb() { return color_tape_->output_gradient(); }
  // Zeros in both from row `first` to the next multiple of 64 rows, all 64 for 0: the padding of a queue.
  void record_clear_cotangents(Commands& commands, uint32_t first);

  // … and gets effective weight gradients (=, or += with accumulate) of both networks, grid sums (+=), and where asked for
  // position_gradient().
  struct Backward {
    bool accumulate = false;
    bool position = false;
    float grid_scale = 0;     // of the fixed-point sums: FeatureGridBackwardArgs::scale
    BufferSlice grid_sums;    // int32 by feature; with a grid
    BufferSlice grid_clamped; // one uint32, +=
  };
  void record_backward(Commands& commands, const Inputs& inputs, const Backward& backward);
  // What the joint search's implicit gradient needs: gradient() where record_forward did not fill it, and the way back once
  // more, from another d_sdf() alone to effective weight gradients (+=) of the SDF.
  void record_gradient(Commands& commands, const Inputs& inputs);
  void record_backward_from_distances(Commands& commands, const Inputs& inputs);
  BufferSlice position_gradient() { return upstream_.slice(); }  // vec4 by row: dL/dx̂ per metre

  uint64_t scratch_floats() const { return scratch_.bytes() / 4; }
  BufferSlice scratch() { return scratch_.slice(); }

 private:
  Device& device_;
  AvatarNetworks& networks_;
  uint32_t samples_per_ray_;
  std::optional<SirenTape> distance_tape_, sdf_tape_;
  std::optional<DenseTape> color_tape_;
  Buffer with_point_, with_point_count_, compaction_;  // of sparse distances
  Buffer distances_, opaque_;                          // by row, not from the tape
  Buffer d_position_, upstream_, scratch_, normals_, d_normals_;  // the last two: of the colour's input
};

}  // namespace arah
