// The bench as a user runs it: one table in which no kernel is missing, a file of figures, and a comparison with it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST(BenchStory, EveryKernelAndStageHasALine) {
  const TemporaryFolder folder;
  const std::string figures = (folder / "bench.json").string();
  const Outcome outcome = Program({"bench", "--quick", "--json", figures}, folder.path()).wait();
  ASSERT_EQ(outcome.code, 0) << outcome.errors;

  std::set<std::string> shaders, measured;
  const fs::path root = fs::path(ARAH_SOURCE_DIR) / "shaders";
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root))
    if (entry.path().extension() == ".comp") shaders.insert(fs::relative(entry.path(), root).replace_extension().string());
  // The one kernel that not every device can run: `arah devices` says whether this one does.
  const Outcome devices = Program({"devices", "--json"}, folder.path()).wait();
  ASSERT_EQ(devices.code, 0) << devices.errors;
  const auto listed = nlohmann::json::parse(devices.output);
  for (const auto& device : listed.at("devices"))
    if (device.at("chosen") && device.at("cooperative_matrix_missing") != "") shaders.erase("linear/cooperative_forward");
  const auto json = nlohmann::json::parse(read_all(figures));
  for (const auto& line : json.at("kernels").at("shaders")) {
    measured.insert(line.at("name").get<std::string>());
    EXPECT_GT(line.at("milliseconds").get<double>(), 0) << line;
    EXPECT_TRUE(line.contains("share_of_peak_arithmetic") || line.contains("share_of_peak_bandwidth")) << line << " counts neither operations nor bytes";
    EXPECT_THAT(outcome.output, HasSubstr("  " + fs::path(line.at("name").get<std::string>()).filename().string()));
  }
  EXPECT_EQ(measured, shaders) << "a shader without a line belongs into one of the works (host/evaluation/work_bench.h) or beside them (bench.cpp)";

  std::set<std::string> stages;
  for (const auto& work : json.at("works"))
    for (const auto& stage : work.at("stages")) stages.insert(stage.at("name").get<std::string>());
  EXPECT_EQ(stages, (std::set<std::string>{"weights", "rays", "sphere tracing", "joint search", "correspondence search", "distances", "shading", "compositing", "losses",
                                           "compositing backward", "shading backward", "skinning backward", "mask loss", "regularisers", "watch", "optimiser", "meshing"}));

  const Outcome wrong = Program({"bench", "--quick", "--compare", (folder / "none.json").string()}, folder.path()).wait();
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.errors, HasSubstr("none.json"));
  std::printf("%s", outcome.output.c_str());
}

}  // namespace
}  // namespace arah
