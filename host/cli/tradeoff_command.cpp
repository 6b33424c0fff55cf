#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/cli/rank_devices.h"
#include "host/evaluation/tradeoff.h"
#include "host/evaluation/training_tradeoff.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {
namespace {

// "100ms", "1.5s" or "100" (milliseconds) with the unit's factor; "0.1dB" or "45" for a PSNR.
double with_unit(const std::string& option, const std::string& text, const std::vector<std::pair<std::string, double>>& units) {
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  const std::string unit = text.substr(used);
  for (const auto& [name, factor] : units)
    if (used > 0 && (unit.empty() || unit == name) && value > 0) return value * (unit.empty() ? 1 : factor);
  std::string known;
  for (const auto& [name, factor] : units) known += (known.empty() ? "" : " or ") + name;
  throw InputError(option, "", "a number above 0 in " + known, "'" + text + "'");
}

void say_choice(const char* question, const TradeoffPoint* point) {
  if (!point) {
    fmt::print("{}: none of these settings\n", question);
    return;
  }
  fmt::print("{}: {} ({:.1f} ms, {})", question, point->name, point->milliseconds, std::isfinite(point->psnr_exact) ? fmt::format("{:.2f} dB against the exact rendering", point->psnr_exact) : "the exact picture");
  if (point->knobs.empty()) fmt::print(": --quality {}\n", point->name);
  else {
    fmt::print(":");
    for (const auto& [name, value] : point->knobs) fmt::print(" --set {}={}", name, value);
    fmt::print("\n");
  }
}

}  // namespace

void add_tradeoff_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path avatar, capture, out;
    TradeoffSettings settings;
    std::string budget, max_error;
    bool training = false;
    uint32_t rays = 0;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  TradeoffSettings& settings = options->settings;
  CLI::App* command = program.add_subcommand("tradeoff", "Measure what each approximation of rendering, or of training, costs and buys");
  command->add_option("AVATAR", options->avatar, kAvatarHelp)->required();
  command->add_option("CAPTURE", options->capture, "the capture's folder")->required();
  command->add_option("-o,--out", options->out, "folder for tradeoff.csv, tradeoff.svg and report.html; with --training for training_tradeoff.csv")->required();
  command->add_option("--split", settings.split, "whose frames: train, novel, ood, ...")->capture_default_str();
  command->add_option("--cameras", settings.cameras, "training, held-out, all, or names with commas between")->capture_default_str();
  command->add_option("--pictures", settings.pictures, "how many, evenly chosen")->check(CLI::Range(1, 1000))->capture_default_str();
  command->add_option("--size", settings.size, "columns of the pictures (default: the camera's)")->check(CLI::Range(1, 8192));
  command->add_option("--repetitions", settings.repetitions, "of each picture, after one that is not counted")->check(CLI::Range(1, 1000))->capture_default_str();
  command->add_flag("--presets", settings.presets_alone, "measure the presets alone, not each knob");
  command->add_option("--budget", options->budget, "say which setting is nearest to the exact rendering within this time a picture: 100ms, 2s");
  command->add_option("--max-error", options->max_error,
                      "say which setting is the fastest whose PSNR against the photographs is at most this much below the exact rendering's: 0.1dB");
  add_lpips_option(*command, settings.lpips);
  CLI::Option* training = command->add_flag("--training", options->training, "instead of pictures: the time of a training step and how far each approximation moves the gradients")->excludes("--budget")->excludes("--max-error")->excludes("--lpips");
  command->add_option("--rays", options->rays, "of a training step (default: as the avatar was trained)")->check(CLI::Range(1, 65536))->needs(training);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "Example: arah tradeoff run capture -o study --size 256 --budget 200ms --max-error 0.1dB\n"
      "         mpirun -n 4 arah tradeoff run capture -o study   (each setting's pictures on the rank that is free: the same errors; times are right\n"
      "         where each rank has a device to itself, and of one kind: ranks that share a device disturb each other's times)");
  command->callback([options, &run] {
    run = [options] {
      std::optional<double> budget, max_error;
      if (!options->budget.empty()) budget = with_unit("--budget", options->budget, {{"ms", 1}, {"s", 1000}});
      if (!options->max_error.empty()) max_error = with_unit("--max-error", options->max_error, {{"dB", 1}});
      const Avatar avatar = load_avatar(avatar_file(options->avatar));
      const Capture capture = open_capture(options->capture);
      const Ranks& ranks = Ranks::of_process();
      if (options->training && ranks.count() > 1) throw InputError("arah tradeoff --training", "", "to be called without mpirun", fmt::format("{} ranks", ranks.count()), "It measures one device.");
      Device device(device_of_rank(options->device, ranks));
      const std::string unequal = unequal_devices(ranks, device);
      if (!ranks.first()) {
        measure_tradeoff(device, avatar, capture, options->settings, {}, ranks);
        return 0;
      }
      Progress progress("tradeoff", 1.0, "");
      if (!unequal.empty()) progress.say(unequal + ", and times by much");
      if (options->training) {
        const TrainingTradeoffSettings wanted{options->rays, options->settings.size, static_cast<uint32_t>(options->settings.repetitions)};
        const TrainingTradeoff study = measure_training_tradeoff(device, avatar, capture, wanted, [&](double part, const std::string& what) { progress.update(part, what); });
        make_folder(options->out);
        write_file_safely(options->out / "training_tradeoff.csv", training_tradeoff_csv(study));
        progress.finish((options->out / "training_tradeoff.csv").string());
        fmt::print("{}", training_tradeoff_table(study));
        return 0;
      }
      const Tradeoff tradeoff = measure_tradeoff(device, avatar, capture, options->settings, [&](double part, const std::string& what) { progress.update(part, what); }, ranks);
      make_folder(options->out);
      write_file_safely(options->out / "tradeoff.csv", tradeoff_csv(tradeoff));
      write_file_safely(options->out / "tradeoff.svg", to_svg(tradeoff_plot(tradeoff)));
      write_file_safely(options->out / "report.html", to_html(tradeoff_report(tradeoff, avatar, options->avatar.string(), capture)));
      progress.finish((options->out / "report.html").string());
      fmt::print("{}", tradeoff_table(tradeoff));
      if (budget) say_choice("nearest within the time", nearest_within_time(tradeoff, *budget));
      if (max_error) say_choice("fastest within the error", fastest_within_error(tradeoff, *max_error));
      return 0;
    };
  });
}

}  // namespace arah
