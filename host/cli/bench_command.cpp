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
#include "host/evaluation/rank_bench.h"
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

int bench_ranks(const std::filesystem::path& json, const std::filesystem::path& plots, const DeviceOptions& options, bool quick) {
  const Ranks& ranks = Ranks::of_process();
  // What one rank alone sends is not known, and so no model of more.
  if (!plots.empty() && ranks.count() == 1) throw InputError("--plots", "", "two ranks or more", "one", "Start it as mpirun -n 2 arah bench --mpi --plots FOLDER.");
  Device device(device_of_rank(options, ranks));
  RankBenchSettings settings;
  if (quick) settings.warm_up = 1, settings.steps = 2, settings.with_paper = false;
  if (!ranks.first()) {
    run_rank_bench(device, ranks, settings);
    return 0;
  }
  Progress progress("bench", 1.0, "");
  const RankBench bench = run_rank_bench(device, ranks, settings, [&](const std::string& what) { progress.say(what); });
  progress.finish();
  fmt::print("{}", rank_bench_table(bench));
  if (!json.empty()) write_file_safely(json, rank_bench_json(bench));
  if (plots.empty()) return 0;
  make_folder(plots);
  for (const RankBenchWork& work : bench.works) write_file_safely(plots / fmt::format("ranks-{}.svg", work.name), to_svg(scaling_plot(bench, work)));
  return 0;
}

}  // namespace

void add_bench_command(CLI::App& program, Run& run) {
  struct Options {
    std::filesystem::path json, compare, avatar, plots;
    bool quick = false, ranks = false;
    DeviceOptions device = DeviceOptions::from_environment();
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("bench", "Measure every kernel and stage against the device's own peak, and the linear layer beside OpenBLAS");
  CLI::Option* avatar = command->add_option("--avatar", options->avatar, "instead: the two root searches of this avatar alone, on 16,384 rays and on 65,536 points at its surface");
  CLI::Option* json_file = command->add_option("--json", options->json, "file for the figures, {\"kernels\", \"works\"}");
  CLI::Option* compare = command->add_option("--compare", options->compare, "an earlier --json file: print what changed, as ratios");
  command->add_flag("--quick", options->quick, "one small repetition of everything: to see that it runs, not how fast");
  CLI::Option* of_ranks = command->add_flag("--mpi", options->ranks, "instead: training steps of the ranks that mpirun started, of the first 1, 2, ... of them: compute, exchange, and how much of it happens beside the way back");
  command->add_option("--plots", options->plots, "with --mpi, a folder for ranks-tiny.svg and ranks-paper.svg: what more ranks are worth, measured and by a model")->needs(of_ranks);
  of_ranks->excludes(avatar)->excludes(compare);
  avatar->excludes(json_file)->excludes(compare);
  add_device_option(*command, options->device);
  command->footer(
      "Example: arah bench --json now.json --compare before.json\n"
      "         mpirun -n 4 arah bench --mpi --plots .");
  command->callback([options, &run] {
    run = [options] {
      if (options->ranks) return bench_ranks(options->json, options->plots, options->device, options->quick);
      if (Ranks::of_process().count() > 1) throw InputError("arah bench", "", "--mpi under mpirun", "a bench of one device", "Without --mpi call it without mpirun.");
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
