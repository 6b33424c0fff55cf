#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "host/body/smpl_file.h"
#include "host/capture/import_capture.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/progress.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* kBodyWord = "smpl";

void print_notes(const std::vector<std::string>& notes) {
  for (const std::string& note : notes) fmt::print("note: {}\n", note);
}

int import_body(const ImportSettings& settings, const std::vector<double>& betas) {
  const SmplBody smpl = read_smpl_body(settings.in, betas);
  write_body_template(settings.out, smpl.body);
  print_notes(smpl.notes);
  return 0;
}

}  // namespace

void add_import_command(CLI::App& program, Run& run) {
  struct Options {
    ImportSettings settings;
    std::vector<double> betas;
    std::vector<std::string> ranges;
    bool list_presets = false;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("import", "Make a capture of a sequence of a public dataset, or a rig of a body model");
  ImportSettings& settings = options->settings;
  command->add_option("LAYOUT", settings.layout, fmt::format("{}: how the sequence lies on disk; {}: a body model", fmt::join(import_layouts(), ", "), kBodyWord));
  command->add_option("IN", settings.in, "the sequence's folder; for smpl the model's file, .npz or .pkl");
  command->add_option("OUT", settings.out, "folder to write; an earlier import there is replaced. For smpl a .glb");
  command->add_option("--body", settings.body,
                      "the body that the sequence's poses are for: a skinned .glb or .gltf with SMPL's joint names, taken as it is, or SMPL's .npz or .pkl, "
                      "which gets the sequence's shape");
  command->add_option("--betas", options->betas, "shape coefficients for smpl, with commas between")->delimiter(',');
  command->add_option("--split", settings.preset, "a published split, see --list-presets (default: the one for the sequence, by the folder's name)");
  command->add_option("--frames", options->ranges,
                      "SPLIT=FIRST:END[:STEP], any number of times, instead of a published split; END is not in it. train is what is learnt from");
  command->add_option("--train-cameras", settings.train_cameras, "names or numbers with commas between; all others are held out")->delimiter(',');
  command->add_option("--size", settings.size, "columns that pictures are reduced to (default: as they are)")->check(CLI::Range(16, 8192));
  command->add_option("--border", settings.border, "pixels on either side of the mask's edge that training leaves out (default: as the split was published, else 0)")
      ->check(CLI::Range(0, 64));
  command->add_flag("--exact-poses", settings.exact_poses, "the poses are exact: training does not refine them");
  command->add_flag("--list-presets", options->list_presets, "print the published splits and do nothing else");
  command->footer("Example: arah import zju-mocap CoreView_377 capture --body subject.glb --size 512");
  command->callback([options, &run] {
    run = [options] {
      if (options->list_presets) {
        fmt::print("{}", preset_table());
        return 0;
      }
      ImportSettings chosen = options->settings;
      if (chosen.layout.empty() || chosen.in.empty() || chosen.out.empty())
        throw InputError("arah import", "", "LAYOUT, IN and OUT", "fewer words", "See: arah import --help");
      if (chosen.layout == kBodyWord) return import_body(chosen, options->betas);
      for (const std::string& text : options->ranges) chosen.ranges.push_back(parse_frame_range(text));
      const Interrupt interrupt;
      std::optional<Progress> progress;
      const ImportReport report = import_capture(chosen, [&](std::size_t done, std::size_t total) {
        if (!progress) progress.emplace("import", static_cast<double>(total), "pictures");
        progress->update(static_cast<double>(done));
        return !interrupt.wanted();
      });
      if (progress) progress->finish(chosen.out.string());
      if (!report.preset.empty()) fmt::print("split {}\n", report.preset);
      print_notes(report.notes);
      return 0;
    };
  });
}

}  // namespace arah
