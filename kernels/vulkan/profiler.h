// Time, arithmetic and traffic of launches since the start or the last reset: by name, by shader and by stage of the work.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>

namespace arah {

// What one launch does, as the kernel's own formula states it: the numerator of GFLOP/s and GB/s. Where it depends on the data,
// what is certain.
struct Cost {
  double flops = 0;  // in float32; a multiply-add is two
  double bytes = 0;  // between the device and its memory, each number that is read or written once
};
// Bytes of a table in which rows look up `looked_up` bytes, many of them the same: from memory each comes once at most.
inline double table_bytes(double looked_up, double table) { return std::min(looked_up, table); }

struct LaunchStatistics {
  uint64_t calls = 0;
  double milliseconds = 0;
  Cost cost;
};

class Profiler {
 public:
  bool enabled = false;

  // One launch: its name, its shader "<area>/<stem>", the stage of the work that it belongs to (Commands::stage).
  void add(const std::string& name, const std::string& shader, const std::string& stage, double milliseconds, const Cost& cost);
  void reset() { launches_.clear(), shaders_.clear(), stages_.clear(); }
  const std::map<std::string, LaunchStatistics>& launches() const { return launches_; }
  const std::map<std::string, LaunchStatistics>& shaders() const { return shaders_; }
  const std::map<std::string, LaunchStatistics>& stages() const { return stages_; }  // "": launches outside of any
  double total_milliseconds() const;
  // calls, ms, GFLOP/s, GB/s, share of the whole; slowest first.
  std::string table() const;

 private:
  std::map<std::string, LaunchStatistics> launches_, shaders_, stages_;
};

}  // namespace arah
