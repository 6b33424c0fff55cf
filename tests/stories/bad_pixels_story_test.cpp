// Renderings that hold a NaN, as a user meets them: seen in the picture, counted and named by every command that makes pictures.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/avatar/avatar_file.h"
#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// Of the opaque magenta of what is not finite, in a picture of the program.
int magenta_pixels(const cv::Mat& picture) {
  int count = 0;
  for (int y = 0; y < picture.rows; ++y)
    for (int x = 0; x < picture.cols; ++x) count += picture.at<cv::Vec4b>(y, x) == cv::Vec4b(255, 0, 255, 255);
  return count;
}

// Lines that begin with "warning: ".
std::vector<std::string> warnings_in(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream all(text);
  for (std::string line; std::getline(all, line);)
    if (line.starts_with("warning: ")) lines.push_back(line);
  return lines;
}

TEST(BadPixelsStory, RenderAnimateAndEvaluateCountAndNameThem) {
  const TemporaryFolder folder;
  const auto arah = [&](const std::vector<std::string>& words) { return Program(words, folder.path()).wait(); };
  const std::string capture = (folder / "capture").string(), good = (folder / "good").string(), bad = (folder / "bad.safetensors").string();
  ASSERT_EQ(arah({"synth", capture, "--frames", "4", "--size", "48"}).code, 0);
  const Outcome trained = arah({"train", capture, "-o", good, "--steps", "2", "--set", "fit_steps=150", "--set", "fit_skinning_steps=100"});
  ASSERT_EQ(trained.code, 0) << trained.errors;

  // Numbers that are finite, and whose products are not, in the half of the body whose feature grid they fill.
  Avatar avatar = load_avatar(folder / "good" / "avatar.safetensors");
  ASSERT_FALSE(avatar.grid.nodes.empty());
  const glm::uvec3 nodes = avatar.grid.nodes[0];
  const std::span<float> values = avatar.tensor("grid.0");  // [z][y][x][channels]
  const std::size_t channels = values.size() / (std::size_t{nodes.x} * nodes.y * nodes.z);
  for (std::size_t i = 0; i < values.size(); ++i)
    if (i / channels % nodes.x < nodes.x / 2) values[i] = i % 2 ? 3e38f : -3e38f;
  for (float& gain : avatar.tensor("color.0.g")) gain *= 100;
  save_avatar(bad, avatar);

  const Outcome inspected = arah({"inspect", bad});
  EXPECT_THAT(inspected.output, HasSubstr("largest of them: 3e+38, in tensor \"grid.0\""));
  EXPECT_THAT(arah({"inspect", good}).output, Not(HasSubstr("e+38")));

  // One picture.
  const std::string picture = (folder / "color.png").string();
  const Outcome rendered = arah({"render", bad, "-o", picture, "--size", "40"});
  EXPECT_EQ(rendered.code, 0) << rendered.errors;
  const cv::Mat seen = cv::imread(picture, cv::IMREAD_UNCHANGED);
  const int magenta = magenta_pixels(seen);
  EXPECT_GT(magenta, 0);
  const std::vector<std::string> told = warnings_in(rendered.errors);
  ASSERT_EQ(told.size(), 1u) << rendered.errors;
  EXPECT_THAT(told[0], AllOf(HasSubstr(picture), HasSubstr(fmt::format(" {} of {} pixels are not finite", magenta, seen.total())), HasSubstr("'arah inspect " + bad + "'")));
  const Outcome whole = arah({"render", good, "-o", picture, "--size", "40"});
  EXPECT_EQ(whole.code, 0) << whole.errors;
  EXPECT_EQ(magenta_pixels(cv::imread(picture, cv::IMREAD_UNCHANGED)), 0);
  EXPECT_THAT(warnings_in(whole.errors), testing::IsEmpty()) << whole.errors;

  // A turntable: five pictures are named, the others counted.
  const Outcome turned = arah({"animate", bad, "-o", (folder / "turn").string(), "--turntable", "--count", "7", "--size", "24"});
  EXPECT_EQ(turned.code, 0) << turned.errors;
  const std::vector<std::string> of_turn = warnings_in(turned.errors);
  ASSERT_EQ(of_turn.size(), 6u) << turned.errors;
  for (std::size_t i = 0; i < 5; ++i) {
    const std::string file = (folder / "turn" / fmt::format("{:06}.png", i)).string();
    EXPECT_THAT(of_turn[i], HasSubstr(fmt::format("{}: {} of", file, magenta_pixels(cv::imread(file, cv::IMREAD_UNCHANGED)))));
  }
  EXPECT_THAT(of_turn[5], HasSubstr("7 pictures"));
  const Outcome turned_whole = arah({"animate", good, "-o", (folder / "whole").string(), "--turntable", "--count", "2", "--size", "24"});
  EXPECT_EQ(turned_whole.code, 0) << turned_whole.errors;
  EXPECT_THAT(warnings_in(turned_whole.errors), testing::IsEmpty());

  // Figures: none is made up for a picture that has none, and the work is not lost over it.
  const Outcome evaluated = arah({"evaluate", bad, capture, "-o", (folder / "evaluation").string()});
  EXPECT_EQ(evaluated.code, 0) << evaluated.errors;
  const nlohmann::json figures = nlohmann::json::parse(read_all(folder / "evaluation" / "metrics.json"));
  std::size_t unmeasured = 0, sum = 0;
  for (const nlohmann::json& image : figures["images"]) unmeasured += image["psnr"].is_null(), sum += image["bad_pixels"].get<std::size_t>();
  EXPECT_GT(unmeasured, 0u);
  EXPECT_GT(sum, unmeasured);
  EXPECT_EQ(figures["unmeasured"], unmeasured);
  EXPECT_EQ(figures["bad_pixels"], sum);
  EXPECT_EQ(warnings_in(evaluated.errors).size(), std::min<std::size_t>(unmeasured, 5) + (unmeasured > 5)) << evaluated.errors;
  EXPECT_THAT(evaluated.errors, AllOf(HasSubstr(fmt::format("warning: camera {}, frame {}: {} of", figures["images"][0]["camera"].get<std::string>(), figures["images"][0]["frame"].get<int>(), figures["images"][0]["bad_pixels"].get<std::size_t>()))));
  EXPECT_THAT(evaluated.output, HasSubstr(fmt::format("{} of them left out: not finite", unmeasured)));
  EXPECT_THAT(read_all(folder / "evaluation" / "report.html"), AllOf(HasSubstr("not finite (pixels)"), HasSubstr(fmt::format("{} not measured", unmeasured))));
  const Outcome evaluated_whole = arah({"evaluate", good, capture, "-o", (folder / "evaluation_whole").string()});
  EXPECT_EQ(evaluated_whole.code, 0) << evaluated_whole.errors;
  const nlohmann::json of_whole = nlohmann::json::parse(read_all(folder / "evaluation_whole" / "metrics.json"));
  EXPECT_EQ(of_whole["bad_pixels"], 0);
  EXPECT_EQ(of_whole["unmeasured"], 0);
  EXPECT_TRUE(of_whole["mean"]["psnr"].is_number());

  // No study without an exact picture to compare with.
  const Outcome studied = arah({"tradeoff", bad, capture, "-o", (folder / "study").string(), "--pictures", "1", "--size", "16"});
  EXPECT_EQ(studied.code, 2) << studied.errors;
  EXPECT_THAT(studied.errors, AllOf(HasSubstr("rendering 'paper' of camera "), HasSubstr("expected finite numbers, found "), HasSubstr(" pixels are not finite, the first in column "), HasSubstr("'arah inspect'")));
  EXPECT_FALSE(std::filesystem::exists(folder / "study" / "tradeoff.csv"));
}

}  // namespace
}  // namespace arah
