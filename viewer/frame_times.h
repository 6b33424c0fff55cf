// How long things took, as medians and 99th percentiles: what --measure prints.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace arah {

struct TimeStatistics {
  std::size_t count = 0;
  double median = 0, percentile_99 = 0, most = 0;  // the unit of what was added
};
// Percentiles are values that were seen: the least that no less than half (99 %) of them do not exceed. Zeros for none.
TimeStatistics statistics_of(std::vector<double> values);

class FrameTimes {
 public:
  void add(const std::string& stage, double milliseconds) { stages_[stage].push_back(milliseconds); }
  bool empty() const { return stages_.empty(); }
  std::map<std::string, TimeStatistics> statistics() const;
  // A line a stage, largest median first: "  stage   median   99 %   most   count", milliseconds.
  std::string table() const;
  // {"stage": {"count": 3, "median_ms": 1.5, "percentile_99_ms": 2, "most_ms": 2}, …}
  std::string json() const;

 private:
  std::map<std::string, std::vector<double>> stages_;
};

}  // namespace arah
