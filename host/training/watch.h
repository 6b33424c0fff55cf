// The watch over what a step computes: each tensor that one stage hands to the next is looked through on the device while it is
// there (kernels/watch/scan.h), and one small download tells what was bad.
#pragma once

#include <vector>

#include "kernels/watch/scan.h"

namespace arah {

// In the order in which a step makes them.
enum class Watched : uint32_t {
  canonical,          // x̂ of the samples whose correspondence was found, metres
  distances,          // f there, cube units
  sdf_gradients,      // ∂f/∂n at the shaded samples, where the colour takes the normal
  colors,             // of the shaded samples
  weights,            // compositing weights
  ray_colors,         // with Σ w
  eikonal_gradients,  // ∂f/∂n at the eikonal points
  sign_distances,     // f at the points inside and outside
  d_ray_colors,       // from here on: the loss's gradients
  d_distances,
  d_colors,
  d_canonical,
  count
};

// What the rows of a watched tensor are.
enum class WatchedRow { sample, ray, point };
struct WatchedTensor {
  const char* stage;
  const char* tensor;
  WatchedRow row;
  uint32_t channels;
  double limit;  // of magnitudes, far above what a quantity of this kind can rightly be; 0: none
};
const WatchedTensor& description(Watched what);

class Watch {
 public:
  explicit Watch(Device& device);

  void record_clear(Commands& commands);
  // One pass's part of it. first_row: number of its first row in the step (WatchArgs). Of several in a row, only the first has to wait
  // for what was launched before.
  struct Part {
    Matrix values;
    uint32_t rows = 0;
    uint32_t first_row = 0;
    BufferSlice points = {}, row_ids = {};
    bool after_previous = false;
  };
  void record(Commands& commands, Watched what, const Part& part);

  struct Seen {
    Watched what;
    shared::WatchRecord record;
  };
  // After submission: what had bad numbers, in order.
  std::vector<Seen> seen();

 private:
  Device& device_;
  Buffer records_;
};

}  // namespace arah
