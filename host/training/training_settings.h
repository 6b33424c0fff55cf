// Everything that decides how an avatar is trained, as data with a JSON form (RUN/config.json).
// Sources: ARAH.md §7 for the paper's values, RECIPE.md for what trains well in minutes on two CPU cores.
#pragma once

#include <cstdint>
#include <string>

#include "host/rendering/ray_samples.h"

namespace arah {

// What a ray's colour is in training.
enum class Rendering {
  volume,   // its samples', composited (the paper)
  surface,  // the one where it hits the surface (the paper's ablation: appendix "Ablation on Ray Sampling Strategies")
};
const char* to_string(Rendering rendering);

// What training does where a number of a step is NaN, infinite or out of its range (watch.h).
enum class OnBadValue {
  stop,  // the step is not taken; training ends with an error that names the number, and a file that repeats the step
  skip,  // the step is not taken; training goes on with the next one, and counts
};
const char* to_string(OnBadValue on_bad_value);

// Rate of a parameter group over training: 0 for `freeze` steps, linear over `warm_up` steps, times a cosine from 1 to
// TrainingSettings::end_fraction over the whole training.
struct GroupSettings {
  double rate = 0;
  uint64_t freeze = 0;
  uint64_t warm_up = 0;
  double max_norm = 0;  // of the group's gradient; 0: not clipped
  double weight_decay = 0;
};

struct TrainingSettings {
  std::string preset = "tiny";
  uint64_t seed = 0;
  int size = 0;         // columns that pictures are reduced to; 0: as they are
  uint64_t steps = 0;   // 0: as many as `minutes` allow
  double minutes = 10;  // of wall-clock time in all; read where steps is 0

  uint32_t frames_per_step = 1;    // different ones
  uint32_t pictures_per_frame = 1; // of a step's frame: its cameras by chance
  uint32_t rays = 256;             // of each of these pictures
  uint32_t rays_at_a_time = 0;   // of them, rounded up to a multiple of 64; 0: as many as the device has room for
  uint32_t shaded_at_a_time = 0;  // of the samples of these rays; more go in halves. At least those of 64 rays; 0: as many as the device has room for
  double mask_fraction = 0.6;    // of them on the person, the others in the shell around
  double ray_importance = 0;     // share of them drawn where the picture was wrong before, 0..0.9 (ray_importance.h); 0: all by chance
  // surface: the shape learns through the joint search's implicit gradient and from the mask loss (mask_loss.h), in place of
  // alpha_weight; sampling's mode and samples are not read, and b learns nothing.
  Rendering rendering = Rendering::volume;
  SamplingSettings sampling;
  SamplingSettings color_sampling() const;  // that `rendering` asks for
  // surface: the dense samples begin within half_width_start metres of the surface instead of half_width, and come to the
  // latter linearly over half_width_steps, so that a shape that is still far from the pictures is seen. 0: half_width from the start.
  double half_width_start = 0;
  uint64_t half_width_steps = 1000;
  double view_augmentation = 0;  // probability 0..1 that a step rotates the colour's view directions (view_augmentation.h); idle without them
  double least_weight = 1e-3;    // samples whose compositing weight is at most this are black and pass no gradient on; 0: exact

  uint64_t grid_steps = 4000;    // steps between two searches at the nodes of all frames' grids (root_correspondence)

  double color_weight = 30, alpha_weight = 1;
  // Of surface rendering alone: the mask loss's weight, in how many places of a ray the least distance is looked for, and α, per
  // cube unit, at the start and the rate that it learns at. The paper states 3,000, 100 and that α is learnt; 50 is IDR's first.
  double mask_weight = 3000;
  uint32_t mask_samples = 100;
  double mask_alpha = 50, mask_alpha_rate = 1e-4;
  // The first three act on a surface; with sdf.kind density they are idle.
  double eikonal_weight = 10, off_surface_weight = 100, inside_weight = 10, skinning_weight = 10;
  double parameter_weight = 100;  // of the size of the SDF's parameters, |φ| / n (ARAH.md §7); where the SDF follows the pose
  // Where the SDF follows the pose: with this probability normal noise of deviation pose_noise is added to every number of the
  // rotations that it reads (ARAH.md §7, augmentation), so that it does not learn the training poses by heart.
  double pose_noise = 0.1, pose_noise_probability = 0.5;
  uint32_t eikonal_points = 256, off_surface_points = 128, inside_points = 128, skinning_points = 256;
  uint32_t skinning_every = 8;  // steps: the skinning network learns from colours and from the template every so often; 0: never

  GroupSettings sdf, mapping, skinning, color, latent, deviation, grid;
  GroupSettings pose_code, hyper, low_rank, hyper_last;  // of the SDF by pose (parameter_layout.h)

  // Whether the training frames' poses are corrected by what the pictures say (pose_refinement.h). The correspondences of samples
  // must then be searched, if from a grid: between the nodes of a grid that was solved for one pose no other can be seen.
  bool pose_refinement = false;
  // Of each frame's rotations and root position, radians and metres, by the frame's own steps. Weight decay draws them back to
  // where they began.
  GroupSettings poses = {.rate = 1e-4};
  uint32_t poses_every = 1;  // steps between two that move a pose: they cost more, except where the skinning network learns from colours too
  double shell_drift = 0.01;  // metres that a vertex may move before the frame's shell follows its pose
  // Whether, where poses are refined, the body's shape is too (shape_refinement.h): one β for all frames, which moves the joints
  // that poses turn about. Idle without pose_refinement, refused where no morph target of the template moves a joint. `arah
  // train` turns it on where it turns pose_refinement on, because the capture states that its poses are estimates, and the
  // template has such targets: a shape is estimated with its poses. In steps that poses_every names.
  bool shape_refinement = false;
  GroupSettings shape = {.rate = 1e-4};  // of β, by steps. Weight decay draws it back to where it began
  // For studies of refinement: poses are disturbed before training (disturbed_pose()), and so is the body's shape
  // (disturbed_shape()). 0: as the capture has them.
  double disturb_degrees = 0, disturb_metres = 0, disturb_shape = 0;

  double end_fraction = 0.03;     // of each rate, at the end
  double average_decay = 0.995;   // of the moving average that renders; 0: none
  double checkpoint_minutes = 2;  // between checkpoints
  OnBadValue on_bad_value = OnBadValue::stop;

  uint32_t fit_steps = 500;       // of the start: SDF to the template
  uint32_t fit_skinning_steps = 1000;
  double fit_rate = 1e-3;           // of the SDF
  double fit_skinning_rate = 5e-3;  // of the skinning network, under the cross entropy
  double clothing = 0.01;         // metres that the start lies outside the template
  // File of a prior that the fit starts from (prior.h); empty: random first values. With it, its own numbers of steps.
  std::string prior;
  uint32_t prior_fit_steps = 300, prior_fit_skinning_steps = 500;
};

inline bool shape_is_refined(const TrainingSettings& settings) { return settings.pose_refinement && settings.shape_refinement; }

// Where poses are to be refined and correspondences would come from grids alone, they begin their searches there instead.
void search_for_refinement(TrainingSettings& settings);

// "tiny", "compact" or "paper". Throws InputError naming the presets for another word.
TrainingSettings preset_settings(const std::string& preset);

std::string settings_to_json(const TrainingSettings& settings);
// Every field must be there and none else; InputError naming `where` and the field otherwise.
TrainingSettings settings_from_json(const std::string& text, const std::string& where);

// Of a step, of all its pictures.
inline uint32_t all_rays(const TrainingSettings& settings) { return settings.rays * settings.frames_per_step * settings.pictures_per_frame; }
// Throws InputError naming `where` and the setting that does not go with such an avatar, or a rate, weight decay or norm out of range.
void check_settings(const TrainingSettings& settings, const AvatarSpec& spec, const std::string& where);

// Of the dense samples around the surface at a step, metres.
double half_width(const TrainingSettings& settings, uint64_t step);

// Factor of a group's rate at a step, with the part of the training that is done (0..1).
double rate_factor(const GroupSettings& group, const TrainingSettings& settings, uint64_t step, double done);

}  // namespace arah
