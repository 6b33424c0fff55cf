#include "kernels/vulkan/profiler.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

namespace arah {

void Profiler::add(const std::string& name, const std::string& shader, const std::string& stage, double milliseconds, const Cost& cost) {
  for (LaunchStatistics* entry : {&launches_[name], &shaders_[shader], &stages_[stage]}) {
    entry->calls += 1;
    entry->milliseconds += milliseconds;
    entry->cost.flops += cost.flops;
    entry->cost.bytes += cost.bytes;
  }
}

double Profiler::total_milliseconds() const {
  double total = 0;
  for (const auto& [name, entry] : launches_) total += entry.milliseconds;
  return total;
}

std::string Profiler::table() const {
  std::vector<std::pair<std::string, LaunchStatistics>> rows(launches_.begin(), launches_.end());
  std::stable_sort(rows.begin(), rows.end(),
                   [](const auto& a, const auto& b) { return a.second.milliseconds > b.second.milliseconds; });
  const double total = std::max(total_milliseconds(), 1e-9);
  std::string text = fmt::format("{:<44}{:>9}{:>12}{:>10}{:>9}{:>8}\n", "launch", "calls", "ms", "GFLOP/s", "GB/s", "share");
  for (const auto& [name, entry] : rows) {
    const double seconds = std::max(entry.milliseconds, 1e-9) * 1e-3;
    text += fmt::format("{:<44}{:>9}{:>12.3f}{:>10.2f}{:>9.2f}{:>7.1f}%\n", name, entry.calls, entry.milliseconds,
                        entry.cost.flops / seconds * 1e-9, entry.cost.bytes / seconds * 1e-9, 100 * entry.milliseconds / total);
  }
  text += fmt::format("{:<44}{:>9}{:>12.3f}\n", "total", "", total_milliseconds());
  return text;
}

}  // namespace arah
