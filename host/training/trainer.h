// Training: rendering run backwards plus an optimiser. One call of step() is one step; the caller decides when to stop, to
// save and to report.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/rendering/ray_samples.h"
#include "host/rendering/shaded_rays.h"
#include "host/training/bad_values.h"
#include "host/training/parameter_updates.h"
#include "host/training/pose_refinement.h"
#include "host/training/ranks.h"
#include "host/training/shape_refinement.h"
#include "host/training/mask_loss.h"
#include "host/training/ray_importance.h"
#include "host/training/sdf_regularisers.h"
#include "host/training/skinning_gradient.h"
#include "host/training/surface_gradient.h"
#include "host/training/template_samples.h"
#include "host/training/training_images.h"
#include "host/training/training_settings.h"
#include "host/training/watch.h"
#include "shaders/shared/skinning.h"

namespace arah {

// Unweighted values of the terms of one step (ARAH.md §7), and what else is worth a line in the log. Where rays are drawn by
// importance, colour and mask are what all rays by chance would give in the mean.
struct StepReport {
  uint64_t step = 0;  // steps done, this one included
  double color = 0, alpha = 0, eikonal = 0, off_surface = 0, inside = 0, skinning = 0;  // skinning: of the last step that had it
  double parameters = 0;  // size of the generated SDF, where it follows the pose
  double mask = 0, mask_alpha = 0;  // of surface rendering alone: alpha plays no part there
  double total = 0;   // weighted sum
  double sdf_norm = 0;  // of the sdf group's gradient before clipping
  double b = 0;         // metres
  double converged = 0;  // share of the samples whose correspondence was found
  double hits = 0;       // share of the rays on the person whose surface was found, where samples are placed around it
  double shaded = 0;     // share of the samples that got a colour, of all places for them
  uint32_t passes = 0;   // that its rays went in
  // Roots whose gradient (by the implicit function theorem) teaches nothing, because the Jacobian is singular there, and those whose
  // gradient is shortened because it is nearly so: of the searches that taught skinning, poses or a surface.
  shared::ImplicitCounts implicit{};
  uint32_t grid_clamped = 0;  // contributions to the grid's gradient that its fixed-point range cut, since the start
  uint64_t skipped = 0;           // steps not taken because of bad values, since the start of training, this one included
  std::optional<BadValues> bad;   // why this one was not; the losses above may then mean nothing
};

class Trainer {
 public:
  // avatar: untrained, or fitted to its template, or the one that `resume` continues. Its body's shape is where refinement of
  // the shape begins, or, of one that `resume` continues, where it began. The capture must outlive the trainer.
  // Rays that do not fit below the device's memory ceiling together go in several passes, whose gradients add up: the last bits
  // of a training depend on how many. Throws MemoryCeilingError where not even passes of 64 rays fit.
  // ranks: that train together, all with the same capture, avatar and settings. A step's rays and points are drawn as one rank
  // draws them, each rank does its part, and what all found is added up, so that all take the same step; the constructor and step()
  // are collective. Throws InputError where there are too few rays or points for so many ranks.
  Trainer(Device& device, const Capture& capture, Avatar avatar, const TrainingSettings& settings, const Ranks& ranks = {});

  const TrainingSettings& settings() const { return settings_; }
  uint64_t steps_done() const { return steps_; }
  uint64_t steps_skipped() const { return skipped_; }  // of them, because of bad values
  // Of several ranks, since the start: the exchange's seconds, all and those in which the device had work too, at most, and the bytes
  // of the numbers that were added up. (Each rank sends, and gets, 2 (n - 1) / n of these.)
  struct ExchangeTimes {
    double seconds = 0, beside = 0;
    uint64_t bytes = 0;
  };
  const ExchangeTimes& exchange_times() const { return exchange_; }
  // To measure what that is worth: whether the exchange begins beside the way back, or after it. The same bits come out.
  void set_exchange_beside(bool beside) { exchange_beside_ = beside; }
  uint32_t passes() const { return (rays_.size() + pass_rays_ - 1) / pass_rays_; }  // in which a step's rays go, one after the other, at least
  double done() const { return done_; }

  // One step. steps_left: how many are still to come, this one included: the schedule's position moves from where it is
  // towards 1 in that many steps. Where a number on the way is NaN, infinite or out of its range (watch.h), nothing that training
  // learns is changed: throws BadValueError, or, with OnBadValue::skip, counts the step as done. Skipping ends, with the error,
  // after most_skipped steps in a row, or where the state itself is bad, as then no step can be better.
  StepReport step(uint64_t steps_left);
  static constexpr uint64_t most_skipped = 100;

  // The avatar with the averaged weights, as rendering wants it.
  Avatar avatar();
  // Everything that continuing bit for bit needs: avatar_tensors plus "optimizer.*" tensors and "training.*" metadata.
  SafetensorsFile checkpoint();
  // After a BadValueError: the state before the step as a checkpoint, with what was found, for bad_values_of(). A trainer that takes it
  // up fails in its first step in the same way.
  SafetensorsFile failure(const BadValues& found);
  // Takes up a checkpoint of the same avatar. Throws InputError naming what does not fit.
  void resume(const SafetensorsFile& file);

 private:
  struct Batch {
    TrainingImages::Place place;
    size_t number = 0;  // of the place
    uint32_t picture = 0;  // of the step
    bool first_of_frame = true;
    uint32_t on_person = 0;  // the first so many of the rays
    std::vector<uint32_t> pixels;
    std::vector<std::array<float, 4>> targets;
    // Where rays are drawn by importance:
    std::vector<size_t> drawn;   // of the pool's pixels
    std::vector<float> weights;  // of the rays' losses
  };
  // What a step works in beside the networks, for so many rays of a pass.
  struct Room {
    Room(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, uint32_t pass_rays, const Ranks& ranks);
    ParameterUpdates updates;
    Watch watch;
    RaySamples samples;
    ShadedRays shaded;
    std::optional<SurfaceFinder> surface_finder;  // where samples are placed by the surface
    std::optional<SdfRegularisers> regularisers;  // where there is a surface
    std::optional<SkinningGradient> skinning;
    std::optional<PoseGradient> pose_gradient;  // where poses are refined
    std::optional<SurfaceGradient> surface_gradient;  // of surface rendering
    std::optional<MaskLoss> mask_loss;
    std::optional<PointRootFinder> grid_finder;  // where correspondences come from frames' grids
    Buffer implicit_counts;
    Buffer grid_clamped;  // how many contributions to the grid's gradient were
    Buffer losses, targets, d_colors, partials, scratch;
    Buffer ray_weights;  // where rays are drawn by importance
    Buffer exchange;     // of several ranks: all effective gradients, one behind the other
  };
  bool with_grids() const { return with_grids(avatar_.spec, settings_); }
  static bool with_grids(const AvatarSpec& spec, const TrainingSettings& settings) {
    return spec.skinning.kind == Skinning::network && settings.sampling.root.correspondence != Correspondence::search;
  }
  // Searches the roots at the nodes of all frames' grids, where the settings want them, and notes with which parameters.
  void solve_correspondences();
  // The frame's shell and pixels follow its pose where that has moved from theirs (TrainingImages::renew).
  bool renew_shell(size_t frame, double drift);
  // Searches the roots at the nodes of the frames' grids as they were when all were solved.
  void solve_correspondences_again(const std::vector<size_t>& frames);
  void solve_correspondences(FrameOnDevice& frame);
  std::vector<size_t> pictured_frames() const;
  // The avatar's body takes the shape as it is refined now.
  void follow_shape();
  uint32_t planned_rays();
  // One of each frame's pictures.
  std::vector<std::vector<Batch>> draw_batches();
  Batch draw_batch(std::mt19937_64& generator, const std::vector<size_t>& numbers);
  // What the SDF reads of the frame's pose, with noise at times.
  std::vector<float> draw_pose_input(size_t frame, uint32_t number);
  // The batch's pixels by importance: as many on the person and around as by chance, each pool's by PoolImportance.
  void draw_by_importance(Batch& batch, const TrainingImage& image, std::mt19937_64& generator);
  // Notes how far the colours of `rays` of the batch's rays, from `first` on, are from the photograph. Submits.
  void note_errors(const Batch& batch, uint32_t first, uint32_t rays);
  // What was noted of the batch's rays goes to the pools that they were drawn from.
  void see_errors(const Batch& batch);
  // Losses and gradients of `rays` of the batch's, from `first` on, in halves where more of their samples are to be shaded than
  // there is room for: losses and raw gradients +=, effective weight gradients = from this rank's first ray of the batch on and
  // += later. hits: of this rank's rays.
  // Submits, and leaves the last launches recorded.
  void run_pass(FrameOnDevice& frame, const Batch& batch, const SurfaceHits& hits, uint32_t first, uint32_t rays, bool skinning_step);
  // Of surface rendering, of this rank's rays: whether the ray misses the surface or the person, and the loss of those that do. Submits.
  bool of_mask_loss(const Batch& batch, const SurfaceHits& hits, uint32_t ray) const;
  void record_mask_loss_of(FrameOnDevice& frame, const Batch& batch, const SurfaceHits& hits, bool skinning_step);
  // The watch over a pass's tensors, all still in store after its way back; first_of_step: its first ray.
  void watch_pass(uint32_t rays, uint32_t first_of_step, bool position);
  // What was bad in the step, before anything follows from it. state: of that state too, whether it looks bad or not.
  BadValues bad_values(const std::vector<std::vector<Batch>>& frames, const std::vector<float>& losses, const std::vector<PoseGradients>& pose_gradients, bool state);
  std::string place_of(WatchedRow row, uint64_t index, const std::vector<std::vector<Batch>>& frames) const;
  RootFindingCounts searches() { return (room_.mask_loss ? room_.mask_loss->root_finder() : room_.samples.root_finder()).counts(); }
  // What this rank's searches, implicit gradients and grid's gradient met; after submission.
  void download_counts();
  // What each rank has found for its part of a step is added up, in three (trainer_ranks.cpp):
  // after a frame's passes, what they alone give is fetched: the colour's gradients, and in the last frame the grid's;
  void take_passes(bool last_frame);
  // collective: it is added up while the device does the rest of the frame's way back, then that too, before the unpacking;
  void add_up_frame(bool skinning_step);
  // collective: losses, counts, and the gradients that are no network's, once a step.
  void add_up_step(std::vector<PoseGradients>& pose_gradients);
  // Collective, where devices are not alike and so round differently: all get the first rank's parameters.
  void follow_first();
  // Collective: what is bad on this rank, or what another found, so that all do the same.
  BadValues of_all_ranks(const BadValues& found);
  StepReport skip(BadValues found, uint64_t steps_left);
  SafetensorsFile state(const Avatar& shown);
  // Losses and raw gradients (+=) of one frame's pictures.
  void run_frame(const std::vector<Batch>& batches, uint32_t frame_of_step, bool skinning_step);

  Device& device_;
  Avatar avatar_;
  TrainingSettings settings_;
  Ranks ranks_;
  Ranks::Part rays_;             // this rank's of a picture
  Ranks::Part skinning_points_;  // and of the template's surface
  bool alike_ = true;            // whether all ranks' devices are of one kind
  bool exchange_beside_ = true;
  ExchangeTimes exchange_;
  struct OfPasses {
    std::vector<float> color;
    std::vector<uint32_t> grid;
  } of_passes_;                  // take_passes()
  Commands commands_;
  TrainingImages images_;
  TemplateSamples template_samples_;
  RayImportance importance_;
  std::optional<PoseRefinement> refinement_;
  std::optional<ShapeRefinement> shape_;
  uint32_t pass_rays_;
  AvatarNetworks networks_;
  Room room_;
  std::vector<float> grid_parameters_;  // of the skinning network when the frames' grids were solved
  bool pose_step_ = false;       // whether the step moves its frame's pose, or the shape
  std::optional<std::array<float, 9>> view_rotation_;  // of the step's view directions
  uint32_t passes_done_ = 0;     // of the step so far
  uint64_t shaded_samples_ = 0;  // of the step so far that got a colour
  uint64_t person_rays_ = 0, person_hits_ = 0;  // of the step so far
  uint64_t steps_ = 0;
  double done_ = 0;
  double last_skinning_loss_ = 0;
  MaskSharpness mask_sharpness_;
  std::vector<double> noted_errors_;  // of the step's rays, picture by picture, to be seen where the step is taken
  RootFindingCounts searches_;        // of the step, of all ranks
  shared::ImplicitCounts implicit_counts_{};  // of the step, of all ranks
  uint32_t grid_clamped_ = 0;         // since the start, of all ranks
  bool found_apart_ = false;          // whether a rank saw in the step what others may not have seen
  bool state_watched_ = false;            // since the start or resume()
  uint64_t skipped_ = 0, skipped_in_a_row_ = 0;
};

}  // namespace arah
