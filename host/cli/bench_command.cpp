#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>

#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/evaluation/bench.h"
#include "host/evaluation/training_bench.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {

void add_bench_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path json, compare;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("bench", "Measure the kernels, with OpenBLAS as the yardstick, and a training step");
  command->add_option("--json", options->json, "file for the figures, {\"kernels\", \"training_step\"}");
  command->add_option("--compare", options->compare, "an earlier --json file: print what changed, as ratios");
  add_device_option(*command, options->device);
  command->footer("Example: arah bench --json now.json --compare before.json");
  command->callback([options, &run] {
    run = [options] {
      std::string before;
      if (!options->compare.empty()) {
        std::ifstream file(options->compare);
        if (!file) throw InputError(options->compare.string(), "", "a file that arah bench --json wrote", "no such file");
        before.assign(std::istreambuf_iterator<char>(file), {});
      }
      Device device(options->device);
      Progress progress("bench", 1.0, "");
      progress.say("kernels");
      const BenchResult kernels = run_bench(
          device, {}, [&](const BenchLine& line) { progress.say(fmt::format("  {} {}", line.name, line.shape)); });
      progress.say("training step");
      const TrainingBench training = run_training_bench(device);
      progress.finish();
      fmt::print("{}\n{}", bench_table(kernels), training_bench_table(training));
      const nlohmann::ordered_json json{{"kernels", nlohmann::ordered_json::parse(bench_json(kernels))},
                                        {"training_step", nlohmann::ordered_json::parse(training_bench_json(training))}};
      if (!options->json.empty()) write_file_safely(options->json, json.dump(1) + "\n");
      if (!before.empty()) fmt::print("\n{}", bench_comparison(before, options->compare.string(), json.dump()));
      return 0;
    };
  });
}

}  // namespace arah
