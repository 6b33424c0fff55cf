// The optimiser of a training: Adam's moments, the averaged weights that render, and each group's step of its own rate.
#pragma once

#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/rendering/avatar_networks.h"
#include "host/training/training_settings.h"
#include "kernels/optimizer/adam.h"

namespace arah {

class ParameterUpdates {
 public:
  // settings must outlive this.
  ParameterUpdates(Device& device, AvatarNetworks& networks, const TrainingSettings& settings);

  // Where the averages begin.
  void start(const std::vector<float>& parameters);
  // From the networks' gradients, the grid's sums and, of hyper_last, the outer products of the step's frames. step, done: as
  // rate_factor takes them. skinning: whether the skinning network has gradients.
  void record(Commands& commands, uint64_t step, double done, bool skinning);
  // After submission. Throws std::runtime_error naming the step and the group whose gradient was not finite; it was left as it was.
  void check(uint64_t step);
  double sdf_norm();  // of the sdf group's last gradient, before clipping; after submission

  BufferSlice averages() { return averages_.slice(); }
  // For the way back through the feature grid (kernels/color/feature_grid.h): fixed point, as contributions of a loss over R rays
  // are about 1 / R.
  BufferSlice grid_sums() { return grid_sums_.slice(); }
  float grid_scale() const { return static_cast<float>(all_rays(settings_)) * 4096.0f; }

  // "optimizer.*" tensors. Reading throws InputError naming what does not fit.
  void save(SafetensorsFile& file);
  void load(const SafetensorsFile& file);

 private:
  struct Group {
    std::string name;
    const GroupSettings* settings = nullptr;
    uint64_t begin = 0, end = 0;  // floats
    uint64_t updates = 0;         // Adam's t
  };
  void record_group(Commands& commands, Group& group, size_t index, double factor);
  // Of the group whose gradients are outer products.
  void record_hyper_last(Commands& commands, Group& group, size_t index, double factor);
  AdamArgs adam_args(const Group& group, size_t index, double factor, uint64_t first, uint64_t count);

  Device& device_;
  AvatarNetworks& networks_;
  const TrainingSettings& settings_;
  std::vector<Group> groups_;
  Buffer first_moments_, second_moments_, averages_;  // of the parameters
  Buffer grid_sums_, squares_, norms_;                // of the gradients
};

}  // namespace arah
