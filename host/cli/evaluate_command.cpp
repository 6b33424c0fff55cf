#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/cli/rank_devices.h"
#include "host/evaluation/evaluate.h"
#include "host/file_writing.h"

namespace arah {

void add_evaluate_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path avatar, capture, out;
    EvaluationSettings settings;
    std::string protocol;
    bool surface = false;
    SurfaceSettings surface_settings;
    std::vector<double> ground;
    QualityOptions quality;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  EvaluationSettings& settings = options->settings;
  CLI::App* command = program.add_subcommand("evaluate", "Compare an avatar's renderings with a capture's photographs");
  command->add_option("AVATAR", options->avatar, kAvatarHelp)->required();
  command->add_option("CAPTURE", options->capture, "the capture's folder")->required();
  command->add_option("-o,--out", options->out, "folder for metrics.json and report.html")->required();
  command->add_option("--protocol", options->protocol, "novel-view, novel-pose, training-pose or out-of-distribution: the paper's choice of split, cameras and frames; what else is stated here goes before it")->check(CLI::IsMember(evaluation_protocols()));
  CLI::Option* split = command->add_option("--split", settings.split, "whose frames: train, novel, ood, ...")->capture_default_str();
  CLI::Option* cameras = command->add_option("--cameras", settings.cameras, "training, held-out, all, or names with commas between")
      ->capture_default_str();
  CLI::Option* every = command->add_option("--every", settings.every, "take every so-many-th frame that has pictures")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--size", settings.size, "columns that photographs are reduced to (default: as they are)")
      ->check(CLI::Range(1, 8192));
  command->add_flag("--surface", options->surface, "also how far the avatar's surface is from the capture's true one (meshes/), where it has one");
  command->add_option("--surface-cell", options->surface_settings.cell, "metres: the avatar's mesh is cut by cubes of this edge")->check(CLI::Range(0.001, 0.1))->capture_default_str();
  command->add_flag("--surface-largest", options->surface_settings.largest_part, "of the avatar's mesh the largest connected part alone (else without parts of less than 1 % of it)");
  command->add_option("--ground", options->ground, "a,b,c,d: surfaces are compared where a x + b y + c z + d is not negative, x, y, z in the world; 0,0,1,-0.01 leaves out what lies less than 1 cm above z = 0")->delimiter(',')->expected(4);
  add_lpips_option(*command, settings.lpips);
  add_quality_options(*command, options->quality);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "PSNR is taken over the pixels of the posed template's projected box; metrics.json states the protocol.\n"
      "Example: arah evaluate run capture -o evaluation --protocol novel-pose\n"
      "Example: arah evaluate run capture -o evaluation --split novel --every 2\n"
      "         mpirun -n 4 arah evaluate run capture -o evaluation   (each picture on the rank that is free; surfaces on the first one)");
  command->callback([options, split, cameras, every, &run] {
    if (!options->protocol.empty()) {
      EvaluationSettings& chosen = options->settings;
      const EvaluationSettings protocol = evaluation_protocol(options->protocol);
      if (split->empty()) chosen.split = protocol.split;
      if (cameras->empty()) chosen.cameras = protocol.cameras;
      if (every->empty()) chosen.every = protocol.every;
      // Under its name only as it is.
      if (chosen.split == protocol.split && chosen.cameras == protocol.cameras && chosen.every == protocol.every && chosen.size == 0) chosen.protocol = protocol.protocol;
    }
    run = [options] {
      const Avatar avatar = load_avatar(avatar_file(options->avatar));
      const Capture capture = open_capture(options->capture);
      options->settings.render = options->quality.settings(avatar);
      const Ranks& ranks = Ranks::of_process();
      Device device(device_of_rank(options->device, ranks));
      const std::string unequal = unequal_devices(ranks, device);
      if (!ranks.first()) {
        evaluate(device, avatar, capture, options->settings, {}, ranks);
        return 0;
      }
      Progress progress("evaluate", 1.0, "");
      if (!unequal.empty()) progress.say(unequal);
      Evaluation result = evaluate(device, avatar, capture, options->settings, [&](double part) {
        progress.update(part);
        return true;
      }, ranks);
      if (options->surface) {
        SurfaceSettings& compared = options->surface_settings;
        if (!options->ground.empty()) compared.ground = glm::dvec4(options->ground[0], options->ground[1], options->ground[2], options->ground[3]);
        result.surface = surface_errors(device, avatar, capture, options->settings.split, compared);
        result.surface_settings = compared;
      }
      make_folder(options->out);
      const std::string name = options->avatar.string(), figures = describe(result);
      for (const std::string& line : warnings_of(result, name)) progress.say(line);
      write_file_safely(options->out / "metrics.json", evaluation_json(result, avatar, name, capture, device));
      write_file_safely(options->out / "report.html",
                        to_html(evaluation_report({result}, avatar, name, capture, device)));
      progress.finish((options->out / "report.html").string());
      fmt::print("{}\n", figures);
      return 0;
    };
  });
}

}  // namespace arah
