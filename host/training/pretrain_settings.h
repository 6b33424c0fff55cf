// Everything that decides how a prior is learned, as data with a JSON form (metadata "settings" of its file).
// Sources: paper, App. "Forward LBS Network" and "Canonical SDF Network"; ARAH.md section 10.
#pragma once

#include <cstdint>
#include <string>

#include "host/avatar/avatar_spec.h"

namespace arah {

// Of one network's Reptile (reptile.h).
struct ReptileSettings {
  uint64_t steps = 0;        // outer ones; 0: the network is not pre-trained
  uint32_t tasks = 3;        // of an outer step: scans for the SDF, bodies for the skinning and the pose networks
  uint32_t inner_steps = 24;  // for the pose networks: passes over the body's poses
  double inner_rate = 1e-4, outer_rate = 1e-5;
  double end_fraction = 1;  // of the outer rate at the last step, by a cosine; 1: constant, as in the paper
};

struct PretrainSettings {
  std::string preset = "tiny";
  uint64_t seed = 0;
  uint64_t bodies = 8;   // of the generated family
  uint64_t poses = 4;    // of each body with clothes that move

  ReptileSettings sdf, skinning;
  // The second stage, where the spec's SDF follows the pose: its pose networks, over the SDF that the first left and that stays.
  // The rates are those of `hyper` and the last layers or factors.
  ReptileSettings pose{.tasks = 1, .inner_rate = 1e-6, .outer_rate = 1e-6};
  double pose_encoder_rate = 1e-4;  // inside and outside, of the encoder
  uint32_t pose_batch = 12;         // scans of an inner step
  double parameter_weight = 100;    // of |φ|₂ / n, the size of the generated matrices
  // Of a task of the SDF, and the weights of its terms: |f| and 1 − cos(∇f, n) on the surface, exp(−100 |f|) off it,
  // ||∇f| − 1| everywhere; each is summed over its points and divided by the number of all.
  uint32_t surface_points = 384, volume_points = 384;
  double surface_weight = 3000, normal_weight = 100, volume_weight = 100, eikonal_weight = 50;
  uint32_t skinning_points = 512;  // of an inner step; the loss is the fit's cross entropy (docs/decisions/skinning-fit.md)
};

// "tiny" (minutes on two CPU cores), "compact" or "paper" (the paper's rates, batches and steps). Throws InputError naming
// the presets for another word.
PretrainSettings preset_pretrain_settings(const std::string& preset);

std::string pretrain_settings_to_json(const PretrainSettings& settings);
// Every field must be there and none else, but those of the second stage, which came later and then keep their defaults;
// InputError naming `where` and the field otherwise.
PretrainSettings pretrain_settings_from_json(const std::string& text, const std::string& where);

// The parts of a spec that a prior holds: the SDF without latent codes, its pose networks and the skinning network, sizes kept.
AvatarSpec prior_spec(const AvatarSpec& spec);

}  // namespace arah
