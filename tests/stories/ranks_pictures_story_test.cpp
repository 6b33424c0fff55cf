// Pictures and measurements that several ranks share out: mpirun -n 2 arah render, evaluate, tradeoff. What comes out is what one rank
// makes, byte for byte, but for times.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/stories/ranks.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class RanksPicturesStory : public RanksTest {
 protected:
  static void SetUpTestSuite() {
    RanksTest::SetUpTestSuite();
    if (HasFatalFailure()) return;
    const Outcome trained = arah(1, {"train", at("capture"), "-o", at("avatar"), "--steps", "2", "--set", "rays=192", "--set", "fit_steps=40", "--set", "fit_skinning_steps=20"});
    ASSERT_EQ(trained.code, 0) << trained.errors;
  }

  // The lines' words between commas, without those of the columns that hold times.
  static std::vector<std::vector<std::string>> without_times(const std::string& csv) {
    std::vector<std::vector<std::string>> lines;
    std::istringstream text(csv);
    for (std::string line; std::getline(text, line);) {
      lines.emplace_back();
      bool quoted = false;
      std::string word;
      for (const char letter : line + ",") {
        if (letter == '"') quoted = !quoted;
        if (letter != ',' || quoted) word += letter;
        else lines.back().push_back(std::exchange(word, ""));
      }
    }
    std::vector<std::size_t> kept;
    for (std::size_t c = 0; c < lines.at(0).size(); ++c) {
      const std::string& name = lines[0][c];
      if (name.find("milliseconds") == std::string::npos && name != "fastest" && name != "slowest" && name != "pareto" && !name.ends_with(" ms")) kept.push_back(c);
    }
    for (auto& line : lines) {
      std::vector<std::string> some;
      for (const std::size_t c : kept) some.push_back(line.at(c));
      line = some;
    }
    return lines;
  }
};

TEST_F(RanksPicturesStory, RenderToTheSamePicture) {
  const std::vector<std::string> layers{"color", "depth", "normal", "canonical", "weights", "slice", "samples", "steps", "failures"};
  std::string all;
  for (const std::string& layer : layers) all += (all.empty() ? "" : ",") + layer;
  // The last one draws a mesh and every so-manieth pixel, between which the others are interpolated.
  for (const auto& [quality, asked] : {std::pair<std::string, std::string>{"paper", all}, {"preview", "color,depth,normal"}}) {
    for (const int ranks : {1, 2, 3}) {
      if (quality == "preview" && ranks == 3) continue;
      const std::string folder = at(fmt::format("{}_{}", quality, ranks));
      const Outcome made = arah(ranks, {"render", at("avatar"), "-o", folder, "--orbit", "30", "--size", "56", "--quality", quality, "--layers", asked});
      ASSERT_EQ(made.code, 0) << made.errors;
      std::istringstream names(asked);
      for (std::string layer; std::getline(names, layer, ',');) {
        const std::string picture = read_all(fmt::format("{}/{}.png", folder, layer));
        EXPECT_GT(picture.size(), 100u) << layer;
        EXPECT_TRUE(picture == read_all(at(fmt::format("{}_1/{}.png", quality, layer)))) << quality << ", " << layer << ", " << ranks << " ranks";
      }
    }
  }
}

TEST_F(RanksPicturesStory, EvaluateToTheSameReport) {
  for (const int ranks : {1, 2, 3}) {
    const std::string folder = at(fmt::format("evaluation_{}", ranks));
    const Outcome made = arah(ranks, {"evaluate", at("avatar"), at("capture"), "-o", folder, "--cameras", "all", "--every", "2", "--size", "40", "--quality", "balanced"});
    ASSERT_EQ(made.code, 0) << made.errors;
    const auto figures = [&](int of) {
      auto json = nlohmann::ordered_json::parse(read_all(at(fmt::format("evaluation_{}/metrics.json", of))));
      json.erase("seconds");
      return json.dump();
    };
    EXPECT_EQ(figures(ranks), figures(1));
    EXPECT_GE(nlohmann::json::parse(figures(ranks)).at("images").size(), 4u);
    EXPECT_GT(nlohmann::json::parse(figures(ranks)).at("root_finding").at("points").get<uint64_t>(), 0u);
    EXPECT_TRUE(read_all(folder + "/report.html") == read_all(at("evaluation_1/report.html"))) << ranks << " ranks";
    EXPECT_THAT(made.output, HasSubstr("PSNR"));
    EXPECT_EQ(made.output.find("PSNR"), made.output.rfind("PSNR")) << "one rank tells: " << made.output;
  }
}

TEST_F(RanksPicturesStory, TradeoffFindsTheSameErrors) {
  for (const int ranks : {1, 3}) {
    const Outcome made = arah(ranks, {"tradeoff", at("avatar"), at("capture"), "-o", at(fmt::format("study_{}", ranks)), "--presets", "--pictures", "2", "--size", "24", "--repetitions", "1"});
    ASSERT_EQ(made.code, 0) << made.errors;
    const auto table = without_times(read_all(at(fmt::format("study_{}/tradeoff.csv", ranks))));
    EXPECT_EQ(table, without_times(read_all(at("study_1/tradeoff.csv"))));
    ASSERT_EQ(table.size(), 5u);
    EXPECT_THAT(table[0], testing::IsSupersetOf({"psnr_exact", "psnr_photograph", "ssim_photograph", "depth_error_mm", "normal_error_degrees", "found"}));
  }
}

TEST_F(RanksPicturesStory, OneThatFailsEndsAllWithItsMessage) {
  fs::copy(at("capture"), at("torn"), fs::copy_options::recursive);
  std::string torn;
  for (const auto& entry : fs::recursive_directory_iterator(at("torn/images/train")))
    if (entry.is_regular_file()) torn = std::max(torn, entry.path().string());
  fs::resize_file(torn, 40);
  const Outcome failed = arah(2, {"evaluate", at("avatar"), at("torn"), "-o", at("torn_evaluation"), "--cameras", "all", "--size", "16"});
  EXPECT_NE(failed.code, 0);
  EXPECT_THAT(failed.errors, HasSubstr(torn));
  EXPECT_FALSE(fs::exists(at("torn_evaluation/metrics.json")));

  std::vector<std::string> words = on(1, {"render", at("avatar"), "-o", at("mixed.png"), "--size", "16"}), other = on(1, {"render", at("avatar"), "-o", at("mixed.png"), "--size", "17"});
  words.push_back(":");
  words.insert(words.end(), other.begin(), other.end());
  const Outcome mixed = Program({}, folder_->path(), mpirun(words)).wait();
  EXPECT_EQ(mixed.code, 2) << mixed.errors;
  EXPECT_THAT(mixed.errors, HasSubstr("rank 1: work: expected what rank 0 has"));
  EXPECT_FALSE(fs::exists(at("mixed.png")));

  const Outcome training = arah(2, {"tradeoff", at("avatar"), at("capture"), "-o", at("no_study"), "--training"});
  EXPECT_EQ(training.code, 2) << training.errors;
  EXPECT_THAT(training.errors, HasSubstr("arah tradeoff --training: expected to be called without mpirun, found 2 ranks."));
}

// The second rank's device calls itself by another name: vectors of 512 bits.
TEST_F(RanksPicturesStory, UnequalDevicesAreNamed) {
  std::vector<std::string> words = on(1, {"animate", at("avatar"), "-o", at("unequal"), "--turntable", "--count", "3", "--size", "16"}), other = words;
  other.insert(other.begin() + 2, {"env", "LP_NATIVE_VECTOR_WIDTH=512"});
  words.push_back(":");
  words.insert(words.end(), other.begin(), other.end());
  const Outcome made = Program({}, folder_->path(), mpirun(words)).wait();
  if (made.errors.find("no usable Vulkan device") != std::string::npos) GTEST_SKIP() << "there is no second kind of device here";
  ASSERT_EQ(made.code, 0) << made.errors;
  EXPECT_THAT(made.errors, HasSubstr("note: rank 1 computes on "));
  EXPECT_TRUE(fs::exists(at("unequal/000002.png")));
}

}  // namespace
}  // namespace arah
