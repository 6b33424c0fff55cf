#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <fstream>
#include <iterator>
#include <memory>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/evaluation/bench.h"
#include "host/evaluation/search_bench.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {

namespace {

int bench_searches(const std::filesystem::path& path, const DeviceOptions& options, bool quick) {
  const Avatar avatar = load_avatar(avatar_file(path));
  Device device(options);
  Progress progress("bench", 1.0, "");
  const std::vector<SearchBench> searches = run_search_bench(device, avatar, quick ? SearchBenchSettings{1000, 1000, 1} : SearchBenchSettings{}, [&](double done) { progress.update(done); });
  progress.finish();
  fmt::print("{} ({})\n{}", device.report().name, device.report().driver, search_bench_table(searches));
  return 0;
}

}  // namespace

void add_bench_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path json, compare, avatar;
    bool quick = false;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("bench", "Measure every kernel and stage against the device's own peak, and the linear layer beside OpenBLAS");
  CLI::Option* avatar = command->add_option("--avatar", options->avatar, "instead: the two root searches of this avatar alone, on 16,384 rays and on 65,536 points at its surface");
  CLI::Option* json_file = command->add_option("--json", options->json, "file for the figures, {\"kernels\", \"works\"}");
  CLI::Option* compare = command->add_option("--compare", options->compare, "an earlier --json file: print what changed, as ratios");
  command->add_flag("--quick", options->quick, "one small repetition of everything: to see that it runs, not how fast");
  avatar->excludes(json_file)->excludes(compare);
  add_device_option(*command, options->device);
  command->footer("Example: arah bench --json now.json --compare before.json");
  command->callback([options, &run] {
    run = [options] {
      if (!options->avatar.empty()) return bench_searches(options->avatar, options->device, options->quick);
      std::string before;
      if (!options->compare.empty()) {
        std::ifstream file(options->compare);
        if (!file) throw InputError(options->compare.string(), "", "a file that arah bench --json wrote", "no such file");
        before.assign(std::istreambuf_iterator<char>(file), {});
      }
      Device device(options->device);
      Progress progress("bench", 1.0, "");
      const BenchResult result = run_bench(device, options->quick ? quick_bench_settings() : BenchSettings{}, [&](const std::string& what) { progress.say(what); });
      progress.finish();
      const std::string json = bench_json(result);
      fmt::print("{}", bench_table(result));
      if (!options->json.empty()) write_file_safely(options->json, json);
      if (!before.empty()) fmt::print("\n{}", bench_comparison(before, options->compare.string(), json));
      return 0;
    };
  });
}

}  // namespace arah
