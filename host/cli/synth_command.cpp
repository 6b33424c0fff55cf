#include <CLI/CLI.hpp>
#include <memory>

#include "host/capture/synthetic_capture.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"

namespace arah {

void add_synth_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path out;
    SyntheticSettings settings;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("synth", "Make a synthetic capture: pictures, cameras, poses and the truth");
  command->add_option("OUT", options->out, "folder to write; an earlier synthetic capture there is replaced")
      ->required();
  SyntheticSettings& settings = options->settings;
  command->add_option("--frames", settings.frames, "frames of the training motion")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  command->add_option("--size", settings.size, "width and height of the pictures, pixels")
      ->check(CLI::Range(16, 4096))
      ->capture_default_str();
  command
      ->add_option("--seed", settings.seed, "figure, colours, motion and cameras; the same seed gives the same bytes")
      ->capture_default_str();
  command->add_option("--body-seed", settings.body_seed,
                      "another build and other clothes for the built-in figure; 0: its own of old")
      ->capture_default_str();
  command->add_option("--rig", settings.rig, "a skinned glTF body to dress instead of the built-in figure")
      ->check(CLI::ExistingFile);
  command->footer("Example: arah synth capture --frames 60 --size 256 --seed 3");
  command->callback([options, &run] {
    run = [options] {
      Progress progress("synth", 1.0, "");
      write_synthetic_capture(options->out, options->settings,
                              [&](double fraction, const std::string& what) { progress.update(fraction, what); });
      progress.finish(options->out.string());
      return 0;
    };
  });
}

}  // namespace arah
