// The subcommands of the program: one file each, named <word>_command.cpp. To add one, write that file, declare its
// function here and list it in main.cpp.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace arah {

// The work that the command line asked for. It returns the exit code: 0 done, 1 the work failed. It may throw
// InputError (the call was wrong: exit code 2) or any other std::exception (the work failed: 1); main() prints the text
// as one line.
using Run = std::function<int()>;

// Each adds its subcommand to `program`: options, checks, --help with an example in the footer. When the subcommand is
// what was called, parsing sets `run`, which must own or share all that it needs.
void add_ablate_command(CLI::App& program, Run& run);
void add_animate_command(CLI::App& program, Run& run);
void add_bench_command(CLI::App& program, Run& run);
void add_curve_command(CLI::App& program, Run& run);
void add_demo_command(CLI::App& program, Run& run);
void add_devices_command(CLI::App& program, Run& run);
void add_evaluate_command(CLI::App& program, Run& run);
void add_export_command(CLI::App& program, Run& run);
void add_import_command(CLI::App& program, Run& run);
void add_inspect_command(CLI::App& program, Run& run);
void add_pretrain_command(CLI::App& program, Run& run);
void add_render_command(CLI::App& program, Run& run);
void add_synth_command(CLI::App& program, Run& run);
void add_tradeoff_command(CLI::App& program, Run& run);
void add_train_command(CLI::App& program, Run& run);

}  // namespace arah
