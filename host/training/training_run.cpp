#include "host/training/training_run.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <vector>

#include "host/avatar/avatar_file.h"
#include "host/avatar/spec_choice.h"
#include "host/input_error.h"
#include "host/training/prior.h"
#include "host/training/rank_shares.h"
#include "host/version.h"

namespace arah {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::ordered_json;

constexpr double kLogInterval = 2.0;  // seconds between "step" lines
constexpr const char* kSecondsKey = "training.seconds";

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Seconds that a step takes. The first steps make pipelines, and any step may read a picture for the first time, so an
// estimate that trusted them would hurry the schedule.
class Pace {
 public:
  void add(double seconds) {
    if (++seen_ <= kPipelineSteps) return;
    recent_.push_back(seconds);
    if (recent_.size() > kWindow) recent_.pop_front();
  }
  bool known() const { return !recent_.empty(); }
  double seconds() const {
    if (!known()) return kGuess;
    std::vector<double> sorted(recent_.begin(), recent_.end());
    std::sort(sorted.begin(), sorted.end());
    if (sorted.size() < kTrusted) return sorted[sorted.size() / 2];
    // Without the slowest tenth: cold pictures and checkpoints' neighbours.
    sorted.resize(sorted.size() - sorted.size() / 10);
    double sum = 0;
    for (const double value : sorted) sum += value;
    return sum / static_cast<double>(sorted.size());
  }

 private:
  static constexpr uint64_t kPipelineSteps = 2;
  static constexpr std::size_t kTrusted = 50, kWindow = 200;
  static constexpr double kGuess = 0.05;  // quick: the schedule then hardly moves until there are measurements
  uint64_t seen_ = 0;
  std::deque<double> recent_;
};

ordered_json step_json(const StepReport& r) {
  return {{"event", "step"},
          {"step", r.step},
          {"total", r.total},
          {"color", r.color},
          {"alpha", r.alpha},
          {"mask", r.mask},
          {"mask_alpha", r.mask_alpha},
          {"eikonal", r.eikonal},
          {"inside", r.inside},
          {"skinning", r.skinning},
          {"parameters", r.parameters},
          {"off_surface", r.off_surface},
          {"sdf_norm", r.sdf_norm},
          {"b", r.b},
          {"converged", r.converged},
          {"hits", r.hits},
          {"shaded", r.shaded},
          {"singular", r.implicit.singular},
          {"shortened", r.implicit.shortened},
          {"grid_clamped", r.grid_clamped}};
}

// A step with bad values, kept in a file of its own: what there is to say of going on stands in its text.
class KeptStep : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class TrainingRun {
 public:
  TrainingRun(Device& device, const Capture& capture, const RunConfig& config, const RunOptions& options,
              const std::function<bool(const RunEvent&)>& listen)
      : device_(device),
        capture_(capture),
        settings_(config.settings),
        config_(config),
        options_(options),
        ranks_(options.ranks),
        listen_(listen),
        folder_(options.folder) {}

  RunResult run() {
    check_settings(settings_, config_.spec, "training");
    ranks_.agree(facts());
    std::optional<SafetensorsFile> saved;
    if (!ranks_.first()) {
      saved = checkpoint_of_first();
    } else if (options_.resume) {
      folder_.reopen(config_);
      saved = options_.from.empty() ? folder_.newest_checkpoint(&damaged_) : read_safetensors(options_.from);
      if (saved) earlier_ = earlier_seconds(*saved);
    } else {
      folder_.create(config_);
    }
    std::string checkpoint = saved ? saved->path.string() : "";
    if (ranks_.first()) ranks_.broadcast(checkpoint);
    try {
      log({{"event", "start"},
           {"device", device_.report().name},
           {"driver", device_.report().driver},
           {"version", kVersion},
           {"resumed", saved.has_value()}});
      return saved ? resumed(*saved) : fresh();
    } catch (const InputError&) {
      give_up();
      throw;
    } catch (const MemoryCeilingError&) {
      give_up();
      throw;
    } catch (const KeptStep&) {
      give_up();
      throw;
    } catch (const std::runtime_error& error) {
      give_up();
      if (!saved_step_) throw;
      throw std::runtime_error(fmt::format("{}. Once that is mended, --resume goes on from the checkpoint of step {}.", error.what(), *saved_step_));
    } catch (...) {
      give_up();
      throw;
    }
  }

 private:
  void give_up() {
    if (ranks_.first() && !options_.resume && !stepped_) folder_.discard();
  }

  // What must be the same on all ranks, or they would not take the same steps.
  std::map<std::string, std::string> facts() const {
    std::map<std::string, std::string> facts{{"version", kVersion}, {"resume", options_.resume ? "yes" : "no"}, {"memory ceiling", device_.memory_ceiling() ? "one" : "none"}};
    for (const auto& [name, print] : config_.parts) facts["capture: " + name] = print;
    for (const auto& [part, text] : {std::pair{"setting", settings_to_json(settings_)}, {"spec", spec_to_json(config_.spec)}}) {
      const ordered_json fields = ordered_json::parse(text);
      for (const auto& [name, value] : fields.items()) facts[fmt::format("{} {}", part, name)] = value.dump();
    }
    return facts;
  }

  std::optional<SafetensorsFile> checkpoint_of_first() const {
    std::string path;
    ranks_.broadcast(path);
    if (path.empty()) return std::nullopt;
    return read_safetensors(path);
  }

  double seconds() const { return earlier_ + seconds_since(options_.started); }
  double budget() const { return 60 * settings_.minutes; }

  static double earlier_seconds(const SafetensorsFile& file) {
    const auto found = file.metadata.find(kSecondsKey);
    const double value = found == file.metadata.end() ? NAN : std::atof(found->second.c_str());
    if (!(value >= 0)) throw InputError(file.path.string(), std::string("metadata ") + kSecondsKey, "seconds", "none");
    return value;
  }

  bool tell(RunEvent event) {
    event.seconds = seconds();
    if (listen_ && !listen_(event)) stopped_ = true;
    return !stopped_;
  }

  void log(ordered_json event) {
    if (!ranks_.first()) return;
    event["seconds"] = std::round(1000 * seconds()) / 1000;
    folder_.log(event.dump());
  }

  // One picture of each camera, so that a wrong size or kind is known before the fit and not after.
  void check_pictures() const {
    for (std::size_t camera = 0; camera < capture_.cameras.size(); ++camera) {
      if (capture_.cameras[camera].role != "train") continue;
      const std::vector<int> frames = frames_with_images(capture_, "train", camera);
      if (!frames.empty()) load_image(capture_, "train", camera, frames.front(), settings_.size);
    }
  }

  std::vector<Pose> training_poses() const {
    std::vector<Pose> poses;
    for (const int frame : training_frames(capture_)) poses.push_back(find_frame(motion_of(capture_, "train"), frame)->pose);
    return poses;
  }

  // Of the capture's body, or, for studies, of one in another shape.
  Avatar untrained() const {
    if (settings_.disturb_shape == 0) return make_avatar(config_.spec, capture_, settings_.seed);
    BodyTemplate body = capture_.body_template;
    set_shape(body, disturbed_shape(body.shape.beta, settings_.disturb_shape, settings_.seed));
    const std::vector<int> frames = training_frames(capture_);
    return make_avatar(config_.spec, std::move(body), frames, settings_.seed, &find_frame(motion_of(capture_, "train"), frames.front())->pose);
  }

  RunResult fresh() {
    check_pictures();
    Avatar avatar = untrained();
    TrainingSettings fit = settings_;
    std::string pose_networks;
    if (!settings_.prior.empty()) {
      const Prior prior = read_prior(settings_.prior);
      pose_networks = start_from_prior(avatar, prior);
      fit.fit_steps = settings_.prior_fit_steps;
      fit.fit_skinning_steps = settings_.prior_fit_skinning_steps;
      log({{"event", "prior"}, {"file", settings_.prior}, {"family", ordered_json::parse(prior.family)}, {"seed", prior.settings.seed}, {"version", prior.version}, {"pose_networks", pose_networks}});
    }
    if (device_.memory_ceiling()) Trainer(device_, capture_, avatar, settings_, ranks_);  // too low a ceiling is refused before the fit
    RunEvent event;
    bool whole = true;
    try {
      if (ranks_.first())
        event.fit = fit_template(device_, avatar, fit, [&](double fraction) {
          RunEvent fitting;
          fitting.fraction = fraction;
          return tell(fitting);
        }, training_poses());
    } catch (const std::runtime_error&) {
      if (!stopped_) throw;
      if (!options_.resume) folder_.discard();
      whole = false;
    }
    if (!fit_of_first(avatar, whole)) return {true, 0, seconds(), {}, 0, {}};
    log({{"event", "fit"}, {"sdf_error", event.fit.sdf_error}, {"skinning_error", event.fit.skinning_error}});
    event.kind = RunEvent::Kind::fitted;
    event.prior = pose_networks;
    tell(event);
    share_out(avatar);
    Trainer trainer(device_, capture_, std::move(avatar), settings_, ranks_);
    return train(trainer);
  }

  void share_out(const Avatar& avatar) {
    if (!ranks_.shares().empty() || ranks_.all_alike(device_.report().name + device_.report().driver)) return;
    ranks_.set_shares(shares_by_speed(device_, capture_, avatar, settings_, ranks_));
  }

  // Every rank gets the first one's avatar as it was fitted, or learns that its fit was stopped.
  bool fit_of_first(Avatar& avatar, bool whole) const {
    if (!ranks_.broadcast(whole ? 1 : 0)) return false;
    ranks_.broadcast(std::span(avatar.parameters));
    return true;
  }

  RunResult resumed(const SafetensorsFile& file) {
    Avatar avatar = avatar_from_tensors(file);
    share_out(avatar);
    Trainer trainer(device_, capture_, std::move(avatar), settings_, ranks_);
    trainer.resume(file);
    ranks_.agree({{"checkpoint", fmt::format("{} of step {}", file.path.string(), trainer.steps_done())}});
    RunEvent event;
    event.kind = RunEvent::Kind::resumed;
    event.file = file.path;
    event.damaged = damaged_;
    event.step.step = trainer.steps_done();
    saved_step_ = trainer.steps_done();
    event.fraction = trainer.done();
    tell(event);
    return train(trainer);
  }

  // The same number on all ranks: steps to come, the next one included; 0: the training is over, or was stopped.
  uint64_t steps_to_go(const Trainer& trainer) const { return ranks_.broadcast(stopped_ ? 0 : steps_left(trainer)); }

  // Steps to come, the next one included; 0: the training is over.
  uint64_t steps_left(const Trainer& trainer) const {
    if (settings_.steps > 0) return settings_.steps - std::min(settings_.steps, trainer.steps_done());
    const double rest = budget() - seconds();
    return rest > 0 ? std::max<uint64_t>(1, static_cast<uint64_t>(rest / pace_.seconds())) : 0;
  }

  double fraction(const Trainer& trainer) const {
    const double part =
        settings_.steps > 0 ? double(trainer.steps_done()) / double(settings_.steps) : seconds() / budget();
    return std::clamp(part, 0.0, 1.0);
  }

  void save(Trainer& trainer) {
    if (!ranks_.first()) return;
    SafetensorsFile file = trainer.checkpoint();
    file.metadata[kSecondsKey] = fmt::format("{:.3f}", seconds());
    RunEvent event;
    event.kind = RunEvent::Kind::checkpoint;
    event.file = folder_.save_checkpoint(trainer.steps_done(), file);
    saved_step_ = trainer.steps_done();
    save_avatar(folder_.avatar_file(), trainer.avatar());
    event.step.step = trainer.steps_done();
    event.fraction = fraction(trainer);
    log({{"event", "checkpoint"}, {"step", trainer.steps_done()}, {"file", event.file.filename().string()}});
    tell(event);
  }

  // The avatar under the last time that has passed; several pass at once where steps are long.
  void keep(Trainer& trainer, double passed) {
    if (!ranks_.first()) return;
    double last = 0;
    for (const double minutes : options_.keep_minutes)
      if (60 * minutes > kept_until_ && 60 * minutes <= passed) last = std::max(last, minutes);
    kept_until_ = std::max(kept_until_, passed);
    if (last == 0) return;
    std::filesystem::create_directories(folder_.kept_file(last).parent_path());
    save_avatar(folder_.kept_file(last), trainer.avatar());
    log({{"event", "kept"}, {"step", trainer.steps_done()}, {"file", folder_.kept_file(last).filename().string()}});
  }

  // Keeps the step that failed, and says how to look at it.
  std::string keep_failure(Trainer& trainer, const BadValues& found) {
    if (!ranks_.first()) return "";
    const std::filesystem::path path = folder_.failure_file(found.step);
    try {
      SafetensorsFile file = trainer.failure(found);
      file.metadata[kSecondsKey] = fmt::format("{:.3f}", seconds());
      write_safetensors(path, file);
      log({{"event", "bad_values"}, {"step", found.step}, {"what", describe(found)}, {"file", path.filename().string()}});
    } catch (const std::exception& error) {
      return fmt::format("The step could not be kept: {}", error.what());
    }
    stepped_ = true;  // the run's folder stays
    return fmt::format("Kept in {0}: arah inspect says what it holds, arah train --resume --from {0} repeats the step.", path.string());
  }

  StepReport step(Trainer& trainer, uint64_t left) {
    try {
      return trainer.step(left);
    } catch (const BadValueError& error) {
      throw KeptStep(fmt::format("{}. {}", error.what(), keep_failure(trainer, error.found())));
    }
  }

  void tell_skipped(const StepReport& report) {
    log({{"event", "bad_values"}, {"step", report.step}, {"what", describe(*report.bad)}, {"skipped", report.skipped}});
    RunEvent event;
    event.kind = RunEvent::Kind::skipped;
    event.step = report;
    tell(event);
  }

  RunResult train(Trainer& trainer) {
    kept_until_ = earlier_;
    RunEvent ready;
    ready.kind = RunEvent::Kind::ready;
    ready.fraction = fraction(trainer);
    ready.passes = trainer.passes();
    ready.shares = ranks_.shares();
    ordered_json line{{"event", "ready"}, {"memory", device_.allocated_bytes()}, {"memory_ceiling", device_.memory_ceiling()}, {"passes", ready.passes}};
    if (ranks_.count() > 1) line["ranks"] = ranks_.count();
    if (!ready.shares.empty()) line["shares"] = ready.shares;
    log(line);
    tell(ready);
    double saved_at = seconds(), logged_at = -kLogInterval;
    StepReport last;
    for (;;) {
      if (options_.stop_at > 0 && trainer.steps_done() >= options_.stop_at) stopped_ = true;
      const uint64_t left = steps_to_go(trainer);
      if (left == 0) break;
      const Clock::time_point start = Clock::now();
      StepReport report = step(trainer, left);
      pace_.add(seconds_since(start));
      stepped_ = true;
      if (report.bad) {
        tell_skipped(report);
        continue;
      }
      last = report;
      if (seconds() - logged_at >= kLogInterval) {
        log(step_json(last));
        logged_at = seconds();
      }
      RunEvent event;
      event.kind = RunEvent::Kind::step;
      event.step = last;
      event.fraction = fraction(trainer);
      event.seconds_per_step = pace_.known() ? pace_.seconds() : 0;
      tell(event);
      keep(trainer, seconds());
      if (seconds() - saved_at >= 60 * settings_.checkpoint_minutes) {
        save(trainer);
        saved_at = seconds();
      }
    }
    ranks_.agree({{"parameters after training", fingerprint_of(trainer)}});
    const bool stopped = ranks_.broadcast(stopped_ && steps_left(trainer) > 0 ? 1 : 0) != 0;
    if (!stopped && settings_.steps == 0) keep(trainer, std::max(seconds(), budget()));  // the last step may end a moment before
    save(trainer);
    ordered_json end{{"event", "end"}, {"step", trainer.steps_done()}, {"stopped", stopped}};
    if (stepped_) end["total"] = last.total;
    end["skipped"] = trainer.steps_skipped();
    RunResult result{stopped, trainer.steps_done(), 0, folder_.avatar_file(), trainer.steps_skipped(), {}};
    if (settings_.pose_refinement) {
      const Avatar avatar = trainer.avatar();
      const PoseImprovement poses = pose_improvement(avatar.refined, avatar.body, capture_.body_template.skeleton, motion_of(capture_, "train"));
      result.poses = describe(poses);
      end["poses"] = {{"frames", poses.after.frames}, {"before_mm", 1000 * poses.before.joints}, {"after_mm", 1000 * poses.after.joints}};
      if (settings_.shape_refinement) end["shape"] = {{"names", avatar.body.shape.names}, {"capture", capture_.body_template.shape.beta}, {"before", avatar.refined.start_shape}, {"after", avatar.body.shape.beta}};
    }
    end["most_memory"] = device_.most_allocated_bytes();
    end["shaders"] = device_.pipelines_made();
    end["shader_seconds"] = std::round(1000 * device_.pipeline_seconds()) / 1000;
    log(std::move(end));
    result.seconds = seconds();
    return result;
  }

  // Ranks that took other steps than each other would have trained nothing.
  std::string fingerprint_of(Trainer& trainer) const {
    if (ranks_.count() == 1) return "";
    uint64_t hash = 0xcbf29ce484222325ull;  // FNV-1a
    const SafetensorsFile file = trainer.checkpoint();
    for (const std::byte byte : file.at("optimizer.parameters").data) hash = (hash ^ uint64_t(byte)) * 0x100000001b3ull;
    return fmt::format("{:016x}", hash);
  }

  Device& device_;
  const Capture& capture_;
  const TrainingSettings& settings_;
  const RunConfig& config_;
  const RunOptions& options_;
  Ranks ranks_;
  const std::function<bool(const RunEvent&)>& listen_;
  RunFolder folder_;
  Pace pace_;
  double earlier_ = 0;     // seconds of earlier calls
  double kept_until_ = 0;  // seconds
  std::vector<std::string> damaged_;     // checkpoints that were passed over
  std::optional<uint64_t> saved_step_;   // of the newest checkpoint
  bool stopped_ = false, stepped_ = false;
};

}  // namespace

RunResult run_training(Device& device, const Capture& capture, const RunConfig& config, const RunOptions& options,
                       const std::function<bool(const RunEvent&)>& listen) {
  return TrainingRun(device, capture, config, options, listen).run();
}

}  // namespace arah
