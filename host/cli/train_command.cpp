#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/outcome.h"
#include "host/cli/training_progress.h"
#include "host/cli/viewer_process.h"
#include "host/input_error.h"
#include "host/training/run_choice.h"
#include "host/training/training_run.h"

namespace arah {
namespace {

struct Options {
  std::filesystem::path capture;
  RunOptions run;
  std::optional<std::string> preset;
  std::optional<int> size;
  std::optional<double> minutes;
  std::optional<uint64_t> steps, seed;
  std::vector<double> disturb;        // degrees, metres
  double disturb_shape = 0;
  bool view = false;
  std::vector<uint32_t> shares;       // of the ranks
  std::filesystem::path prior;
  std::vector<std::string> settings;  // NAME=VALUE
  DeviceOptions device = DeviceOptions::from_environment();
};

// What the options ask for: of a new run, or on top of what a run began with.
RunConfig resolve(const Options& options, const Capture& capture) {
  RunConfig config;
  if (options.run.resume) {
    config = RunFolder(options.run.folder).read_config();
    set_capture(config, capture);
    if (options.preset) config.settings.preset = *options.preset;
  } else {
    std::vector<std::string> reasons;
    config = chosen_config(capture, options.preset.value_or("tiny"), &reasons);
    if (Ranks::of_process().first())
      for (const std::string& reason : reasons) fmt::print(stderr, "{}\n", reason);
  }
  TrainingSettings& settings = config.settings;
  if (options.size) settings.size = *options.size;
  if (options.seed) settings.seed = *options.seed;
  if (options.steps) settings.steps = *options.steps;
  if (options.minutes) settings.minutes = *options.minutes, settings.steps = 0;
  if (!options.disturb.empty()) settings.disturb_degrees = options.disturb[0], settings.disturb_metres = options.disturb[1];
  if (options.disturb_shape > 0) settings.disturb_shape = options.disturb_shape;
  if (!options.prior.empty()) settings.prior = std::filesystem::absolute(options.prior).lexically_normal().string();
  assign(config, options.settings, "--set");
  search_for_refinement(settings);
  check_size(settings, capture);
  return config;
}

int train(const Options& options) {
  const std::filesystem::path viewer = options.view ? viewer_program() : std::filesystem::path();
  if (options.view && viewer.empty()) throw InputError("--view", "", "arah-view beside arah or on the PATH", "none", "It is built unless CMake was told ARAH_VIEWER=OFF.");
  const Capture capture = open_capture(options.capture);
  const RunConfig config = resolve(options, capture);
  RunOptions run = options.run;
  run.ranks = Ranks::of_process();
  run.ranks.set_shares(options.shares);
  Device device(device_of_rank(options.device, run.ranks));
  const std::vector<std::string> devices = run.ranks.gather(std::to_string(device.report().index));
  const Interrupt interrupt;  // of all ranks; the first one's counts
  if (!run.ranks.first()) {
    const RunResult result = run_training(device, capture, config, run);
    Ranks::end_together();
    return result.stopped ? kFailed : 0;
  }
  fmt::print(stderr, "device: {} ({})\n", device.report().name, device.report().driver);
  if (devices.size() > 1) fmt::print(stderr, "{} ranks, on the devices {} of their machines\n", devices.size(), fmt::join(devices, ", "));

  const TrainingSettings& settings = config.settings;
  TrainingProgress progress(device, settings.steps > 0 ? fmt::format("{} steps", settings.steps)
                                                       : fmt::format("{:g} minutes", settings.minutes));
  bool viewed = false;
  const RunResult result = run_training(device, capture, config, run, [&](const RunEvent& event) {
    progress.show(event);
    // There is nothing to see before the first checkpoint.
    if (!viewer.empty() && !viewed && (event.kind == RunEvent::Kind::checkpoint || event.kind == RunEvent::Kind::resumed)) {
      viewed = true;
      if (!start_viewer(viewer, {options.run.folder.string(), "--capture", options.capture.string()})) fmt::print(stderr, "{} could not be started; the training goes on\n", viewer.string());
    }
    return !interrupt.wanted();
  });
  Ranks::end_together();
  progress.finish(result);
  if (options.device.profile) fmt::print("{}", device.profiler().table());
  if (!result.stopped) return 0;
  if (result.avatar.empty()) throw std::runtime_error("stopped during the fit to the template; nothing was kept");
  throw std::runtime_error(fmt::format("stopped at step {}; continue with --resume", result.steps));
}

}  // namespace

void add_train_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("train", "Make an avatar of the person in a capture");
  command->add_option("CAPTURE", options->capture, "the capture's folder")->required();
  command
      ->add_option("-o,--out", options->run.folder,
                   "the run's folder: config.json, events.jsonl, checkpoints/ and avatar.safetensors")
      ->required();
  command->add_option("--preset", options->preset, "sizes and settings to start from (default: tiny)")
      ->check(CLI::IsMember(preset_names()));
  command->add_option("--size", options->size, "columns that pictures are reduced to (default: as they are)")
      ->check(CLI::Range(1, 8192));
  CLI::Option* minutes = command
                             ->add_option("--minutes", options->minutes,
                                          "time in all, the start included (default: the preset's: 10, 30 or 600)")
                             ->check(CLI::Range(0.0, 1e6));
  command->add_option("--steps", options->steps, "steps instead of minutes")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40))
      ->excludes(minutes);
  command->add_option("--seed", options->seed, "of first values, pixels and points (default: 0)");
  command->add_option("--prior", options->prior, "a file of arah pretrain to start from; the fit to the template then takes prior_fit_steps and prior_fit_skinning_steps")
      ->check(CLI::ExistingFile);
  command->add_option("--set", options->settings, "NAME=VALUE: any setting of config.json, as half_width=0.04 or spec.color.view=true; may be repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_option("--disturb-poses", options->disturb, "DEGREES,METRES: for studies of pose refinement, train from poses whose joints are turned and whose root is moved at random by so much (standard deviation)")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::Range(0.0, 360.0));
  command->add_option("--disturb-shape", options->disturb_shape, "for studies of shape refinement, train from a body whose shape (the weight of each morph target) is moved at random by so much (standard deviation)")
      ->check(CLI::Range(0.0, 100.0));
  command->add_option("--keep", options->run.keep_minutes, "minutes, with commas between, after which the avatar is also kept, for arah curve: RUN/kept/minutes_5.safetensors")
      ->delimiter(',')
      ->check(CLI::Range(0.01, 1e6));
  command->add_flag("--resume", options->run.resume,
                    "go on from the newest checkpoint; with more --steps or --minutes also beyond the end");
  command->add_option("--from", options->run.from, "with --resume: go on from this checkpoint of the run, or repeat the step of its failure_*.safetensors, instead of the newest checkpoint")
      ->check(CLI::ExistingFile)
      ->needs("--resume");
  command->add_option("--stop-at", options->run.stop_at, "stop at this step as Ctrl-C would, for --resume to go on")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40));
  command->add_flag("--view", options->view, "open arah-view on the run with the first checkpoint; it follows the others");
  command->add_option("--shares", options->shares, "under mpirun: of the ranks in each step's rays, as 3,1 (default: even ones, or, of devices of several kinds, by their measured speed)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1000));
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->add_flag("--profile", options->device.profile, "time every launch on the device and print the table");
  command->footer(
      "Ctrl-C stops after the current step, with a checkpoint and the avatar (exit code 1).\n"
      "A number of a step that is NaN, infinite or out of its range stops training and leaves failure_*.safetensors in the run's folder;\n"
      "with --set on_bad_value=skip such steps are left out and counted.\n"
      "Under mpirun the ranks share out each step's rays, on one device each; a run may go on with another number of ranks.\n"
      "Example: arah train capture -o run --preset tiny --size 256 --minutes 10\n"
      "         mpirun -n 4 arah train capture -o run --steps 20000");
  command->callback([options, &run] {
    options->run.started = std::chrono::steady_clock::now();
    run = [options] { return train(*options); };
  });
}

}  // namespace arah
