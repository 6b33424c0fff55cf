#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "host/evaluation/bench.h"
#include "host/input_error.h"
#include "kernels/vulkan/device.h"

namespace arah {
namespace {

TEST(Bench, MeasuresTheLinearLayerAgainstSgemmAndKeepsTheProfile) {
  Device device;
  device.profiler().add("before", 1, {});
  size_t reported = 0;
  const BenchResult result =
      run_bench(device, {.points = 64, .widths = {16, 8}, .repetitions = 1}, [&](const BenchLine&) { ++reported; });
  EXPECT_EQ(reported, result.lines.size());
  EXPECT_EQ(device.profiler().launches().count("before"), 1u);
  EXPECT_EQ(device.profiler().launches().size(), 1u);
  EXPECT_FALSE(device.profiler().enabled);

  const auto json = nlohmann::json::parse(bench_json(result));
  EXPECT_EQ(json.at("device"), device.report().name);
  size_t products = 0;
  for (const auto& line : json.at("lines")) {
    EXPECT_GT(line.at("milliseconds").get<double>(), 0) << line;
    if (!line.contains("share_of_sgemm")) continue;
    ++products;
    EXPECT_NEAR(line.at("share_of_sgemm").get<double>(),
                line.at("gflops").get<double>() / line.at("sgemm_gflops").get<double>(), 1e-9)
        << line;
  }
  EXPECT_EQ(products, 6u) << "three products at two widths";
  EXPECT_NE(bench_table(result).find("linear weight gradient"), std::string::npos);
}

TEST(Bench, TurnsAProfileIntoLinesSlowestFirst) {
  Profiler profiler;
  profiler.add("quick", 1, {2e6, 4e6});
  profiler.add("slow", 3, {});
  profiler.add("quick", 1, {2e6, 4e6});
  const std::vector<BenchLine> lines = profile_lines(profiler);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].name, "slow");
  EXPECT_EQ(lines[1].calls, 2u);
  EXPECT_DOUBLE_EQ(lines[1].gflops, 2);
  EXPECT_DOUBLE_EQ(lines[1].gigabytes, 4);
  EXPECT_EQ(lines[1].share_of_sgemm(), 0);
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
  EXPECT_THROW(run_bench(device, {.points = 100}), InputError);
  EXPECT_THROW(run_bench(device, {.points = 1 << 17}), InputError);
  EXPECT_THROW(run_bench(device, {.widths = {}}), InputError);
  EXPECT_THROW(run_bench(device, {.widths = {12}}), InputError);
  EXPECT_THROW(run_bench(device, {.repetitions = 0}), InputError);
}

}  // namespace
}  // namespace arah
