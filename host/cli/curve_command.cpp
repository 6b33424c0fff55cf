#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/evaluation/learning_curve.h"
#include "host/file_writing.h"

namespace arah {

void add_curve_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path capture, out;
    std::vector<std::filesystem::path> runs;
    LearningCurveSettings settings;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("curve", "Plot quality over minutes of training, of runs that kept avatars on their way");
  command->add_option("CAPTURE", options->capture, "the capture's folder")->required();
  command->add_option("RUN", options->runs, "folders of training runs with --keep")->required();
  command->add_option("-o,--out", options->out, "folder for curve.csv and curve.html")->required();
  command->add_option("--every", options->settings.every, "take every so-many-th frame that has pictures")->check(CLI::Range(1, 1000000))->capture_default_str();
  command->add_option("--size", options->settings.size, "columns that photographs are reduced to (default: as they are)")->check(CLI::Range(1, 8192));
  add_device_option(*command, options->device);
  command->footer("Example: arah train capture -o run --keep 1,2,5,10 && arah curve capture run -o curve --size 256 --every 6");
  command->callback([options, &run] {
    run = [options] {
      const Capture capture = open_capture(options->capture);
      Device device(options->device);
      Progress progress("curve", 1.0, "");
      const std::vector<LearningCurvePoint> points = learning_curve(device, capture, options->runs, options->settings, [&](double part) {
        progress.update(part);
        return true;
      });
      make_folder(options->out);
      const std::string csv = learning_curve_csv(points);
      write_file_safely(options->out / "curve.csv", csv);
      write_file_safely(options->out / "curve.html", learning_curve_page(points, capture, device));
      progress.finish((options->out / "curve.html").string());
      fmt::print("{}", csv);
      return 0;
    };
  });
}

}  // namespace arah
