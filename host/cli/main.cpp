#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>

#include "host/cli/command.h"
#include "host/cli/outcome.h"
#include "host/version.h"

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
  return arah::outcome_of("arah", run);
}
