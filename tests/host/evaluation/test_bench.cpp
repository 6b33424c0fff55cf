#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "host/evaluation/bench.h"
#include "host/input_error.h"
#include "kernels/vulkan/device.h"

namespace arah {
namespace {

BenchSettings products_alone() {
  BenchSettings settings;
  settings.points = 64;
  settings.widths = {16, 8};
  settings.repetitions = 1;
  settings.with_works = false;
  return settings;
}

TEST(Bench, MeasuresTheLinearLayerAgainstSgemmAndKeepsTheProfile) {
  Device device;
  device.profiler().add("before", "area/stem", "", 1, {});
  size_t reported = 0;
  const BenchResult result = run_bench(device, products_alone(), [&](const std::string&) { ++reported; });
  EXPECT_GE(reported, result.lines.size());
  EXPECT_EQ(device.profiler().launches().count("before"), 1u);
  EXPECT_EQ(device.profiler().launches().size(), 1u);
  EXPECT_FALSE(device.profiler().enabled);

  const auto json = nlohmann::json::parse(bench_json(result)).at("kernels");
  EXPECT_EQ(json.at("device"), device.report().name);
  size_t products = 0;
  for (const auto& line : json.at("lines")) {
    EXPECT_GT(line.at("milliseconds").get<double>(), 0) << line;
    ++products;
    EXPECT_NEAR(line.at("share_of_sgemm").get<double>(),
                line.at("gflops").get<double>() / line.at("sgemm_gflops").get<double>(), 1e-9)
        << line;
  }
  EXPECT_EQ(products, 6u) << "three products at two widths";
  EXPECT_NE(bench_table(result).find("linear weight gradient"), std::string::npos);
}

TEST(Bench, MeasuresWhatTheDeviceCanDo) {
  Device device;
  const DevicePeak peak = measure_device_peak(device, 2);
  std::printf("  %.1f GFLOP/s, %.1f GB/s\n", peak.gflops, peak.gigabytes);
  EXPECT_GT(peak.gflops, 1);
  EXPECT_GT(peak.gigabytes, 0.5);
  const DevicePeak better = best_peak({2, 1, 4, 3}, {1, 5, 6, 7});
  EXPECT_EQ(better.gflops, 2);
  EXPECT_EQ(better.gflops_milliseconds, 4);
  EXPECT_EQ(better.gigabytes, 5);
  EXPECT_EQ(better.gigabytes_milliseconds, 7);
}

TEST(Bench, TakesOfEachEntryTheProfileWithTheMedianTime) {
  std::vector<Profiler> profiles(3);
  for (size_t i = 0; i < 3; ++i) {
    profiles[i].add("a", "area/stem", "rays", i == 1 ? 9 : 1 + double(i), {4e6, 8e6});
    profiles[i].add("a", "area/stem", "rays", 1, {2e6, 4e6});
  }
  profiles[2].add("sometimes", "area/other", "rays", 5, {});
  const std::vector<BenchLine> lines = median_lines(profiles, &Profiler::shaders, "here");
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].name, "area/other");
  EXPECT_EQ(lines[0].milliseconds, 5);
  EXPECT_EQ(lines[0].gflops, 0);
  EXPECT_EQ(lines[1].shape, "here");
  EXPECT_EQ(lines[1].calls, 2u);
  EXPECT_DOUBLE_EQ(lines[1].milliseconds, 4) << "of 2, 10 and 4";
  EXPECT_DOUBLE_EQ(lines[1].gflops, 1.5);
  EXPECT_DOUBLE_EQ(lines[1].gigabytes, 3);
  EXPECT_EQ(median_lines(profiles, &Profiler::stages, "").size(), 1u);
}

TEST(Bench, SharesAreOfThePeakAndTheLargerOneBounds) {
  BenchResult result;
  result.peak = {100, 10, 1, 1};
  result.shaders = {{"rays/heavy", "here", 1, 2, 50, 1, 0}, {"rays/light", "here", 1, 2, 0, 4, 0}};
  const std::string table = bench_table(result);
  const auto line = [&](const std::string& name) { return table.substr(table.find(name), table.find('\n', table.find(name)) - table.find(name)); };
  EXPECT_THAT(line("heavy"), testing::AllOf(testing::HasSubstr("50.0 %"), testing::HasSubstr("10.0 %"), testing::HasSubstr("arithmetic")));
  EXPECT_THAT(line("light"), testing::AllOf(testing::HasSubstr("40.0 %"), testing::HasSubstr("memory")));
  const auto shaders = nlohmann::json::parse(bench_json(result)).at("kernels").at("shaders");
  EXPECT_DOUBLE_EQ(shaders[0].at("share_of_peak_arithmetic").get<double>(), 0.5);
  EXPECT_DOUBLE_EQ(shaders[0].at("share_of_peak_bandwidth").get<double>(), 0.1);
  EXPECT_FALSE(shaders[1].contains("share_of_peak_arithmetic")) << "it counts no operations";
}

// What files of version 0.1 hold, against what files hold now.
TEST(Bench, ComparesWithAFileThatKnowsNoPeak) {
  BenchResult result;
  result.peak = {100, 10, 1, 1};
  result.lines = {{"linear forward", "64 x 8 x 8", 1, 1.5, 1, 1, 2}};
  result.shaders = {{"rays/generate", "picture, paper", 2, 3, 1, 1, 0}};
  result.works = {{"training step", "", 40, 41, 8, {{"rays", "training step", 3, 6, 1, 1, 0}}, {{"adam", "", 4, 4, 1, 1, 0}}, {}}};
  const std::string old = R"({"kernels": {"lines": [{"name": "linear forward", "shape": "64 x 8 x 8", "calls": 1, "milliseconds": 3}]},
    "training_step": {"median_milliseconds": 50, "stages": [{"name": "adam", "calls": 48, "milliseconds": 24}]}})";
  const std::string text = bench_comparison(old, "before.json", bench_json(result));
  const auto line = [&](const std::string& name) { return text.substr(text.find(name), text.find('\n', text.find(name)) - text.find(name)); };
  EXPECT_THAT(line("linear forward, 64 x 8 x 8"), testing::HasSubstr("0.50"));
  EXPECT_THAT(line("training step  "), testing::HasSubstr("0.80"));
  EXPECT_THAT(line("step: adam"), testing::AllOf(testing::HasSubstr("0.500"), testing::HasSubstr("2.00")));
  EXPECT_THAT(line("rays/generate, picture, paper"), testing::HasSubstr("new"));
  EXPECT_THAT(line("training step: rays"), testing::AllOf(testing::HasSubstr("6.000"), testing::HasSubstr("new")));
}

TEST(Bench, ComparesTwoFilesLineByLine) {
  const auto file = [](double forward, double step, const char* stage) {
    return nlohmann::json{
        {"kernels", {{"lines", {{{"name", "linear forward"}, {"shape", "64 x 8 x 8"}, {"calls", 1}, {"milliseconds", forward}}}}}},
        {"training_step", {{"median_milliseconds", step}, {"stages", {{{"name", stage}, {"calls", 4}, {"milliseconds", 8.0}}}}}}}
        .dump();
  };
  const std::string text = bench_comparison(file(3, 50, "left"), "before.json", file(1.5, 40, "added"));
  const auto line = [&](const std::string& name) {
    const size_t at = text.find(name);
    return at == std::string::npos ? std::string() : text.substr(at, text.find('\n', at) - at);
  };
  EXPECT_NE(line("linear forward, 64 x 8 x 8").find("0.50"), std::string::npos) << text;
  EXPECT_NE(line("training step").find("0.80"), std::string::npos) << text;
  EXPECT_NE(line("step: added").find("2.000"), std::string::npos) << text;
  EXPECT_NE(line("step: added").find("new"), std::string::npos) << text;
  EXPECT_NE(line("step: left").find("gone"), std::string::npos) << text;
  EXPECT_THROW(bench_comparison("{}", "before.json", file(1, 1, "a")), InputError);
  EXPECT_THROW(bench_comparison("no JSON", "before.json", file(1, 1, "a")), InputError);
}

TEST(Bench, RefusesSettingsOutOfRange) {
  Device device;
  const auto refused = [&](const auto& change) {
    BenchSettings settings;
    change(settings);
    EXPECT_THROW(run_bench(device, settings), InputError);
  };
  refused([](BenchSettings& s) { s.points = 100; });
  refused([](BenchSettings& s) { s.points = 1 << 17; });
  refused([](BenchSettings& s) { s.widths = {}; });
  refused([](BenchSettings& s) { s.widths = {12}; });
  refused([](BenchSettings& s) { s.repetitions = 0; });
}

}  // namespace
}  // namespace arah
