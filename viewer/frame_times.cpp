#include "viewer/frame_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace arah {

TimeStatistics statistics_of(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double part) { return values[static_cast<size_t>(std::ceil(part * static_cast<double>(values.size()))) - 1]; };
  return {values.size(), at(0.5), at(0.99), values.back()};
}

std::map<std::string, TimeStatistics> FrameTimes::statistics() const {
  std::map<std::string, TimeStatistics> all;
  for (const auto& [stage, values] : stages_) all[stage] = statistics_of(values);
  return all;
}

std::string FrameTimes::table() const {
  const auto all = statistics();
  std::vector<std::pair<std::string, TimeStatistics>> rows(all.begin(), all.end());
  std::stable_sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.second.median > b.second.median; });
  std::string text = fmt::format("{:<36} {:>10} {:>10} {:>10} {:>8}\n", "milliseconds", "median", "99 %", "most", "count");
  for (const auto& [stage, row] : rows) text += fmt::format("{:<36} {:>10.2f} {:>10.2f} {:>10.2f} {:>8}\n", stage, row.median, row.percentile_99, row.most, row.count);
  return text;
}

std::string FrameTimes::json() const {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const auto& [stage, row] : statistics()) json[stage] = {{"count", row.count}, {"median_ms", row.median}, {"percentile_99_ms", row.percentile_99}, {"most_ms", row.most}};
  return json.dump();
}

}  // namespace arah
