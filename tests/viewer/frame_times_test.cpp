#include "viewer/frame_times.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace arah {
namespace {

TEST(FrameTimesTest, PercentilesAreValuesThatWereSeen) {
  std::vector<double> values;
  for (int i = 200; i >= 1; --i) values.push_back(i);
  const TimeStatistics statistics = statistics_of(values);
  EXPECT_EQ(statistics.count, 200u);
  EXPECT_EQ(statistics.median, 100);
  EXPECT_EQ(statistics.percentile_99, 198);
  EXPECT_EQ(statistics.most, 200);
  EXPECT_EQ(statistics_of({7}).percentile_99, 7);
  EXPECT_EQ(statistics_of({}).count, 0u);
}

TEST(FrameTimesTest, TellsThemByStage) {
  FrameTimes times;
  EXPECT_TRUE(times.empty());
  times.add("fast", 1);
  times.add("slow", 10);
  times.add("slow", 30);
  EXPECT_EQ(nlohmann::json::parse(times.json()).at("slow").at("median_ms"), 10);
  const std::string table = times.table();
  EXPECT_LT(table.find("slow"), table.find("fast")) << "largest first\n" << table;
}

}  // namespace
}  // namespace arah
