// A whole training: template fit, steps, checkpoints, avatar, in a folder (run_folder.h). A producer of events: the
// command line draws them, the folder keeps them.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>

#include "host/training/run_folder.h"
#include "host/training/template_fit.h"
#include "host/training/trainer.h"

namespace arah {

struct RunOptions {
  std::filesystem::path folder;
  bool resume = false;
  std::vector<double> keep_minutes;  // of training, the start included, after which an avatar is kept (RunFolder::kept_file)
  std::filesystem::path from;  // with resume: go on from this checkpoint, or repeat this failed step, instead of the newest checkpoint
  uint64_t stop_at = 0;  // steps done in all, at which the run stops as if asked to; 0: never
  // That train together; run_training is then collective. The first one alone writes, is listened to and stops the run; with
  // resume the others read its checkpoint. All must have the same version, capture and config. Where their devices are not of one
  // kind, and no shares are set, each one's share of a step's rays follows its measured speed.
  Ranks ranks;
  // From when this call's share of settings.minutes counts.
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();
};

struct RunEvent {
  enum class Kind {
    fitting,     // the template fit goes on: `fraction` of it
    fitted,      // `fit`
    resumed,     // from `file`, at `step.step`
    ready,       // the trainer stands, with its memory; a step's rays go in `passes`
    step,        // `step`
    checkpoint,  // `file`
    skipped,     // the step `step.step` was not taken, `step.bad`; settings.on_bad_value is skip
  };
  Kind kind = Kind::fitting;
  double fraction = 0;          // done, 0..1: of the fit, else of the training
  double seconds = 0;           // of training, earlier calls included
  double seconds_per_step = 0;  // 0: not known yet
  uint32_t passes = 1;
  std::vector<uint32_t> shares;  // ready: of the ranks in a step's rays; empty: even ones
  StepReport step;
  TemplateFit fit;
  std::string prior;  // fitted: what became of the prior's pose networks (start_from_prior)
  std::filesystem::path file;
  std::vector<std::string> damaged;  // resumed: newer checkpoints that do not open, a line each
};

struct RunResult {
  bool stopped = false;          // before the end
  uint64_t steps = 0;            // in all
  double seconds = 0;            // in all
  std::filesystem::path avatar;  // empty where the run was stopped in its template fit
  uint64_t skipped = 0;          // steps not taken because of bad values, in all
  std::string poses;             // what refinement did to them, in words; empty without it
};

// Trains for config.settings.steps steps, or, where that is 0, until settings.minutes have passed, counted from
// options.started with all calls of the run together. The schedule of a run by minutes follows the measured time of a
// step. `listen` returns false to stop: the run then leaves a checkpoint and the avatar, or, in the template fit of a
// new run, nothing. A run of so many steps ends with the same bits whether it was interrupted and resumed or not.
// Throws InputError where the folder does not fit (RunFolder), or the capture turns out bad; std::runtime_error where
// training fails, whose text then names the checkpoint to go on from, also where a rank has died. What was written before stays; a new run that fails before its first
// step leaves nothing. Where a number of a step is bad (BadValueError), RunFolder::failure_file is left, and the error says so.
RunResult run_training(Device& device, const Capture& capture, const RunConfig& config, const RunOptions& options,
                       const std::function<bool(const RunEvent&)>& listen = {});

}  // namespace arah
