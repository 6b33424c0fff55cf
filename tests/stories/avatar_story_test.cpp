// From nothing to figures, as a user goes: synth, inspect, train, interrupt, resume, render, evaluate; and what the
// program says when something is wrong with the call.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <sstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "host/avatar/avatar_file.h"
#include "host/training/run_folder.h"
#include "tests/host/body/rigs.h"
#include "tests/host/evaluation/weighted_difference.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

constexpr int kSize = 64, kFrames = 6;

std::vector<std::string> comma_separated(const std::string& line) {
  std::vector<std::string> found;
  std::istringstream stream(line + ",");  // an empty cell at the end counts
  for (std::string cell; std::getline(stream, cell, ',');) found.push_back(cell);
  return found;
}

class Stories : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const Outcome made =
        arah({"synth", capture(), "--frames", std::to_string(kFrames), "--size", std::to_string(kSize)});
    ASSERT_EQ(made.code, 0) << made.errors;
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  static std::string at(const std::string& name) { return (*folder_ / name).string(); }
  static std::string capture() { return at("capture"); }
  static Outcome arah(const std::vector<std::string>& words) { return Program(words, folder_->path()).wait(); }
  // A short start: these tests are about the run, not the avatar.
  static std::vector<std::string> training(const std::string& run, std::vector<std::string> more) {
    more.insert(more.begin(),
                {"train", capture(), "-o", at(run), "--set", "fit_steps=60", "--set", "fit_skinning_steps=30"});
    return more;
  }
  static std::vector<std::string> names(const fs::path& folder) {
    std::vector<std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      found.push_back(entry.path().filename().string());
    return found;
  }
  // A copy of the capture to spoil.
  static fs::path spoiled(const std::string& name) {
    const fs::path copy = at(name);
    fs::remove_all(copy);
    fs::copy(capture(), copy, fs::copy_options::recursive);
    return copy;
  }
  static void change_json(const fs::path& path, const std::function<void(nlohmann::json&)>& change) {
    nlohmann::json json = nlohmann::json::parse(read_all(path));
    change(json);
    std::ofstream(path) << json;
  }
  // `arah train` must refuse the capture: code 2, one line that names all of `parts`, and no run left behind.
  static void expect_refused(const fs::path& bad, const std::vector<std::string>& parts) {
    const Outcome outcome = arah({"train", bad.string(), "-o", at("refused"), "--steps", "2"});
    EXPECT_EQ(outcome.code, 2) << outcome.errors;
    const std::size_t line = outcome.errors.find("arah: ");
    ASSERT_NE(line, std::string::npos) << outcome.errors;
    EXPECT_EQ(outcome.errors.find('\n', line), outcome.errors.size() - 1) << outcome.errors;
    for (const std::string& part : parts) EXPECT_THAT(outcome.errors.substr(line), HasSubstr(part));
    EXPECT_FALSE(fs::exists(at("refused"))) << "what a refused call left behind";
  }

 private:
  static TemporaryFolder* folder_;
};

TemporaryFolder* Stories::folder_ = nullptr;

TEST_F(Stories, ARunThatWasInterruptedEndsWithTheSameBits) {
  const Outcome inspected = arah({"inspect", capture()});
  EXPECT_EQ(inspected.code, 0) << inspected.errors;

  const Outcome whole = arah(training("whole", {"--steps", "6", "--keep", "0.01,1000"}));
  ASSERT_EQ(whole.code, 0) << whole.errors;
  EXPECT_THAT(whole.errors, HasSubstr("because"));  // the choice of parts, with reasons
  const Outcome first = arah(training("parts", {"--steps", "6", "--stop-at", "3"}));
  EXPECT_EQ(first.code, 1);
  EXPECT_THAT(first.errors, HasSubstr("stopped at step 3; continue with --resume"));
  ASSERT_EQ(load_avatar(at("parts/avatar.safetensors")).steps, 3u);
  EXPECT_NE(read_all(at("parts/avatar.safetensors")), read_all(at("whole/avatar.safetensors")));

  // A killed process leaves half a line of events and half a checkpoint: neither may matter.
  std::ofstream(at("parts/events.jsonl"), std::ios::app) << "{\"event\": \"st";
  std::ofstream(at("parts/checkpoints/step_00000004.safetensors")) << "half";
  const Outcome again = arah({"train", capture(), "-o", at("parts"), "--resume"});
  ASSERT_EQ(again.code, 0) << again.errors;
  EXPECT_THAT(again.errors, HasSubstr("at step 3"));
  EXPECT_EQ(read_all(at("parts/avatar.safetensors")), read_all(at("whole/avatar.safetensors")));
  std::ifstream events(at("parts/events.jsonl"));
  int starts = 0, ends = 0;
  for (std::string line; std::getline(events, line);) {
    const auto event = nlohmann::json::parse(line);
    starts += event["event"] == "start";
    ends += event["event"] == "end";
  }
  EXPECT_EQ(starts, 2);
  EXPECT_EQ(ends, 2);

  // The folder is taken, and other settings than the run's are no continuation.
  const Outcome taken = arah({"train", capture(), "-o", at("parts"), "--steps", "1"});
  EXPECT_EQ(taken.code, 2);
  EXPECT_THAT(taken.errors, HasSubstr("--resume"));
  const Outcome other = arah({"train", capture(), "-o", at("parts"), "--resume", "--seed", "5"});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.errors, HasSubstr("settings.seed"));
  const fs::path moved = spoiled("other");
  change_json(moved / "cameras.json", [](auto& json) { json["cameras"][0]["T"][0] = 0.5; });
  const Outcome elsewhere = arah({"train", moved.string(), "-o", at("parts"), "--resume"});
  EXPECT_EQ(elsewhere.code, 2);
  EXPECT_THAT(elsewhere.errors, HasSubstr("other/cameras.json"));

  // The avatar of a few steps has the template's shape: it can be seen and measured.
  const Outcome rendered =
      arah({"render", at("whole"), "-o", at("view.png"), "--size", "70", "--layers", "color,depth,normal"});
  ASSERT_EQ(rendered.code, 0) << rendered.errors;
  const cv::Mat color = cv::imread(at("view.png"), cv::IMREAD_UNCHANGED),
                depth = cv::imread(at("view_depth.png"), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(color.type(), CV_8UC4);
  ASSERT_EQ(depth.type(), CV_16UC1);
  ASSERT_EQ(color.size(), cv::Size(70, 70));
  EXPECT_TRUE(fs::exists(at("view_normal.png")));
  EXPECT_EQ(color.at<cv::Vec4b>(0, 0)[3], 0);
  EXPECT_EQ(depth.at<uint16_t>(0, 0), 0);
  EXPECT_GT(color.at<cv::Vec4b>(26, 35)[3], 200);       // the chest, a little above the middle
  EXPECT_NEAR(depth.at<uint16_t>(26, 35), 4500, 2500);  // millimetres, a person's whole height in 30°
  const Outcome layers = arah({"render", at("whole"), "-o", at("layers"), "--size", "70", "--layers", "color,canonical,weights,weights:left_knee,slice,slice:left_knee,samples,steps,failures"});
  ASSERT_EQ(layers.code, 0) << layers.errors;
  for (const char* name : {"canonical", "weights", "weights_left_knee", "slice", "slice_left_knee", "samples", "steps", "failures"}) {
    const cv::Mat layer = cv::imread(at(std::string("layers/") + name + ".png"), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(layer.type(), CV_8UC4) << name;
    ASSERT_EQ(layer.size(), cv::Size(70, 70)) << name;
    EXPECT_EQ(layer.at<cv::Vec4b>(26, 35)[3], 255) << name;
    EXPECT_EQ(layer.at<cv::Vec4b>(0, 0)[3], std::string(name).starts_with("slice") ? 255 : 0) << name;
    EXPECT_THAT(layers.errors, HasSubstr(std::string(name) + ".png  ")) << "what its colours mean";
  }
  // The chest does not follow the knee, and is inside.
  EXPECT_EQ(cv::imread(at("layers/weights_left_knee.png")).at<cv::Vec3b>(26, 35), cv::Vec3b(228, 224, 222));
  const cv::Vec3b inside = cv::imread(at("layers/slice.png")).at<cv::Vec3b>(26, 35), outside = cv::imread(at("layers/slice.png")).at<cv::Vec3b>(0, 0);
  EXPECT_GT(inside[0], inside[2]);
  EXPECT_GT(outside[2], outside[0]);
  EXPECT_EQ(read_all(at("layers/color.png")), read_all(at("view.png"))) << "looking at more changes nothing";
  for (const char* wrong : {"colour", "weights:nose", "steps:left_knee", "slice:"}) {
    const Outcome refused = arah({"render", at("whole"), "-o", at("none"), "--layers", wrong});
    EXPECT_EQ(refused.code, 2) << wrong;
    EXPECT_THAT(refused.errors, HasSubstr("layer"));
  }
  const Outcome posed =
      arah({"render", at("whole"), "-o", at("posed"), "--capture", capture(), "--camera", "cam_05", "--frame", "3"});
  ASSERT_EQ(posed.code, 0) << posed.errors;
  EXPECT_EQ(cv::imread(at("posed/color.png"), cv::IMREAD_UNCHANGED).size(), cv::Size(kSize, kSize));

  const Outcome measured =
      arah({"evaluate", at("whole"), capture(), "-o", at("figures"), "--cameras", "cam_04,cam_06", "--surface"});
  ASSERT_EQ(measured.code, 0) << measured.errors;
  const auto metrics = nlohmann::json::parse(read_all(at("figures/metrics.json")));
  ASSERT_EQ(metrics["images"].size(), 2u);  // frame 0 alone has pictures of held-out cameras
  EXPECT_EQ(metrics["images"][1]["camera"], "cam_06");
  EXPECT_GT(metrics["mean"]["psnr"].get<double>(), 5.0);
  EXPECT_LT(metrics["mean"]["psnr"].get<double>(), 40.0);
  EXPECT_GT(metrics["root_finding"]["points"].get<int>(), 1000);
  EXPECT_THAT(read_all(at("figures/report.html")), HasSubstr("cam_06"));
  ASSERT_GT(metrics["surface"].size(), 0u);
  EXPECT_GT(metrics["surface"][0]["mean_mm"].get<double>(), 0.1);
  EXPECT_LT(metrics["surface"][0]["mean_mm"].get<double>(), 40.0) << "a template's shape is nearer than that to the clothes";
  EXPECT_GT(metrics["surface"][0]["chamfer_cm2"].get<double>(), 0.01);
  EXPECT_GT(metrics["surface"][0]["normal_consistency"].get<double>(), 0.5);
  EXPECT_GT(metrics["surface"][0]["f_score_5mm"].get<double>(), 0.1);
  EXPECT_GT(metrics["mean"]["ssim_data_range_2"].get<double>(), metrics["mean"]["ssim"].get<double>()) << "larger constants";
  EXPECT_GT(metrics["spread"]["psnr"].get<double>(), 0.0);
  EXPECT_EQ(metrics["protocol_name"], "");
  for (const nlohmann::json& image : metrics["images"]) EXPECT_GE(image["found_percent"].get<double>(), metrics["root_finding"]["least_found_percent"].get<double>());

  // A protocol of the paper: under its name as it is, without it where something else was asked for.
  for (const auto& [more, name] : std::vector<std::pair<std::vector<std::string>, std::string>>{{{}, "novel-view"}, {{"--size", "32"}, ""}}) {
    std::vector<std::string> words{"evaluate", at("whole"), capture(), "-o", at("protocol"), "--protocol", "novel-view"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome published = arah(words);
    ASSERT_EQ(published.code, 0) << published.errors;
    const auto figures = nlohmann::json::parse(read_all(at("protocol/metrics.json")));
    EXPECT_EQ(figures["protocol_name"], name);
    EXPECT_EQ(figures["every"], 30);
    EXPECT_EQ(figures["cameras"], "held-out");
  }
  EXPECT_EQ(metrics["render"]["least_weight"], 1e-8) << "figures are those of the exact rendering";

  // The avatar that was kept on the way: after the first step, the fit having taken longer than that.
  const Outcome no_curve = arah({"curve", capture(), at("parts"), "-o", at("curve")});
  EXPECT_EQ(no_curve.code, 2);
  EXPECT_THAT(no_curve.errors, HasSubstr("--keep"));
  const Outcome curve = arah({"curve", capture(), at("whole"), "-o", at("curve"), "--every", "100"});
  ASSERT_EQ(curve.code, 0) << curve.errors;
  EXPECT_THAT(curve.output, testing::MatchesRegex("run,minutes,steps,psnr_views,psnr_motion,surface_mm\nwhole,0.01,1,[0-9.]+,[0-9.]*,[0-9.]+\n"));
  EXPECT_THAT(read_all(at("curve/curve.html")), HasSubstr("<svg"));

  const Outcome searches = arah({"bench", "--avatar", at("whole"), "--quick"});
  ASSERT_EQ(searches.code, 0) << searches.errors;
  for (const char* search : {"sphere tracing", "joint search", "correspondence search"}) EXPECT_THAT(searches.output, HasSubstr(search));

  // With the user's network there is one figure more, and without it no such name.
  EXPECT_THAT(read_all(at("figures/metrics.json")) + read_all(at("figures/report.html")) + measured.output, Not(HasSubstr("lpips")));
  EXPECT_THAT(read_all(at("figures/report.html")) + measured.output, Not(HasSubstr("LPIPS")));
  std::ofstream(at("network.onnx"), std::ios::binary) << weighted_difference_network({0.5f, 0.25f, 0.25f});
  const Outcome perceived = arah({"evaluate", at("whole"), capture(), "-o", at("perceived"), "--cameras", "cam_04,cam_06", "--lpips", at("network.onnx")});
  ASSERT_EQ(perceived.code, 0) << perceived.errors;
  EXPECT_THAT(perceived.output, HasSubstr(", LPIPS 0."));
  const auto distances = nlohmann::json::parse(read_all(at("perceived/metrics.json")));
  ASSERT_EQ(distances["images"].size(), 2u);
  const double of_first = distances["images"][0]["lpips"], of_second = distances["images"][1]["lpips"];
  EXPECT_GT(std::min(of_first, of_second), 0);
  EXPECT_LT(std::max(of_first, of_second), 2);
  EXPECT_NEAR(distances["mean"]["lpips"].get<double>(), (of_first + of_second) / 2, 1e-12);
  EXPECT_EQ(distances["mean"]["psnr"], metrics["mean"]["psnr"]);
  EXPECT_EQ(distances["lpips_network"], at("network.onnx"));
  EXPECT_THAT(distances["protocol"].get<std::string>(), HasSubstr("LPIPS"));
  EXPECT_THAT(read_all(at("perceived/report.html")), HasSubstr("mean LPIPS"));
  std::ofstream(at("broken.onnx")) << "no network";
  const Outcome broken = arah({"evaluate", at("whole"), capture(), "-o", at("perceived"), "--lpips", at("broken.onnx")});
  EXPECT_EQ(broken.code, 2);
  EXPECT_THAT(broken.errors, AllOf(HasSubstr("broken.onnx"), HasSubstr("ONNX")));

  // What the approximations cost, and which one to use.
  const Outcome studied = arah({"tradeoff", at("whole"), capture(), "-o", at("study"), "--pictures", "1", "--repetitions",
                                "1", "--size", "48", "--budget", "1h"});
  EXPECT_EQ(studied.code, 2);
  EXPECT_THAT(studied.errors, HasSubstr("--budget"));
  const Outcome study = arah({"tradeoff", at("whole"), capture(), "-o", at("study"), "--pictures", "1", "--repetitions", "1",
                              "--size", "32", "--budget", "100s", "--max-error", "50dB", "--lpips", at("network.onnx")});
  ASSERT_EQ(study.code, 0) << study.errors;
  EXPECT_THAT(study.output, HasSubstr("exact LPIPS"));
  EXPECT_THAT(study.output, HasSubstr("nearest within the time: paper"));
  EXPECT_THAT(study.output, HasSubstr("fastest within the error: "));
  const std::string csv = read_all(at("study/tradeoff.csv"));
  for (const char* setting : {"\"paper\"", "\"balanced\"", "\"fast\"", "\"preview\"", "\"samples 16\"", "\"least_weight 1e-3\"", "\"arithmetic half_storage\""})
    EXPECT_THAT(csv, HasSubstr(setting));
  // The exact rendering is no distance from itself, and as far from the photograph as its row says.
  const std::vector<std::string> header = comma_separated(csv.substr(0, csv.find('\n'))), paper = comma_separated(csv.substr(csv.find("\"paper\""), csv.find('\n', csv.find("\"paper\"")) - csv.find("\"paper\"")));
  ASSERT_EQ(header.size(), paper.size());
  const auto column = [&](const std::string& name) { return std::stod(paper.at(static_cast<std::size_t>(std::find(header.begin(), header.end(), name) - header.begin()))); };
  EXPECT_EQ(column("lpips_exact"), 0);
  EXPECT_GT(column("lpips_photograph"), 0);
  EXPECT_THAT(study.output, HasSubstr("arithmetic cooperative_matrix")) << "measured, or why not";
  EXPECT_THAT(read_all(at("study/tradeoff.svg")), HasSubstr("<svg"));
  EXPECT_THAT(read_all(at("study/report.html")), HasSubstr("preset fast"));
  const Outcome steps = arah({"tradeoff", at("whole"), capture(), "-o", at("study"), "--training", "--repetitions", "1", "--rays", "64"});
  ASSERT_EQ(steps.code, 0) << steps.errors;
  // Gradients of the exact step are their own truth; what is left out at a weight of 1e-6 moves them less than at 1e-2.
  std::map<std::string, std::vector<double>> rows;
  std::istringstream lines(read_all(at("study/training_tradeoff.csv")));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream cells(line);
    std::string name, cell;
    std::getline(cells, name, ',');
    while (name != "setting" && std::getline(cells, cell, ',')) rows[name].push_back(std::stod(cell));
  }
  const std::vector<double> exact = rows.at("\"exact\""), little = rows.at("\"least_weight 1e-6\""), more = rows.at("\"least_weight 1e-2\"");
  ASSERT_GT(exact.size(), 8u);
  double sum_little = 0, sum_more = 0;
  for (std::size_t i = 5; i < exact.size(); ++i) {  // after milliseconds, fastest, slowest, shaded, found
    EXPECT_EQ(exact[i], 0);
    sum_little += little[i];
    sum_more += more[i];
  }
  EXPECT_LT(sum_little, 1e-2);
  EXPECT_GT(sum_more, sum_little);
  EXPECT_LT(more[3], exact[3]) << "share of samples with a colour";
  const Outcome quick = arah({"render", at("whole"), "-o", at("quick.png"), "--size", "70", "--quality", "preview", "--set", "pixel_step=1"});
  ASSERT_EQ(quick.code, 0) << quick.errors;
  EXPECT_NEAR(cv::mean(cv::imread(at("quick.png"), cv::IMREAD_UNCHANGED))[3], cv::mean(color)[3], 3) << "the same silhouette";
}

// What a program holds beside its buffers, as the help of --memory says: itself, the driver with its compiler, the template's
// samples, pictures.
constexpr uint64_t kBesideBuffers = 450ull << 20;

void expect_resident_within(uint64_t peak_bytes, uint64_t ceiling) {
#if defined(__SANITIZE_ADDRESS__)
  std::printf("  %.0f MB resident, not compared with a ceiling of %.0f MB: the address sanitizer holds more than the program\n", 1e-6 * double(peak_bytes), 1e-6 * double(ceiling));
  std::fflush(stdout);  // or each program started after it says it again
#else
  EXPECT_LE(peak_bytes, ceiling + kBesideBuffers);
#endif
}

TEST_F(Stories, PosesThatBreakAnAvatarAreShown) {
  const Outcome trained = arah(training("bent", {"--steps", "2"}));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  const Outcome plain = arah({"inspect", at("bent")});
  ASSERT_EQ(plain.code, 0) << plain.errors;
  EXPECT_THAT(plain.output, testing::AllOf(HasSubstr("2 steps trained"), HasSubstr("density scale b: "), Not(HasSubstr("singular"))));
  const Outcome inspected = arah({"inspect", at("bent"), "--capture", capture(), "--count", "2", "--cell", "0.03", "--samples", "600", "--size", "96", "-o", at("conditioning")});
  ASSERT_EQ(inspected.code, 0) << inspected.errors;
  EXPECT_THAT(inspected.output, AllOf(testing::StartsWith(plain.output), HasSubstr("conditioning.html")));
  const std::string page = read_all(at("conditioning/conditioning.html"));
  std::size_t pictures = 0;
  for (std::size_t from = 0; (from = page.find("data:image/png;base64,", from)) != std::string::npos; ++from) ++pictures;
  EXPECT_EQ(pictures, 4u) << "before the person and behind, of two poses";
  const auto found = nlohmann::json::parse(read_all(at("conditioning/conditioning.json")));
  EXPECT_GT(found["b"].get<double>(), 0);
  ASSERT_EQ(found["poses"].size(), 2u);
  for (const auto& pose : found["poses"]) {
    const auto& surface = pose["surface"];
    const auto& shell = pose["shell"];
    EXPECT_EQ(shell["samples"].get<int>(), shell["found"].get<int>() + shell["refused"].get<int>() + shell["diverged"].get<int>() + shell["exhausted"].get<int>());
    const std::string line = fmt::format("frame {}: least singular value {:.3f} (median {:.2f}), {:.2f} % of the surface below 0.1, {:.2f} % folded", pose["frame"].get<int>(), surface["least_singular_value"].get<double>(),
                                         surface["median_least_singular_value"].get<double>(), 100 * surface["nearly_singular_share"].get<double>(), 100 * surface["folded_share"].get<double>());
    EXPECT_THAT(inspected.output, HasSubstr(line));
    EXPECT_THAT(page, HasSubstr(line));
    EXPECT_THAT(page, HasSubstr(fmt::format("<tr><td>{}</td><td>{:.3f}</td><td>{:.3f}</td><td>{:.2f} %</td>", pose["frame"].get<int>(), surface["least_singular_value"].get<double>(), surface["median_least_singular_value"].get<double>(), 100 * surface["nearly_singular_share"].get<double>())));
  }
  // One camera's picture of one frame, in its size; and calls that make no sense.
  const int number = found["poses"][1]["frame"].get<int>();
  const Outcome one = arah({"inspect", at("bent/avatar.safetensors"), "--capture", capture(), "--frame", std::to_string(number), "--cell", "0.03", "--samples", "600"});
  ASSERT_EQ(one.code, 0) << one.errors;
  EXPECT_THAT(one.output, AllOf(HasSubstr(fmt::format("frame {}: least", number)), Not(HasSubstr(".html"))));
  const auto refused = [](const std::vector<std::string>& words, const std::vector<std::string>& parts) {
    const Outcome outcome = arah(words);
    EXPECT_EQ(outcome.code, 2) << outcome.errors;
    for (const std::string& part : parts) EXPECT_THAT(outcome.errors, HasSubstr(part));
    EXPECT_FALSE(fs::exists(at("refused"))) << "what a refused call left behind";
  };
  refused({"inspect", at("bent"), "--frame", "0"}, {"--frame", "--capture or --motion"});
  refused({"inspect", at("bent"), "-o", at("refused")}, {"--out", "--capture or --motion"});
  refused({"inspect", capture(), "--capture", capture(), "-o", at("refused")}, {"--capture", "an avatar"});
  refused({"inspect", at("bent"), "--capture", capture(), "--frame", "9999", "-o", at("refused")}, {"frame", "9999"});
  refused({"inspect", at("bent"), "--capture", capture(), "--camera", "none", "-o", at("refused")}, {"none"});
}

TEST_F(Stories, MemoryStaysBelowItsCeiling) {
  const uint64_t ceiling = 100ull << 20;
  const Outcome trained = arah(training("lean", {"--steps", "2", "--set", "rays=2048", "--memory", "100M"}));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  EXPECT_THAT(trained.errors, HasSubstr("MB on the device of 104.9"));
  EXPECT_THAT(trained.errors, HasSubstr(" passes"));
  uint64_t most = 0;
  std::ifstream events(at("lean/events.jsonl"));
  for (std::string line; std::getline(events, line);) most = nlohmann::json::parse(line).value("most_memory", most);
  EXPECT_GT(most, ceiling / 2);
  EXPECT_LE(most, ceiling);
  expect_resident_within(trained.peak_bytes, ceiling);

  // A large picture, the same in small chunks.
  const auto picture = [&](const std::string& file, const std::string& memory) {
    return arah({"render", at("lean"), "-o", at(file), "--size", "2048", "--quality", "fast", "--set", "samples=2", "--memory", memory});
  };
  const Outcome lean = picture("lean.png", "60M"), ample = picture("ample.png", "2G");
  ASSERT_EQ(lean.code, 0) << lean.errors;
  ASSERT_EQ(ample.code, 0) << ample.errors;
  EXPECT_EQ(cv::imread(at("lean.png"), cv::IMREAD_UNCHANGED).size(), cv::Size(2048, 2048));
  EXPECT_EQ(read_all(at("lean.png")), read_all(at("ample.png")));
  std::printf("  resident: training %.0f MB, 2048 x 2048 pixels %.0f MB, without want %.0f MB\n", 1e-6 * double(trained.peak_bytes), 1e-6 * double(lean.peak_bytes), 1e-6 * double(ample.peak_bytes));
  std::fflush(stdout);  // or each program started below says it again
  expect_resident_within(lean.peak_bytes, 60ull << 20);

  // Too little is refused before any work, with what would do; and that does.
  const auto small = [&](const std::string& memory) { return arah({"render", at("lean"), "-o", at("small.png"), "--size", "16", "--memory", memory}); };
  const Outcome refused = small("8M");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.errors, AllOf(HasSubstr("asks for"), HasSubstr("ceiling is 8.0M"), HasSubstr("are held"), HasSubstr("--memory")));
  const std::string least = refused.errors.substr(refused.errors.find("ceiling of ") + 11);
  const Outcome enough = small(least.substr(0, least.find('M') + 1));
  EXPECT_EQ(enough.code, 0) << enough.errors;
  const Outcome no_room = arah(training("no_room", {"--steps", "2", "--memory", "8M"}));
  EXPECT_EQ(no_room.code, 2);
  EXPECT_THAT(no_room.errors, AllOf(HasSubstr("ceiling is 8.0M"), HasSubstr("--memory")));
  EXPECT_FALSE(fs::exists(at("no_room")));
  for (const char* wrong : {"2", "2T", "-1G", "G", "0M", "1.5.G", "1 G", "nanM"}) {
    const Outcome outcome = small(wrong);
    EXPECT_EQ(outcome.code, 2) << wrong;
    EXPECT_THAT(outcome.errors, AllOf(HasSubstr("--memory"), HasSubstr("512M"), HasSubstr(wrong)));
  }
}

TEST_F(Stories, PartsOfTheAvatarAreSetByName) {
  const Outcome trained = arah(training("parts_by_name", {"--steps", "2", "--size", "64", "--set", "root_correspondence=search", "--set", "spec.color.directions=canonical", "--set", "spec.color.view=true", "--set",
                                                          "spec.color.normal=true", "--set", "view_augmentation=1"}));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  const AvatarSpec spec = load_avatar(at("parts_by_name/avatar.safetensors")).spec;
  EXPECT_TRUE(spec.color.view && spec.color.normal);
  EXPECT_EQ(spec.color.directions, DirectionSpace::canonical);
  const Outcome resumed = arah({"train", capture(), "-o", at("parts_by_name"), "--resume", "--steps", "3", "--set", "spec.color.normal=false"});
  EXPECT_EQ(resumed.code, 2);
  EXPECT_THAT(resumed.errors, HasSubstr("spec.color.normal"));
  for (const char* wrong : {"spec.color.gloss=1", "spec.color.view", "spec.color=3", "spec.=1"}) {
    const Outcome refused = arah(training("refused", {"--steps", "1", "--set", wrong}));
    EXPECT_EQ(refused.code, 2) << wrong << refused.errors;
    EXPECT_THAT(refused.errors, HasSubstr("--set")) << wrong;
    EXPECT_FALSE(fs::exists(at("refused")));
  }
}

// A field of density has no surface to search, bake or draw: the study of renderings leaves these out by name.
TEST_F(Stories, ADensityIsStudiedWithoutWhatItDoesNotHave) {
  const Outcome trained = arah(training("density", {"--steps", "2", "--size", "64", "--set", "spec.sdf.kind=density", "--set", "sampling_mode=shell"}));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  const Outcome study = arah({"tradeoff", at("density"), capture(), "-o", at("density_study"), "--pictures", "1", "--repetitions", "1", "--size", "32"});
  ASSERT_EQ(study.code, 0) << study.errors;
  for (const char* missing : {"not measured: distances baked: ", "not measured: sampling_mode surface_only: ", "not measured: preview: "}) EXPECT_THAT(study.output, HasSubstr(missing));
  const std::string csv = read_all(at("density_study/tradeoff.csv"));
  for (const char* setting : {"\"paper\"", "\"balanced\"", "\"fast\"", "\"samples 16\""}) EXPECT_THAT(csv, HasSubstr(setting));
  EXPECT_THAT(csv, Not(HasSubstr("baked")));
}

// A study of ablations: figures and pictures of each variant; what is finished is not trained again, and other runs are not mixed in.
TEST_F(Stories, AblationsAreComparedAndGoOn) {
  const auto study = [](const std::vector<std::string>& more) {
    std::vector<std::string> words{"ablate", capture(), "-o", at("study"), "--size", "64", "--every", "100", "--only", "full,low_rank,surface_rendering", "--set", "fit_steps=60", "--set", "fit_skinning_steps=30"};
    words.insert(words.end(), more.begin(), more.end());
    return arah(words);
  };
  const Outcome first = study({"--steps", "3"});
  ASSERT_EQ(first.code, 0) << first.errors;
  const std::string csv = read_all(at("study/ablation.csv"));
  std::istringstream lines(csv);
  std::vector<std::vector<std::string>> cells;
  for (std::string line; std::getline(lines, line);) cells.push_back(comma_separated(line));
  ASSERT_EQ(cells.size(), 4u) << csv;
  const auto column = [&](const std::string& name) { return static_cast<std::size_t>(std::find(cells[0].begin(), cells[0].end(), name) - cells[0].begin()); };
  for (const char* name : {"psnr_views", "psnr_novel", "surface_mm", "steps", "learned_numbers", "device_mb"}) ASSERT_LT(column(name), cells[0].size()) << name;
  const std::vector<std::string> names{"full", "low_rank", "surface_rendering"};
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(cells[i + 1][0], names[i]);
    EXPECT_GT(std::stod(cells[i + 1][column("psnr_views")]), 5.0);
    EXPECT_GT(std::stod(cells[i + 1][column("surface_mm")]), 0.1);
    EXPECT_EQ(cells[i + 1][column("steps")], "3");
    EXPECT_GT(std::stod(cells[i + 1][column("device_mb")]), 1.0);
  }
  EXPECT_GT(std::stod(cells[2][column("learned_numbers")]), std::stod(cells[1][column("learned_numbers")]));
  EXPECT_THAT(first.output, HasSubstr("surface_rendering"));
  EXPECT_THAT(read_all(at("study/ablation.md")), HasSubstr("| `low_rank` |"));
  const std::string page = read_all(at("study/ablation.html"));
  std::size_t pictures = 0;
  for (std::size_t found = page.find("data:image/png;base64,iVBOR"); found != std::string::npos; found = page.find("data:image/png;base64,iVBOR", found + 1)) ++pictures;
  EXPECT_EQ(pictures, 4u) << "the photograph and three renderings";

  const auto events = [&] {
    std::string all;
    for (const std::string& name : names) all += read_all(at("study/" + name + "/events.jsonl"));
    return all;
  };
  const std::string before = events();
  const Outcome again = study({"--steps", "3"});
  ASSERT_EQ(again.code, 0) << again.errors;
  EXPECT_EQ(events(), before) << "nothing was trained";
  EXPECT_EQ(read_all(at("study/ablation.csv")), csv);
  EXPECT_THAT(again.errors, HasSubstr("trained before"));
  const Outcome on = study({"--steps", "4"});
  ASSERT_EQ(on.code, 0) << on.errors;
  EXPECT_THAT(read_all(at("study/ablation.csv")), HasSubstr(",4,"));
  const Outcome other = study({"--steps", "4", "--seed", "5"});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.errors, HasSubstr("settings.seed"));
  const Outcome unknown = arah({"ablate", capture(), "-o", at("x"), "--only", "everything"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.errors, HasSubstr("no_conditioning"));
}

// The first start compiles and says so; the next one reads the driver's cache.
TEST_F(Stories, TheSecondStartIsQuick) {
  ASSERT_EQ(arah(training("start", {"--steps", "1"})).code, 0);
  const std::string cache = at("shader-cache");
  const char* before = std::getenv("MESA_SHADER_CACHE_DIR");
  const std::string kept = before ? before : "";
  ::setenv("MESA_SHADER_CACHE_DIR", cache.c_str(), 1);
  const auto start = [] { return arah({"render", at("start"), "-o", at("start.png"), "--size", "64"}); };
  const Outcome first = start();
  std::vector<Outcome> later;
  for (int i = 0; i < 3; ++i) later.push_back(start());
  if (before) ::setenv("MESA_SHADER_CACHE_DIR", kept.c_str(), 1);
  else ::unsetenv("MESA_SHADER_CACHE_DIR");
  ASSERT_EQ(first.code, 0) << first.errors;
  // "... 39 shaders in 0.4 s"
  const auto seconds = [](const Outcome& outcome) { return std::stod(outcome.errors.substr(outcome.errors.rfind("shaders in ") + 11)); };
  double second = 1e9;
  for (const Outcome& outcome : later) {
    ASSERT_EQ(outcome.code, 0) << outcome.errors;
    second = std::min(second, seconds(outcome));
  }
  std::printf("  shaders: %.1f s of the first start, %.1f s of a later one\n", seconds(first), second);
  if (fs::exists(cache)) {  // another driver may have none
    EXPECT_THAT(first.errors, HasSubstr("compiling shaders: ")) << "seconds of it are not passed over in silence";
  }
  // Under a second where the processors are free; where others use them too, both take longer.
  EXPECT_LT(second, std::max(1.0, seconds(first) / 8));
}

TEST_F(Stories, CtrlCKeepsWhatWasLearned) {
  Program program(training("stopped", {"--minutes", "30"}), at(""));
  const RunFolder folder(at("stopped"));
  for (int i = 0; i < 3000 && program.running() && logged_steps(folder).empty(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  program.signal(SIGINT);
  const Outcome outcome = program.wait();
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.errors, HasSubstr("continue with --resume"));
  const Avatar avatar = load_avatar(folder.avatar_file());
  EXPECT_GE(avatar.steps, 1u);
  const auto checkpoint = folder.newest_checkpoint();
  ASSERT_TRUE(checkpoint.has_value());
  EXPECT_EQ(avatar_from_tensors(*checkpoint).steps, avatar.steps);
  for (const std::string& name : names(at("stopped"))) EXPECT_THAT(name, Not(HasSubstr(".part")));
}

TEST_F(Stories, CtrlCDuringTheFitLeavesNothing) {
  Program program({"train", capture(), "-o", at("early")}, at(""));
  for (int i = 0; i < 3000 && program.running() && !fs::exists(at("early/events.jsonl")); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  program.signal(SIGINT);
  const Outcome outcome = program.wait();
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.errors, HasSubstr("nothing was kept"));
  EXPECT_FALSE(fs::exists(at("early")));
}

// A prior from a folder of bodies: learned, interrupted, continued, started from, and refused where it does not fit.
TEST_F(Stories, ATrainingStartsFromAPrior) {
  fs::create_directories(at("bodies"));
  fs::copy(fs::path(capture()) / "template.glb", at("bodies/only.glb"));
  const std::string prior = at("prior.safetensors");
  const std::vector<std::string> learn{"pretrain", "-o", prior, "--family-folder", at("bodies"), "--set", "surface_points=64", "--set", "volume_points=64"};
  const auto with = [](std::vector<std::string> words, const std::vector<std::string>& more) {
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  Program program(with(learn, {"--set", "skinning.steps=100000"}), at(""));
  for (int i = 0; i < 6000 && program.running() && read_all(at("stderr.txt")).find("learn skinning weights") == std::string::npos; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  program.signal(SIGINT);
  const Outcome stopped = program.wait();
  EXPECT_EQ(stopped.code, 1);
  EXPECT_THAT(stopped.errors, HasSubstr("holds what there is, continue with --resume"));
  const Outcome taken = arah(learn);
  EXPECT_EQ(taken.code, 2);
  EXPECT_THAT(taken.errors, HasSubstr("--resume"));
  const Outcome again = arah(with(learn, {"--resume", "--set", "skinning.steps=2", "--set", "sdf.steps=2"}));
  ASSERT_EQ(again.code, 0) << again.errors;
  EXPECT_THAT(again.errors, HasSubstr("learn SDF"));

  const Outcome trained = arah({"train", capture(), "-o", at("from_prior"), "--steps", "1", "--prior", prior, "--set", "prior_fit_steps=3", "--set", "prior_fit_skinning_steps=2"});
  ASSERT_EQ(trained.code, 0) << trained.errors;
  EXPECT_THAT(read_all(at("from_prior/events.jsonl")), HasSubstr(R"({"event":"prior","file":)"));
  EXPECT_THAT(load_avatar(at("from_prior/avatar.safetensors")).settings, HasSubstr("prior.safetensors"));
  const Outcome other = arah({"train", capture(), "-o", at("refused"), "--steps", "1", "--preset", "compact", "--prior", prior});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.errors, HasSubstr("prior.safetensors: sdf.width: expected the avatar's"));
  EXPECT_FALSE(fs::exists(at("refused")));
}

TEST_F(Stories, WhatIsWrongIsNamedInOneLine) {
  expect_refused(at("nowhere"), {"nowhere"});

  const fs::path turned = spoiled("turned");
  change_json(turned / "cameras.json", [](auto& json) { json["cameras"][1]["R"][0][0] = 2.0; });
  expect_refused(turned, {"cameras.json", "cam_01", "R"});

  const fs::path nan = spoiled("nan");
  std::string motion = read_all(nan / "motion_train.json");
  const std::size_t theta = motion.find("[[", motion.find("\"theta\""));
  ASSERT_NE(theta, std::string::npos);
  motion.replace(theta + 2, motion.find(',', theta) - theta - 2, "NaN");
  std::ofstream(nan / "motion_train.json") << motion;
  expect_refused(nan, {"motion_train.json"});

  const fs::path joint = spoiled("joint");
  change_json(joint / "motion_train.json", [](auto& json) { json["joint_names"][3] = "tail"; });
  expect_refused(joint, {"motion_train.json", "tail"});

  const fs::path small = spoiled("small");
  const fs::path picture = small / "images/train/cam_02/000000.png";
  ASSERT_TRUE(cv::imwrite(picture.string(), cv::Mat(kSize / 2, kSize, CV_8UC4, cv::Scalar(9, 8, 7, 255))));
  expect_refused(small, {"cam_02/000000.png", "64"});

  const fs::path truncated = spoiled("truncated");
  const fs::path cut = truncated / "images/train/cam_03/000000.png";
  fs::resize_file(cut, fs::file_size(cut) / 2);
  expect_refused(truncated, {"cam_03/000000.png"});
}

TEST_F(Stories, WrongCallsAreExplained) {
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"train", capture(), "-o", at("x"), "--size", "65"},
                                             {"train", capture(), "-o", at("x"), "--set", "rays"},
                                             {"train", capture(), "-o", at("x"), "--set", "sdf.speed=1"},
                                             {"train", capture(), "-o", at("x"), "--steps", "1", "--minutes", "1"},
                                             {"train", capture(), "-o", at("x"), "--resume"},
                                             {"pretrain", "-o", at("x/prior.safetensors")},
                                             {"pretrain", "-o", at("x"), "--family-folder", at("nowhere")},
                                             {"pretrain", "-o", at("x"), "--set", "sdf.speed=1"},
                                             {"render", at("x"), "-o", at("y.png")},
                                             {"render", at("x"), "-o", at("y.png"), "--quality", "best"},
                                             {"tradeoff", at("x"), capture(), "-o", at("y")},
                                             {"evaluate", at("x"), capture(), "-o", at("y")},
                                             {"demo", capture()}}) {
    const Outcome outcome = arah(words);
    EXPECT_EQ(outcome.code, 2) << words[0] << ": " << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr("arah: "));
    EXPECT_FALSE(fs::exists(at("x")) || fs::exists(at("y")) || fs::exists(at("y.png")));
  }
  for (const char* word : {"ablate", "animate", "bench", "demo", "devices", "evaluate", "export", "import", "inspect", "pretrain", "render", "synth", "tradeoff",
                           "train"}) {
    const Outcome help = arah({word, "--help"});
    EXPECT_EQ(help.code, 0);
    EXPECT_THAT(help.output, HasSubstr(std::string("Example: arah ") + word));
  }
}

}  // namespace
}  // namespace arah
