#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "host/avatar/avatar_file.h"
#include "host/avatar/spec_choice.h"
#include "host/capture/inspect.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/evaluation/capture_page.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "host/training/bad_values.h"

namespace arah {
namespace {

// What training would model for this capture, one line a part.
std::string choice_text(const Capture& capture, const std::string& preset) {
  std::string text = fmt::format("an avatar of the preset {} would have:\n", preset);
  try {
    for (const std::string& reason : choose_spec(preset, capture_facts(capture)).reasons) text += "  " + reason + "\n";
  } catch (const InputError& error) {
    // A capture for evaluation alone is worth inspecting too.
    text = fmt::format("warning: no avatar can be trained from it: {}\n", error.what());
  }
  return text;
}

}  // namespace

void add_inspect_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path path, out;
    std::string preset = "tiny";
    int pictures = 6;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("inspect", "Say what a capture, motion, template or avatar holds, and what looks wrong");
  command
      ->add_option("PATH", options->path,
                   "a capture's folder, a motion (.json, .bvh, .npz, .pkl, .glb, .gltf) or cameras.json, a template (.glb, .gltf), an avatar (.safetensors) or the failure_*.safetensors of a training that stopped on bad values")
      ->required();
  command->add_option("--preset", options->preset, "sizes that the choice of an avatar's parts starts from")
      ->check(CLI::IsMember(preset_names()))
      ->capture_default_str();
  command->add_option("--pictures", options->pictures, "pictures to read of each camera and split of a capture")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command->add_option("-o,--out", options->out,
                      "of a capture: folder for inspect.html, a page with plans of cameras and motion, the template and the masks over the photographs, and what looks wrong");
  command->footer("Example: arah inspect capture --preset paper\n         arah inspect capture -o inspection");
  command->callback([options, &run] {
    run = [options] {
      std::string report;
      if (std::filesystem::is_directory(options->path)) {
        const Capture capture = open_capture(options->path);
        CaptureInspection found = examine_capture(capture, options->pictures);
        found.report += choice_text(capture, options->preset);
        report = found.report;
        if (!options->out.empty()) {
          make_folder(options->out);
          const std::filesystem::path page = options->out / "inspect.html";
          write_file_safely(page, capture_page(capture, found));
          report += page.string() + "\n";
        }
      } else if (!options->out.empty()) {
        throw InputError("--out", "", "a capture's folder to draw", "'" + options->path.string() + "'");
      } else if (options->path.extension() == ".safetensors") {
        const SafetensorsFile file = read_safetensors(options->path);
        if (const auto bad = bad_values_of(file)) report = bad_values_report(*bad);
        report += describe(avatar_from_tensors(file));
      } else {
        report = inspect(options->path);
      }
      fmt::print("{}", report);
      return 0;
    };
  });
}

}  // namespace arah
