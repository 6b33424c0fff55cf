#include <CLI/CLI.hpp>

#include "host/cli/arguments.h"
#include "host/cli/outcome.h"
#include "host/version.h"
#include "viewer/viewer.h"

int main(int argc, char** argv) {
  CLI::App program("A trained person in a window: turn it, pose it, play motions, see what the model knows.", "arah-view");
  arah::ViewerOptions options;
  program.set_version_flag("--version", std::string("arah-view ") + arah::kVersion);
  program.add_option("AVATAR", options.avatar, std::string(arah::kAvatarHelp) + ", whose checkpoints are followed")->required();
  arah::add_motion_options(program, options.motion);
  program.add_option("--quality", options.quality, "preset that a picture at rest is refined to (default: the state's; balanced)")->check(CLI::IsMember(arah::render_presets()));
  program.add_option("--state", options.state, "a file that ctrl + S saves what is seen to, and that is opened again where it is there");
  program.add_option("--out", options.out, "folder for screenshots, videos and meshes")->check(CLI::ExistingDirectory)->capture_default_str();
  program.add_option("--width", options.width, "of the window (default: the state's; 1120)")->check(CLI::Range(320, 8192));
  program.add_option("--height", options.height, "of the window (default: the state's; 720)")->check(CLI::Range(240, 8192));
  program.add_option("--measure", options.measure, "turn and play by itself for so long, print median and 99th percentile of each stage, and end; seconds (\"20\" or \"20s\")")
      ->transform([](std::string text) {
        if (!text.empty() && text.back() == 's') text.pop_back();
        return text;
      })
      ->check(CLI::Range(1.0, 3600.0));
  program.add_flag("--json", options.events, "tell what happens in lines of JSON on standard output");
  arah::add_device_option(program, options.device);
  program.footer("Example: arah-view run --capture capture\nIn the window: drag to turn, right drag to move, wheel to come nearer, ? for all keys.");
  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return program.exit(error);
    return arah::report_error("arah-view", std::string(error.what()) + ". See: arah-view --help", arah::kWrongCall);
  }
  options.split_given = program.count("--split") > 0;
  return arah::outcome_of("arah-view", [&] { return arah::view(options); });
}
