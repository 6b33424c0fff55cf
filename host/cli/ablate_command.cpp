#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>

#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/progress.h"
#include "host/evaluation/ablation.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "host/training/prior.h"
#include "host/training/run_choice.h"
#include "host/training/training_run.h"

namespace arah {
namespace {

struct Options {
  std::filesystem::path capture, out, prior;
  std::string preset = "tiny";
  std::optional<double> minutes;
  std::optional<uint64_t> steps, seed;
  std::optional<int> size;
  int every = 1;
  std::vector<std::string> only, settings;
  DeviceOptions device = DeviceOptions::from_environment();
};

RunConfig full_config(const Options& options, const Capture& capture) {
  RunConfig config = chosen_config(capture, options.preset);
  TrainingSettings& settings = config.settings;
  if (options.size) settings.size = *options.size;
  if (options.seed) settings.seed = *options.seed;
  if (options.steps) settings.steps = *options.steps;
  if (options.minutes) settings.minutes = *options.minutes;
  assign(config, options.settings, "--set");
  check_size(settings, capture);
  return config;
}

bool is_finished(const RunFolder& folder, const RunConfig& config) {
  if (!std::filesystem::exists(folder.config_file())) return false;
  const std::optional<RunEnd> end = run_end(folder);
  if (!end || end->stopped) return false;
  const TrainingSettings& settings = config.settings;
  constexpr double rounding = 1e-3;  // seconds, of events.jsonl
  return settings.steps > 0 ? end->step >= settings.steps : end->seconds + rounding >= 60 * settings.minutes;
}

// Before hours are spent: runs that lie there must be these, and the prior must fit; what becomes of its pose networks is told.
void check_folders(const Ablation& study, const std::filesystem::path& out, const Capture& capture) {
  for (const AblationVariant& variant : study.variants) {
    const RunFolder folder(out / variant.name);
    if (std::filesystem::exists(folder.config_file())) folder.check_continues(variant.config);
    if (variant.config.settings.prior.empty()) continue;
    Avatar avatar = make_avatar(variant.config.spec, capture, variant.config.settings.seed);
    const std::string pose_networks = start_from_prior(avatar, read_prior(variant.config.settings.prior));
    if (!pose_networks.empty()) fmt::print(stderr, "{}: {}\n", variant.name, pose_networks);
  }
}

// Of the training, 0..1. Where steps are counted, the fit to the template is about a tenth.
double part_of_training(const RunEvent& event, const TrainingSettings& settings) {
  if (settings.steps == 0) return std::min(1.0, event.seconds / (60 * settings.minutes));
  return event.kind == RunEvent::Kind::fitting ? 0.1 * event.fraction : 0.1 + 0.9 * event.fraction;
}

void write_table(const AblationTable& table, const std::filesystem::path& out, const Capture& capture, const Device& device) {
  write_file_safely(out / "ablation.csv", ablation_csv(table));
  write_file_safely(out / "ablation.md", ablation_markdown(table));
  write_file_safely(out / "ablation.html", ablation_page(table, capture, device));
}

int ablate(const Options& options) {
  const Capture capture = open_capture(options.capture);
  const std::string prior = options.prior.empty() ? "" : std::filesystem::absolute(options.prior).lexically_normal().string();
  const Ablation study = ablation(full_config(options, capture), capture_facts(capture), prior, options.only);
  const AblationSettings evaluation{options.every, options.size.value_or(0)};
  AblationTable table;
  table.left_out = study.left_out;
  for (const auto& [name, reason] : study.left_out) fmt::print(stderr, "{}: left out, because {}\n", name, reason);
  if (study.variants.empty()) throw InputError("--only", "", "variants that this capture can show", fmt::format("{}", fmt::join(options.only, ", ")));
  check_folders(study, options.out, capture);
  add_photograph(table, capture, evaluation);
  make_folder(options.out);

  const auto pending = std::count_if(study.variants.begin(), study.variants.end(), [&](const AblationVariant& variant) { return !is_finished(RunFolder(options.out / variant.name), variant.config); });
  constexpr double training = 0.85;  // of a variant's time, about; the rest is its evaluation
  double done = double(study.variants.size()) - double(pending);
  Progress progress("ablate", double(study.variants.size()), "", done);
  const Interrupt interrupt;
  std::vector<std::string> failed;
  for (const AblationVariant& variant : study.variants) {
    const RunFolder folder(options.out / variant.name);
    const bool finished = is_finished(folder, variant.config);
    const auto update = [&](double part, const std::string& what) {
      progress.update(finished ? done : done + part, fmt::format("{} ({} of {}): {}", variant.name, &variant - study.variants.data() + 1, study.variants.size(), what));
      return !interrupt.wanted();
    };
    Device device(options.device);  // one each, so that its memory is the variant's
    try {
      if (!finished) {
        RunOptions run;
        run.folder = options.out / variant.name;
        run.resume = std::filesystem::exists(folder.config_file());
        const RunResult result = run_training(device, capture, variant.config, run, [&](const RunEvent& event) {
          const std::string what = event.kind == RunEvent::Kind::fitting ? "fit to the template" : fmt::format("step {}  loss {:.4f}", event.step.step, event.step.total);
          return update(training * part_of_training(event, variant.config.settings), what);
        });
        if (result.stopped) throw std::runtime_error("stopped");
      }
      table.rows.push_back(measure_variant(device, capture, variant, folder, evaluation, [&](double part) { return update(training + (1 - training) * part, "evaluation"); }));
      progress.say(fmt::format("{}: {}", variant.name, finished ? "trained before" : "done"));
    } catch (const InputError&) {
      throw;
    } catch (const MemoryCeilingError&) {
      throw;
    } catch (const std::runtime_error& error) {
      if (interrupt.wanted()) throw std::runtime_error(fmt::format("stopped at {}; the same call goes on", variant.name));
      progress.say(fmt::format("{}: failed: {}", variant.name, error.what()));  // the others may still teach something
      table.left_out.emplace_back(variant.name, error.what());
      failed.push_back(variant.name);
    }
    write_table(table, options.out, capture, device);
    if (!finished) done += 1;
  }
  progress.finish((options.out / "ablation.html").string());
  fmt::print("{}", ablation_text(table));
  if (!failed.empty()) throw std::runtime_error(fmt::format("training failed: {}", fmt::join(failed, ", ")));
  return 0;
}

}  // namespace

void add_ablate_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("ablate", "Train the paper's ablations on a capture and compare them");
  command->add_option("CAPTURE", options->capture, "the capture's folder")->required();
  command->add_option("-o,--out", options->out, "folder for a run of each variant, ablation.csv, ablation.html and ablation.md")->required();
  command->add_option("--preset", options->preset, "sizes and settings to start from")->check(CLI::IsMember(preset_names()))->capture_default_str();
  CLI::Option* minutes = command->add_option("--minutes", options->minutes, "of each training, the start included (default: the preset's)")->check(CLI::Range(0.0, 1e6));
  command->add_option("--steps", options->steps, "of each training, instead of minutes")->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40))->excludes(minutes);
  command->add_option("--size", options->size, "columns that pictures are reduced to (default: as they are)")->check(CLI::Range(1, 8192));
  command->add_option("--only", options->only, fmt::format("variants, with commas between: {}", fmt::join(ablation_names(), ", ")))->delimiter(',');
  command->add_option("--prior", options->prior, "a file of arah pretrain: adds the variant that starts from it")->check(CLI::ExistingFile);
  command->add_option("--every", options->every, "evaluate every so-many-th frame that has pictures")->check(CLI::Range(1, 1000000))->capture_default_str();
  command->add_option("--seed", options->seed, "of first values, pixels and points (default: 0)");
  command->add_option("--set", options->settings, "NAME=VALUE: a setting of every variant, as of arah train; may be repeated")->expected(1)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "Ctrl-C stops after the current step; the same call goes on from there, and what is finished is not trained again.\n"
      "Example: arah ablate capture -o study --minutes 10 --size 256 --only full,no_conditioning,low_rank");
  command->callback([options, &run] {
    run = [options] { return ablate(*options); };
  });
}

}  // namespace arah
