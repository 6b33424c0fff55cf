// A run's folder that two want, whose capture has changed, or whose checkpoints are cut short.
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/faults/faults.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(Faults, OfTwoRunsOnOneFolderTheSecondIsRefused) {
  Program first(training("shared"), folder());
  ASSERT_TRUE(reaches_step(first, "shared", 1));
  // Stopped, so that it certainly is there still; the second program's output goes elsewhere.
  first.signal(SIGSTOP);
  const uint64_t step = newest_step("shared");
  fs::create_directories(at("second"));
  for (const auto& words : {training("shared"), resuming("shared")})
    expect_complaint(Program(words, at("second")).wait(), 2, {at("shared"), "another arah", "Wait for it"});
  EXPECT_EQ(newest_step("shared"), step);
  first.signal(SIGCONT);
  const Outcome undisturbed = first.wait();
  EXPECT_EQ(undisturbed.code, 0) << undisturbed.errors;
  expect_same_bits("shared");

  // Begun at one moment: one of them trains, whichever it is.
  Program one(training("race"), folder()), other(training("race"), at("second"));
  const Outcome a = one.wait(), b = other.wait();
  EXPECT_EQ(std::min(a.code, b.code), 0) << a.errors << b.errors;
  expect_complaint(a.code == 0 ? b : a, 2, {at("race")});
  expect_same_bits("race");
}

TEST_F(Faults, ACaptureThatChangedIsNamedWhenARunResumes) {
  auto words = training("moved");
  words.insert(words.end(), {"--stop-at", "3"});
  ASSERT_EQ(arah(words).code, 1);
  const std::string before = read_all(at("moved/config.json"));
  const auto changed = [&](const std::string& part, const std::function<void(const fs::path&)>& change) {
    SCOPED_TRACE(part);
    const fs::path copy = at("changed");
    fs::remove_all(copy);
    fs::copy(capture(), copy, fs::copy_options::recursive);
    change(copy);
    expect_complaint(arah({"train", copy.string(), "-o", at("moved"), "--resume"}), 2, {"changed/" + part + ":", "expected what " + at("moved") + " began with", "found another", "bring that back"});
    EXPECT_TRUE(read_all(at("moved/config.json")) == before);
    EXPECT_EQ(newest_step("moved"), 3u);
  };
  changed("cameras.json", [](const fs::path& copy) {
    auto json = nlohmann::json::parse(read_all(copy / "cameras.json"));
    json["cameras"][0]["T"][0] = 0.5;
    std::ofstream(copy / "cameras.json") << json;
  });
  changed("motion_train.json", [](const fs::path& copy) { std::ofstream(copy / "motion_train.json", std::ios::app) << "\n"; });
  // One level of grey in one pixel; a picture too few; pictures exchanged.
  const fs::path camera = "images/train/cam_00", picture = camera / "000000.png", other = "images/train/cam_01/000000.png";
  changed(camera.string(), [&](const fs::path& copy) {
    cv::Mat pixels = cv::imread((copy / picture).string(), cv::IMREAD_UNCHANGED);
    pixels.data[0] ^= 1;
    ASSERT_TRUE(cv::imwrite((copy / picture).string(), pixels));
  });
  changed(camera.string(), [&](const fs::path& copy) { fs::remove(copy / picture); });
  changed(camera.string(), [&](const fs::path& copy) {
    fs::rename(copy / picture, copy / "kept.png");
    fs::rename(copy / other, copy / picture);
    fs::rename(copy / "kept.png", copy / other);
  });

  // The same capture in another place is no other one.
  fs::remove_all(at("changed"));
  fs::copy(capture(), at("changed"), fs::copy_options::recursive);
  const Outcome resumed = arah({"train", at("changed"), "-o", at("moved"), "--resume"});
  ASSERT_EQ(resumed.code, 0) << resumed.errors;
  expect_same_bits("moved");
}

TEST_F(Faults, ACheckpointCutShortIsPassedOverOrNamed) {
  auto words = training("cut");
  words.insert(words.end(), {"--stop-at", "4"});
  ASSERT_EQ(arah(words).code, 1);
  const fs::path newest = at("cut/checkpoints/step_00000004.safetensors"), older = at("cut/checkpoints/step_00000003.safetensors");
  const std::string whole = read_all(newest);
  ASSERT_TRUE(fs::exists(older));
  ASSERT_GT(whole.size(), 1u << 20);

  // Every length: the older one opens instead, with a reason for the newer; and never is half a checkpoint taken for one.
  const std::size_t step = long_form() ? 1024 : 64 * 1024 + 1;
  const RunFolder run(at("cut"));
  std::size_t tried = 0, passed_over = 0;
  std::vector<std::size_t> lengths{0, 1, 7, 8, 9, whole.size() - 1};
  for (std::size_t length = step; length < whole.size(); length += step) lengths.push_back(length);
  std::sort(lengths.rbegin(), lengths.rend());  // cut shorter and shorter
  // Alone, so that the older one need not be read each time.
  fs::rename(older, at("older"));
  for (const std::size_t length : lengths) {
    fs::resize_file(newest, length);
    ++tried;
    std::vector<std::string> damaged;
    try {
      run.newest_checkpoint(&damaged);
      ADD_FAILURE() << length << " of " << whole.size() << " bytes were taken for a checkpoint";
    } catch (const InputError& error) {
      const std::string text = error.what();
      passed_over += damaged.size() == 1 && text.find(newest.filename().string()) != std::string::npos && text.find("expected") != std::string::npos && text.find("found") != std::string::npos && text.find('\n') == std::string::npos;
    }
  }
  std::printf("  a checkpoint of %zu bytes cut short at %zu lengths, noticed and named at %zu\n", whole.size(), tried, passed_over);
  std::fflush(stdout);
  EXPECT_EQ(passed_over, tried);

  // As a user sees it: all damaged is an error, which leaves everything as it is; with an older one the run goes on.
  const auto cut_to = [&](std::size_t length) { std::ofstream(newest, std::ios::binary).write(whole.data(), static_cast<std::streamsize>(length)); };
  cut_to(whole.size() / 2);
  expect_complaint(arah(resuming("cut")), 2, {"cut/checkpoints", "expected a checkpoint that opens", "found none", newest.string(), "damaged or was cut short", "Remove them to begin again"});
  EXPECT_EQ(fs::file_size(newest), whole.size() / 2);
  fs::rename(at("older"), older);
  const Outcome resumed = arah(resuming("cut"));
  ASSERT_EQ(resumed.code, 0) << resumed.errors;
  EXPECT_THAT(resumed.errors, testing::AllOf(HasSubstr("passed over: " + newest.string()), HasSubstr("at step 3")));
  expect_same_bits("cut");
}

}  // namespace
}  // namespace arah
