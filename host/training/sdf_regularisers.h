// The terms that keep the SDF a distance (ARAH.md §7): of unit slope everywhere, positive well outside the template and negative
// well inside it.
#pragma once

#include <random>

#include "host/rendering/avatar_networks.h"
#include "host/training/ranks.h"
#include "host/training/template_samples.h"
#include "host/training/training_settings.h"

namespace arah {

class SdfRegularisers {
 public:
  // settings must outlive this. ranks: that share the points out among them; each then finds its part of the sums.
  SdfRegularisers(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, const Ranks& ranks = {});

  // Uploads a step's points: of all that are drawn, this rank's.
  void draw(const TemplateSamples& samples, std::mt19937_64& generator);
  // losses: the unweighted values += at these slots; effective weight gradients of the SDF +=. partials, scratch: shared with others.
  struct Slots {
    uint32_t eikonal, off_surface, inside;
  };
  void record(Commands& commands, const BufferSlice& losses, const Slots& slots, const BufferSlice& partials, const BufferSlice& scratch);
  uint64_t scratch_floats() const;

  // For the watch, after record: ∂f/∂n at the eikonal points; f at the points outside and inside, and how many rows these take.
  Matrix eikonal_gradients() { return eikonal_tape_.gradient(); }
  Ranks::Part eikonal_points() const { return eikonal_; }
  Matrix sign_distances() { return sign_tape_.sdf(); }
  uint32_t sign_rows() const { return padded_points(off_surface_.size()) + inside_.size(); }

 private:
  Device& device_;
  AvatarNetworks& networks_;
  const TrainingSettings& settings_;
  Ranks::Part eikonal_, off_surface_, inside_;  // of the settings' points
  SirenTape eikonal_tape_, sign_tape_;
};

}  // namespace arah
