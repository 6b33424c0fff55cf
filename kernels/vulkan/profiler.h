// Time, arithmetic and traffic of every named launch since the start or the last reset.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace arah {

// What one launch does, as the kernel's own formula states it: the yardstick for GFLOP/s and GB/s.
struct Cost {
  double flops = 0;
  double bytes = 0;
};

struct LaunchStatistics {
  uint64_t calls = 0;
  double milliseconds = 0;
  Cost cost;
};

class Profiler {
 public:
  bool enabled = false;

  void add(const std::string& name, double milliseconds, const Cost& cost);
  void reset() { launches_.clear(); }
  const std::map<std::string, LaunchStatistics>& launches() const { return launches_; }
  double total_milliseconds() const;
  // calls, ms, GFLOP/s, GB/s, share of the whole; slowest first.
  std::string table() const;

 private:
  std::map<std::string, LaunchStatistics> launches_;
};

}  // namespace arah
