// The optimiser of a training: Adam's moments, the averaged weights that render, and each group's step of its own rate.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/rendering/avatar_networks.h"
#include "host/training/bad_values.h"
#include "host/training/training_settings.h"
#include "kernels/optimizer/adam.h"

namespace arah {

class ParameterUpdates {
 public:
  // settings must outlive this.
  ParameterUpdates(Device& device, AvatarNetworks& networks, const TrainingSettings& settings);

  // Where the averages begin.
  void start(const std::vector<float>& parameters);
  // Norms of the networks' gradients and, of hyper_last, of the outer products of the step's frames. skinning: whether the
  // skinning network has gradients.
  void record_norms(Commands& commands, bool skinning);
  // After that has run: the groups whose gradient is not finite, or so large that the square of its norm is not.
  std::vector<BadTensor> bad_gradients();
  // What of the state itself is not finite: parameters, moments and averages, the first bad tensor of each.
  std::vector<BadTensor> bad_state();
  // The step, from these gradients, after their norms, and the grid's sums. step, done: as rate_factor takes them.
  void record(Commands& commands, uint64_t step, double done, bool skinning);
  // Instead of the step: nothing is changed.
  void record_skip(Commands& commands) { commands.fill(grid_sums_.slice(), 0); }
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
    bool watched = false;         // whether the step has a norm of its gradient
  };
  void record_group(Commands& commands, Group& group, size_t index, double factor);
  // Of the group whose gradients are outer products.
  void record_hyper_last(Commands& commands, Group& group, size_t index, double factor);
  // What is wrong with `values`, numbers from number `first` of the layout on.
  std::optional<BadTensor> first_bad(const std::vector<float>& values, uint64_t first, double limit) const;
  AdamArgs adam_args(const Group& group, size_t index, double factor, uint64_t first, uint64_t count);

  Device& device_;
  AvatarNetworks& networks_;
  const TrainingSettings& settings_;
  std::vector<Group> groups_;
  Buffer first_moments_, second_moments_, averages_;  // of the parameters
  Buffer grid_sums_, squares_, norms_;                // of the gradients
};

}  // namespace arah
