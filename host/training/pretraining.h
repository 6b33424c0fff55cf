// Learning a prior: Reptile on the skinning weights of a family of bodies, on the SDF of their surfaces in many poses, and on
// the networks that make that SDF follow the pose (the paper's LBS network and MetaAvatar's two stages; ARAH.md section 10).
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "host/capture/body_family.h"
#include "host/training/prior.h"
#include "kernels/vulkan/device.h"

namespace arah {

// The networks at work on a family, an outer step at a time. Same family, seed and device: the same bits, however
// often it was saved and resumed between.
class Pretraining {
 public:
  // Throws MemoryCeilingError with the figures where the device's ceiling leaves no room, before the scans are made.
  Pretraining(Device& device, const AvatarSpec& spec, const BodyFamily& family, const PretrainSettings& settings);
  ~Pretraining();

  // One outer step; returns its mean loss over tasks and inner steps (weighted sum of the SDF's terms, cross entropy).
  // pose_step is the second stage, meant to follow the last sdf_step: the shared SDF stays. Throws std::logic_error for a
  // network that the spec lacks.
  double sdf_step();
  double skinning_step();
  double pose_step();
  uint64_t sdf_steps() const;
  uint64_t skinning_steps() const;
  uint64_t pose_steps() const;

  // Mean loss over the family's bodies halfway between their poses, of the SDF that follows the pose and of the one that all
  // poses share; the regulariser not counted. Changes nothing. Both are the same without pose networks.
  struct HeldOut {
    double posed = 0, shared = 0;
  };
  HeldOut held_out();

  // The prior, with what continuing needs.
  SafetensorsFile tensors();
  // Takes up what tensors() wrote. Throws InputError naming what does not fit: sizes, family, settings other than the
  // numbers of steps.
  void resume(const SafetensorsFile& file);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct PretrainEvent {
  const char* network = "";  // "skinning weights", "SDF" or "SDF by pose"
  uint64_t step = 0, steps = 0;
  uint64_t first = 0;  // done before this call
  double loss = 0;
  bool saved = false;  // the file was just written
};

struct PretrainOptions {
  std::filesystem::path out;
  bool resume = false;
  double save_seconds = 60;  // between writings of the file
};

// All networks to their numbers of steps, the file written safely now and then and at the end. `listen` returns false to
// stop: the file then holds what there is. Returns whether it came to the end.
bool run_pretraining(Pretraining& pretraining, const PretrainSettings& settings, const PretrainOptions& options, const std::function<bool(const PretrainEvent&)>& listen = {});

}  // namespace arah
