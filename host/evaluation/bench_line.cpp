#include "host/evaluation/bench_line.h"

#include <algorithm>
#include <map>

namespace arah {

BenchLine bench_line(const std::string& name, const std::string& shape, const LaunchStatistics& statistics) {
  const double seconds = std::max(statistics.milliseconds, 1e-6) * 1e-3;
  return {name, shape, statistics.calls, statistics.milliseconds, statistics.cost.flops / seconds * 1e-9, statistics.cost.bytes / seconds * 1e-9, 0};
}

std::vector<BenchLine> median_lines(const std::vector<Profiler>& profiles, ProfileEntries entries, const std::string& shape) {
  std::map<std::string, std::vector<const LaunchStatistics*>> times;
  for (const Profiler& profile : profiles)
    for (const auto& [name, statistics] : (profile.*entries)()) times[name].push_back(&statistics);
  std::vector<BenchLine> lines;
  for (auto& [name, all] : times) {
    std::stable_sort(all.begin(), all.end(), [](const auto* a, const auto* b) { return a->milliseconds < b->milliseconds; });
    lines.push_back(bench_line(name, shape, *all[all.size() / 2]));
  }
  return lines;
}

}  // namespace arah
