#include "host/cli/training_progress.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <sstream>

#include "host/cli/shader_progress.h"

namespace arah {
namespace {

constexpr int kMemoryLines = 3;

// "memory: 214.3 MB, of which 94.2 MB training: first moments, 47.1 MB ..."
std::string memory_text(const Device& device) {
  std::istringstream table(device.memory_table());
  std::string text =
      fmt::format("memory: {:.1f} MB on the device", static_cast<double>(device.allocated_bytes()) * 1e-6);
  if (device.memory_ceiling()) text += fmt::format(" of {:.1f}", static_cast<double>(device.memory_ceiling()) * 1e-6);
  std::string line;
  for (int i = 0; i < kMemoryLines && std::getline(table, line); ++i) {
    double megabytes = 0;
    std::string unit, name;
    std::istringstream fields(line);
    fields >> megabytes >> unit >> std::ws;
    std::getline(fields, name);
    if (name != "in all") text += fmt::format("{}{:.1f} MB '{}'", i == 0 ? "; the largest: " : ", ", megabytes, name);
  }
  return text;
}

}  // namespace

void TrainingProgress::show(const RunEvent& event) {
  switch (event.kind) {
    case RunEvent::Kind::fitting:
      if (!fit_) fit_.emplace("fit to the template", 1.0, "");
      fit_->update(event.fraction);
      break;
    case RunEvent::Kind::fitted:
      if (!fit_) fit_.emplace("fit to the template", 1.0, "");
      fit_->finish(fmt::format("surface within {:.2f} mm, skinning weights within {:.4f}", 1e3 * event.fit.sdf_error,
                               event.fit.skinning_error));
      if (!event.prior.empty()) write_text(stderr, event.prior + "\n");
      break;
    case RunEvent::Kind::resumed:
      for (const std::string& damaged : event.damaged) write_text(stderr, fmt::format("passed over: {}\n", damaged));
      write_text(stderr, fmt::format("resumed from {} at step {}\n", event.file.string(), event.step.step));
      break;
    case RunEvent::Kind::ready:
      write_text(stderr, fmt::format("{}; {}\n", memory_text(device_), event.passes > 1 ? fmt::format("a step's rays in {} passes", event.passes) : "a step's rays together"));
      if (!event.shares.empty()) write_text(stderr, fmt::format("shares of the ranks in these: {}\n", fmt::join(event.shares, ",")));
      steps_.emplace(fmt::format("train for {}", budget_), 1.0, "", event.fraction);
      break;
    case RunEvent::Kind::step: {
      last_ = event.step;
      const std::string rate =
          event.seconds_per_step > 0 ? fmt::format("  {:.1f} steps/s", 1 / event.seconds_per_step) : "";
      steps_->update(event.fraction,
                     fmt::format("step {}{}  loss {:.4f}  colour {:.4f}", last_.step, rate, last_.total, last_.color));
      break;
    }
    case RunEvent::Kind::skipped:
      steps_->say(fmt::format("{}; the step was skipped, {} so far", describe(*event.step.bad), event.step.skipped));
      break;
    case RunEvent::Kind::checkpoint:
      steps_->say(fmt::format("checkpoint of step {} written", event.step.step));
      break;
  }
}

void TrainingProgress::finish(const RunResult& result) {
  if (steps_)
    steps_->finish(fmt::format("{} steps{}  loss {:.4f}  {}  {}", result.steps, result.skipped ? fmt::format(", of which {} were skipped for bad values", result.skipped) : "", last_.total, shaders_text(device_), result.avatar.string()));
  if (!result.poses.empty()) write_text(stderr, result.poses + "\n");
}

}  // namespace arah
