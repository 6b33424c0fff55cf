#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <new>
#include <string>

#include "host/cli/command.h"
#include "host/input_error.h"
#include "host/version.h"
#include "kernels/vulkan/device.h"

namespace {

constexpr int kFailed = 1;     // the work failed
constexpr int kWrongCall = 2;  // the call was wrong: options, files, settings, too low a ceiling

// One line on standard error, whatever the text.
int report(const std::string& text, int code) {
  std::string line;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\n') {
      line.push_back(text[i]);
    } else {
      while (i + 1 < text.size() && (text[i + 1] == ' ' || text[i + 1] == '\n')) ++i;
      line += "; ";
    }
  }
  std::fputs(fmt::format("arah: {}\n", line).c_str(), stderr);  // fmt::print would throw where the terminal is gone
  return code;
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
    return report(fmt::format("{}. See: arah{} --help", error.what(), word), kWrongCall);
  }
  try {
    return run();
  } catch (const arah::InputError& error) {
    return report(error.what(), kWrongCall);
  } catch (const arah::MemoryCeilingError& error) {
    return report(error.what(), kWrongCall);
  } catch (const std::bad_alloc&) {
    return report("the machine's memory is used up. Use fewer rays a chunk, a smaller picture, or --memory.", kFailed);
  } catch (const std::exception& error) {
    return report(error.what(), kFailed);
  }
}
