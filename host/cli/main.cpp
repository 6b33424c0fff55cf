#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <string_view>
#include <thread>

#include "host/cli/command.h"
#include "host/cli/outcome.h"
#include "host/input_error.h"
#include "host/training/ranks.h"
#include "host/version.h"

namespace {

// Whose work several ranks can share.
constexpr std::array<std::string_view, 6> shared_words{"train", "animate", "render", "evaluate", "tradeoff", "bench"};

// The work on one of the ranks that mpirun has started, where it has.
int on_rank(const std::string& word, const arah::Run& run) {
  const arah::Ranks& ranks = arah::Ranks::of_process();
  if (ranks.count() == 1) return run();
  return arah::outcome_of(fmt::format("arah (rank {} of {})", ranks.rank(), ranks.count()), [&] {
    try {
      if (std::find(shared_words.begin(), shared_words.end(), word) == shared_words.end())
        throw arah::InputError(fmt::format("arah {}", word), "", "to be called without mpirun", fmt::format("{} ranks", ranks.count()), fmt::format("Several ranks share the work of: {}.", fmt::join(shared_words, ", ")));
      return run();
    } catch (...) {
      // What is wrong is mostly so on all ranks: the first one says it, and its end is the others'.
      if (!ranks.first()) std::this_thread::sleep_for(std::chrono::seconds(2));
      throw;
    }
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App program("Animatable avatars from video: capture, train, render, measure.", "arah");
  program.set_version_flag("--version", std::string("arah ") + arah::kVersion);
  program.require_subcommand(1);
  program.footer(
      "Example: arah synth capture && arah train capture -o run && arah render run -o front.png\n"
      "`arah WORD --help` says more about each word.");

  arah::Run run;
  for (const auto add :
       {arah::add_demo_command, arah::add_synth_command, arah::add_import_command, arah::add_inspect_command, arah::add_pretrain_command, arah::add_train_command,
        arah::add_render_command, arah::add_animate_command, arah::add_export_command, arah::add_evaluate_command, arah::add_curve_command, arah::add_ablate_command, arah::add_tradeoff_command, arah::add_bench_command, arah::add_devices_command})
    add(program, run);

  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return program.exit(error);  // --help, --version
    const auto called = program.get_subcommands();
    const std::string word = called.empty() ? "" : " " + called.front()->get_name();
    return arah::report_error("arah", fmt::format("{}. See: arah{} --help", error.what(), word), arah::kWrongCall);
  }
  return arah::Ranks::leave(arah::outcome_of("arah", [&] { return on_rank(program.get_subcommands().front()->get_name(), run); }));
}
