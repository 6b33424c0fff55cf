// The pages that the program writes, as a browser shows them: whole, offline, worst pictures first, on a desk and on a phone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/host/body/rigs.h"
#include "tests/stories/browser.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr int kDesk = 1200, kPhone = 400;  // pixels

// Pixels of exactly this colour.
int count_color(const cv::Mat& picture, const cv::Vec3b& color) {
  int count = 0;
  for (int y = 0; y < picture.rows; ++y)
    for (int x = 0; x < picture.cols; ++x) count += picture.at<cv::Vec3b>(y, x) == color;
  return count;
}

class BrowserStory : public testing::Test {
 protected:
  void SetUp() override {
    program_ = browser();
    if (!program_) GTEST_SKIP() << "neither chromium nor google-chrome is on the PATH: the pages were not looked at";
  }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  Outcome arah(const std::vector<std::string>& words) const { return Program(words, folder_.path()).wait(); }

  // What holds of every page; `pictures`: how many it shows.
  BrowsedPage expect_whole(const std::string& page, int width, std::size_t pictures) const {
    const BrowsedPage seen(*program_, at(page), folder_.path(), width);
    SCOPED_TRACE(page + " at " + std::to_string(width));
    EXPECT_EQ(seen.answers["images"].size(), pictures);
    for (const auto& image : seen.answers["images"]) {
      EXPECT_GT(image[1], 0) << image << " could not be decoded";
      EXPECT_GT(image[2], 0) << image;
      EXPECT_GE(image[3], 40) << image << " is too small to see";
      EXPECT_LE(image[3], width) << image;
    }
    EXPECT_THAT(seen.answers["resources"], testing::IsEmpty()) << "a page is one file";
    EXPECT_LE(seen.answers["overflow"], 0) << "the page is wider than the window";
    EXPECT_THAT(seen.answers["covered"], testing::IsEmpty());
    EXPECT_EQ(seen.screenshot.size(), cv::Size(width, kBrowsedHeight));
    EXPECT_GT(count_color(seen.screenshot, {255, 255, 255}), seen.screenshot.rows * width / 4) << "the page's ground";
    EXPECT_GT(count_color(seen.screenshot, {0, 0, 0}), 1000) << "the pictures' ground";
    if (const char* keep = std::getenv("ARAH_SCREENSHOTS")) {
      fs::create_directories(keep);
      cv::imwrite((fs::path(keep) / fmt::format("{}_{}.png", fs::path(page).stem().string(), width)).string(), seen.screenshot);
    }
    return seen;
  }

  TemporaryFolder folder_;

 private:
  std::optional<std::string> program_;
};

TEST_F(BrowserStory, PagesAreWholeOnADeskAndOnAPhone) {
  const std::vector<std::string> short_fit{"--set", "fit_steps=60", "--set", "fit_skinning_steps=30"};
  const auto with_fit = [&](std::vector<std::string> words) {
    words.insert(words.end(), short_fit.begin(), short_fit.end());
    return words;
  };
  ASSERT_EQ(arah({"synth", at("capture"), "--frames", "6", "--size", "48"}).code, 0);
  const Outcome trained = arah(with_fit({"train", at("capture"), "-o", at("run"), "--steps", "2"}));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  const Outcome measured = arah({"evaluate", at("run"), at("capture"), "-o", at("figures"), "--cameras", "cam_00,cam_02,cam_04,cam_06"});
  ASSERT_EQ(measured.code, 0) << measured.errors;
  const auto metrics = nlohmann::json::parse(read_all(at("figures/metrics.json")));
  double lowest = 1e9;
  for (const auto& image : metrics["images"]) lowest = std::min(lowest, image["psnr"].get<double>());
  const std::size_t pictures = metrics["images"].size();
  ASSERT_GE(pictures, 4u);

  for (const int width : {kDesk, kPhone}) {
    const BrowsedPage seen = expect_whole("figures/report.html", width, 4 * pictures);
    EXPECT_THAT(seen.answers["title"].get<std::string>(), testing::HasSubstr("Evaluation"));
    EXPECT_GT(count_color(seen.screenshot, {0xb2, 0x72, 0x00}), 100) << "the figures' blue";
    ASSERT_EQ(seen.answers["headings"].size(), pictures);
    double before = 0;
    for (const auto& heading : seen.answers["headings"]) {
      const std::string text = heading.get<std::string>();
      const std::size_t found = text.find("PSNR ");
      ASSERT_NE(found, text.npos) << text;
      const double psnr = std::stod(text.substr(found + 5));
      if (before == 0) {
        EXPECT_NEAR(psnr, lowest, 0.006) << "the worst comes first";
      }
      EXPECT_GE(psnr, before) << text;
      before = psnr;
    }
  }

  const Outcome study = arah(with_fit({"ablate", at("capture"), "-o", at("study"), "--size", "48", "--every", "100", "--only", "full,low_rank", "--steps", "2"}));
  ASSERT_EQ(study.code, 0) << study.errors;
  for (const int width : {kDesk, kPhone}) EXPECT_EQ(expect_whole("study/ablation.html", width, 3).answers["title"], "Ablations");
}

}  // namespace
}  // namespace arah
